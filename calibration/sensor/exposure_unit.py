"""Plausibility of exposures: the unit that they are stated in, and what a dark current says of it."""

from collections.abc import Sequence

from calibration.estimate import Estimate
from calibration.flags import Flag
from calibration.sensor.frame_statistics import LevelStatistics

# Whole sweeps are neither shorter than this nor longer [s].
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0
# Longest exposures of sweeps by usual cameras begin here [s]; shorter ones need a light that few have.
_USUAL_S = 5e-5
# Warm cameras for visible light have tens to thousands of electrons a second.
ABSURD_E_PER_S = 1e5
_SIGMA = 5.0
_BOUND_SIGMA = 3.0
_UNITS = {1e3: ("nanoseconds", "microseconds", "us"), 1e6: ("nanoseconds", "milliseconds", "ms")}


def impossible_exposures(levels: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return a refusing flag if no camera's sweep has such exposures.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    """
    longest_s = _longest_s(levels)
    if longest_s is None or _SHORTEST_S <= longest_s <= _LONGEST_S:
        return ()
    return (
        Flag(
            name="wrong_time_unit",
            message=f"the longest exposure is {longest_s:.3g} s, no camera's sweep: exposures are stated in another "
            f"unit than is wanted (a descriptor of EMVA 1288 wants nanoseconds, a run folder seconds): "
            f"{_advice(longest_s)}",
            refuses=True,
        ),
    )


def is_absurd(dark_current_e_per_s: Estimate | None) -> bool:
    """Return whether a dark current, or all that is known of it, is beyond any camera's for visible light."""
    if dark_current_e_per_s is None:
        return False
    found = dark_current_e_per_s
    return abs(found.value) + _BOUND_SIGMA * found.std_error > ABSURD_E_PER_S


def implausible_unit(levels: Sequence[LevelStatistics], dark_current_e_per_s: Estimate | None) -> tuple[Flag, ...]:
    """Return a flag if exposures are unusual and the dark current that they give is no camera's.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    dark_current_e_per_s : Estimate or None
        By the dark mean, as these exposures have it.
    """
    longest_s = _longest_s(levels)
    if longest_s is None or dark_current_e_per_s is None or not is_absurd(dark_current_e_per_s):
        return ()
    found = dark_current_e_per_s
    resolved = found.value - _SIGMA * found.std_error > ABSURD_E_PER_S
    if not resolved and longest_s > _USUAL_S:
        return ()
    what = (
        f"the dark signal grows as in no camera for visible light (more than {ABSURD_E_PER_S:.0e} e-/s)"
        if resolved
        else "with them the dark current could be more than any camera's"
    )
    return (
        Flag(
            name="wrong_time_unit",
            message=f"the longest exposure is {longest_s:.3g} s, and {what}: exposures are stated in another unit than "
            f"is wanted"
            + (", or light reached the dark frames" if resolved else "")
            + f"; the dark current is not known until the unit is: {_advice(longest_s)}",
        ),
    )


def _longest_s(levels: Sequence[LevelStatistics]) -> float | None:
    return max((level.exposure_s for level in levels if level.exposure_s is not None), default=None)


def _advice(longest_s: float) -> str:
    for factor, (wanted, likely, option) in _UNITS.items():
        if _USUAL_S <= longest_s * factor <= _LONGEST_S and longest_s < _USUAL_S:
            return (
                f"if {likely} were written where {wanted} are wanted, it is {longest_s * factor:.3g} s, as usual: "
                f"state it with --exposure-unit {option}"
            )
    return "state the unit with --exposure-unit ns, us, ms or s"
