"""Brings a stage to an angle: it turns, reads back, and corrects itself until that is near enough."""

from collections.abc import Callable

from drivers.errors import LimitError
from drivers.interfaces import Move, StagePosition, Way
from drivers.stages.turning import distance_deg

_TRIES = 3


def approach(
    turn: Callable[[Way], StagePosition],
    angle_deg: float,
    *,
    way: Way,
    tolerance_deg: float,
    name: str,
    now_s: Callable[[], float],
    take_notes: Callable[[], tuple[str, ...]],
) -> Move:
    """Return the move once its readback lies within the tolerance; at most three turns are made.

    Parameters
    ----------
    turn : callable
        Turns to the angle by a way, waits for the end, and returns the readback.
    angle_deg : float
        Where to go [deg], finite.
    way : {"short", "forward", "backward"}
        Of the first turn; corrections go the short way.
    tolerance_deg : float
        How far the readback may lie from the angle [deg].
    name : str
        What messages call the stage.
    now_s : callable
        A clock that never goes back [s].
    take_notes : callable
        Returns the remarks for the move.

    Raises
    ------
    LimitError
        The readback stays further off than the tolerance.
    """
    start_s = now_s()
    for tries in range(1, _TRIES + 1):
        position = turn(way if tries == 1 else "short")
        if distance_deg(position.angle_deg, angle_deg) <= tolerance_deg:
            return Move(
                target_deg=angle_deg,
                position=position,
                tries=tries,
                duration_s=now_s() - start_s,
                remarks=take_notes(),
            )
    raise LimitError(
        f"{name}: sent to {angle_deg:g} deg {_TRIES} times, it stays at {position.angle_deg:.4f} deg, further off than "
        f"the tolerance of {tolerance_deg:g} deg. Clean its track and check its load, or allow more"
    )


def reachable_tolerance_deg(tolerance_deg: float, *, count_deg: float) -> float:
    """Return the tolerance unchanged if readbacks can keep to it [deg], else raise LimitError.

    Parameters
    ----------
    tolerance_deg : float
        Above half an encoder count and below 180 deg.
    count_deg : float
        One encoder count [deg].
    """
    half_count_deg = count_deg / 2.0
    if not half_count_deg < tolerance_deg < 180.0:
        raise LimitError(
            f"tolerance {tolerance_deg:g} deg: must be above half an encoder count, {half_count_deg:.3g} deg, "
            "and below 180 deg"
        )
    return tolerance_deg
