"""Which number a simulated camera gives its next frame: its noise is keyed by it, so that a run can be gone on with."""

from collections.abc import Iterable

from drivers.interfaces import Camera
from rigctl.runs.run_folder import FrameRecord

_TIMEOUT_S = 3600.0


def number_after(frames: Iterable[FrameRecord], sequence: int, *, used: int) -> int:
    """Return which number the camera gave or would have given to a step, had the session not been interrupted.

    Parameters
    ----------
    frames : iterable of FrameRecord
        What was taken.
    sequence : int
        The step.
    used : int
        Numbers below this were used up, by metering for instance.
    """
    before = [frame for frame in frames if frame.sequence < sequence and frame.camera_frame is not None]
    if not before:
        return max(sequence, used)
    last = max(before, key=lambda frame: frame.sequence)
    return max((last.camera_frame or 0) + sequence - last.sequence, used)


def skip_to(camera: Camera, number: int) -> None:
    """Take frames and drop them until the camera's next frame has a number; at once where it has it already."""
    if number <= 0:
        return
    while camera.take_frame(timeout_s=_TIMEOUT_S).sequence + 1 < number:
        pass
