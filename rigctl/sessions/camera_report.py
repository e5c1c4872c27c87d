"""What a camera tells of itself, for the run that it takes: at the beginning how it is set, at the end how it went."""

from dataclasses import asdict
from typing import Any

from drivers.interfaces import Camera, ReportingCamera
from rigctl.runs.run_state import TALLY_EVENT
from rigctl.runs.run_writer import RunWriter


def facts_of(camera: Camera) -> dict[str, Any] | None:
    """Return how a camera's counts come about, and its features by its own names; None for one that does not tell.

    Raises
    ------
    DeviceError
        It does not answer.
    """
    if not isinstance(camera, ReportingCamera):
        return None
    return asdict(camera.facts()) | {"features": camera.features()}


def note_tally(camera: Camera, writer: RunWriter) -> None:
    """Note as an event what became of the pictures since the camera was opened, where it counts them.

    Raises
    ------
    RunFolderError
        The run cannot be written.
    """
    if isinstance(camera, ReportingCamera):
        writer.event(TALLY_EVENT, **asdict(camera.tally()))
