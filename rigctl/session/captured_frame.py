"""A frame as it came from the devices, before it is stored."""

from dataclasses import dataclass

from drivers.interfaces import CameraSettings, Frame, Move
from rigctl.session.interlock_violation import InterlockViolation


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedFrame:
    """A frame, and how it came about.

    Attributes
    ----------
    frame : Frame
        What the camera gave.
    settings : CameraSettings
        What the camera said that it was set to.
    move : Move or None
        The last move of the stage.
    is_new_move : bool
        It was made for this frame.
    saturated_fraction : float
        Share of saturated pixels.
    violations : tuple of InterlockViolation
        What was wrong with settings and frame counter.
    """

    frame: Frame
    settings: CameraSettings
    move: Move | None
    is_new_move: bool
    saturated_fraction: float
    violations: tuple[InterlockViolation, ...] = ()
