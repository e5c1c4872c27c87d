"""The numbers on which a simulated camera's noise hangs: a session goes on as if it had not been interrupted."""

from collections.abc import Iterable
from pathlib import Path

from rigctl.runs.frame_record import EXPOSURE_PARTS, FrameRecord
from rigctl.runs.run_events import RunEvent, metered_exposures, read_events
from rigctl.runs.run_folder import read_run
from sim_devices.camera import SimCamera

_BEGINNINGS = ("resumed", "devices opened again")
# More pictures than are taken between two beginnings, damaged ones and those of a camera that runs by itself included.
_NUMBERS_EACH = 10_000_000


class NoiseNumbers:
    """Gives the frame of each step the number that it had, were the session taken without an interruption.

    Parameters
    ----------
    camera : SimCamera
        Within this program.
    run : Path or None
        The run folder of the session, which need not exist yet; None goes on with nothing.
    """

    def __init__(self, camera: SimCamera, run: Path | None) -> None:
        self._camera, self._run = camera, run
        self._last: int | None = None

    def begin_step(self, sequence: int) -> bool:
        """Bring the camera to the number of a step; return whether its numbers jump."""
        number = self._first_number(sequence) if self._last is None else self._after(sequence, self._last)
        self._last = sequence
        if number <= self._camera.next_sequence:
            return False
        self._camera.go_on_from(number)
        return True

    def _after(self, sequence: int, last: int) -> int:
        """Return the number of a step: those that were left out before it use up theirs."""
        return self._camera.next_sequence + sequence - last - 1

    def _first_number(self, sequence: int) -> int:
        if self._run is None or not self._run.is_dir():
            return 0
        return number_after(read_run(self._run).frames, read_events(self._run), sequence)


class FreshNoise:
    """Draws the noise anew wherever a session is gone on with, for a camera that is simulated on the network.

    Parameters
    ----------
    camera : SimCamera
        What makes the pictures; the network gives them other numbers.
    run : Path or None
        The run folder of the session, which need not exist yet; None goes on with nothing.

    Notes
    -----
    Over the network pictures are lost and taken again, so that noise cannot go on where it was.
    """

    def __init__(self, camera: SimCamera, run: Path | None) -> None:
        self._camera, self._run = camera, run
        self._has_begun = False

    def begin_step(self, sequence: int) -> bool:
        """Leave the numbers of earlier parts behind, before the first step; the camera's own numbers never jump."""
        if not self._has_begun and self._run is not None and self._run.is_dir():
            beginnings = sum(event.event in _BEGINNINGS for event in read_events(self._run))
            if beginnings > 0:
                self._camera.go_on_from(beginnings * _NUMBERS_EACH)
        self._has_begun = True
        return False


def number_after(frames: Iterable[FrameRecord], events: Iterable[RunEvent], sequence: int) -> int:
    """Return which number the camera gave or would have given to a step, had the session not been interrupted.

    Parameters
    ----------
    frames : iterable of FrameRecord
        What was taken.
    events : iterable of RunEvent
        Of the run: metering uses up numbers and notes the next one.
    sequence : int
        The step.
    """
    used = max((one.next_camera_frame or 0 for one in metered_exposures(events)), default=0)
    before = [frame for frame in frames if _place(frame) < sequence and frame.camera_frame is not None]
    if not before:
        return used
    last = max(before, key=_place)
    return max((last.camera_frame or 0) + sequence - _place(last), used)


def _place(frame: FrameRecord) -> int:
    """Return which exposure of the session a frame is of, from 0."""
    return frame.sequence if frame.exposure_id is None else frame.exposure_id // EXPOSURE_PARTS
