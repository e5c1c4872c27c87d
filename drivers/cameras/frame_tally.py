"""What became of the pictures that a camera sent."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class FrameTally:
    """Counts since the camera was opened.

    Attributes
    ----------
    accepted : int
        Pictures that were handed on.
    damaged : int
        Pictures that came in incomplete, or marked as damaged.
    too_old : int
        Pictures whose exposure began before they were asked for.
    never_came : int
        Pictures that were asked for and did not come.
    reopened : int
        How often the connection was lost, made again, and all settings restored.
    """

    accepted: int = 0
    damaged: int = 0
    too_old: int = 0
    never_came: int = 0
    reopened: int = 0
