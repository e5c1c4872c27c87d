"""Angles that come back to themselves after a turn: how far apart two are, and which way leads from one to another."""

import math

from drivers.errors import LimitError
from drivers.interfaces import Way

_TURN_DEG = 360.0


def wrapped_deg(angle_deg: float) -> float:
    """Return an angle, such as a difference of two, brought into [-180, 180) deg."""
    return (angle_deg + 180.0) % _TURN_DEG - 180.0


def distance_deg(a_deg: float, b_deg: float) -> float:
    """Return the angle between two directions [deg], in [0, 180]."""
    return abs(wrapped_deg(a_deg - b_deg))


def require_finite(angle_deg: float) -> float:
    """Return the angle unchanged if it is a finite number, else raise LimitError."""
    if not math.isfinite(angle_deg):
        raise LimitError(f"angle {angle_deg} deg: must be a finite number")
    return angle_deg


def route_deg(from_deg: float, angle_deg: float, *, way: Way, near_deg: float) -> float:
    """Return by how much to turn [deg] to get from one angle to another.

    Parameters
    ----------
    from_deg, angle_deg : float
        Any finite angles [deg].
    way : {"short", "forward", "backward"}
        Which way round.
    near_deg : float
        Angles that are as near as this are reached by the short way, whatever was asked for.
    """
    short_deg = wrapped_deg(angle_deg - from_deg)
    if abs(short_deg) <= near_deg or way == "short":
        return short_deg
    if way == "forward":
        return short_deg if short_deg > 0.0 else short_deg + _TURN_DEG
    return short_deg if short_deg < 0.0 else short_deg - _TURN_DEG


def target_within_deg(
    from_deg: float, angle_deg: float, *, way: Way, near_deg: float, lowest_deg: float, highest_deg: float
) -> float:
    """Return where to go on a scale that counts on through full turns [deg], within the limits of that scale.

    Parameters
    ----------
    from_deg : float
        Where the stage is on that scale.
    angle_deg : float
        Where it is to point; any finite angle.
    way, near_deg
        See `route_deg`. The short way gives in to the limits; a way that was asked for does not.
    lowest_deg, highest_deg : float
        The limits.

    Raises
    ------
    LimitError
        The limits do not let it point there, or not by that way.
    """
    target_deg = from_deg + route_deg(from_deg, angle_deg, way=way, near_deg=near_deg)
    if lowest_deg <= target_deg <= highest_deg:
        return target_deg
    turns = math.ceil((lowest_deg - target_deg) / _TURN_DEG) if target_deg < lowest_deg else 0
    turns = math.floor((highest_deg - target_deg) / _TURN_DEG) if target_deg > highest_deg else turns
    if way == "short" and lowest_deg <= target_deg + turns * _TURN_DEG <= highest_deg:
        return target_deg + turns * _TURN_DEG
    raise LimitError(
        f"angle {angle_deg:g} deg ({way} way) is outside of the stage's limits, {lowest_deg:g} to {highest_deg:g} deg"
    )
