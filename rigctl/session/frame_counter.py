"""The camera's own frame counter: a number that stands still is an old picture, a gap is a lost one."""

from drivers.cameras.gige_options import read_gige_place

_FREE = "trigger=free"


def is_triggered(address: str) -> bool:
    """Return whether a camera takes a picture only when it is asked for one, so that its numbers follow each other.

    Parameters
    ----------
    address : str
        The camera's in the rig file. Only GigE and simulated cameras are known to be triggered.
    """
    scheme, _, place = address.partition(":")
    if scheme == "gige":
        return read_gige_place(place).trigger == "software"
    return scheme == "sim" and _FREE not in place


class FrameCounter:
    """Follows the numbers of a camera's frames.

    Parameters
    ----------
    is_triggered : bool
        Whether the numbers follow each other; a camera that runs by itself counts what nobody asked for, too.
    """

    def __init__(self, *, is_triggered: bool) -> None:
        self._is_triggered = is_triggered
        self._last: int | None = None

    def forget(self) -> None:
        """Take the next number as it comes."""
        self._last = None

    def problem(self, number: int) -> str | None:
        """Take in the number of a frame; return what is wrong with it."""
        last, self._last = self._last, number
        if last is None:
            return None
        if number <= last:
            return f"camera: its frame counter says {number} after {last}: it sent an old picture, or was restarted"
        missing = number - last - 1
        if missing and self._is_triggered:
            return f"camera: its frame counter says {number} after {last}: {missing} pictures were lost on their way"
        return None
