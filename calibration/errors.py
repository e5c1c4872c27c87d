"""Errors of frames that are unfit for a calibration."""

from calibration.flags import Flag


class CalibrationError(Exception):
    """Frames do not allow the calibration that was asked for."""


class RefusedFramesError(CalibrationError):
    """Frames show something that makes any number from them wrong.

    Attributes
    ----------
    flags : tuple of Flag
        All that was found, the refusing ones and the others.
    """

    def __init__(self, flags: tuple[Flag, ...]) -> None:
        refusing = [f"{flag.name}: {flag.message}" for flag in flags if flag.refuses]
        super().__init__("the frames are refused:\n  " + "\n  ".join(refusing))
        self.flags = flags


def refused(name: str, message: str) -> RefusedFramesError:
    """Return the error of frames that one finding alone makes unfit."""
    return RefusedFramesError((Flag(name=name, message=message, refuses=True),))
