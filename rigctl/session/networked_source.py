"""The noise of a camera that is simulated on the network, where a run is gone on with."""

from pathlib import Path

from rigctl.devices.rig import Rig
from rigctl.runs.run_state import read_event_lines

_BEGINNINGS = ("resumed", "devices opened again")
# More pictures than are taken between two beginnings, damaged ones and those of a camera that runs by itself included.
_NUMBERS_EACH = 10_000_000


def begin_networked_source(rig: Rig, run: Path) -> None:
    """Give the pictures from here on noise that no earlier part of the run had; another camera is left alone.

    Notes
    -----
    Over the network pictures are lost and taken again, so that noise cannot go on where it was, as it does for a
    camera within the program. It is drawn anew instead.
    """
    if rig.source is None or not rig.is_networked:
        return
    beginnings = sum(event["event"] in _BEGINNINGS for event in read_event_lines(run))
    if beginnings > 0:
        rig.source.go_on_from(beginnings * _NUMBERS_EACH)
