"""Angles that come back to themselves after a turn."""

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

AngleT = TypeVar("AngleT", float, "NDArray[np.float64]")


def wrapped(angle: AngleT, *, turn: float) -> AngleT:
    """Return an angle, such as a difference of two, brought into [-turn / 2, turn / 2).

    Parameters
    ----------
    angle : float or array
        Any finite angle.
    turn : float
        After which it comes back to itself, in its unit: 360 deg for directions, 180 deg for a polarizer's axis.
    """
    half = turn / 2.0
    return (angle + half) % turn - half
