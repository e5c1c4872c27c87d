"""Plausibility of exposures: the unit that they are stated in, and what a dark current says of it."""

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.estimate import Estimate
from calibration.flags import Flag
from calibration.sensor.frame_statistics import LevelStatistics

# Whole sweeps are neither shorter than this nor longer [s].
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0
# Longest exposures of sweeps by usual cameras begin here [s]; shorter ones need a light that few have.
_USUAL_S = 5e-5
# Warm cameras for visible light have tens to thousands of electrons a second.
ABSURD_E_PER_S = 1e5
# Without cooling less is rare, and more is of hot or infrared sensors [e-/s].
_COOLED_E_PER_S, _HOT_E_PER_S = 0.1, 5e3
_SIGMA = 5.0
_BOUND_SIGMA = 3.0
# Units by what `--exposure-unit` calls them: seconds in each, and their names.
_UNITS = {
    "ns": (1e-9, "nanoseconds"),
    "us": (1e-6, "microseconds"),
    "ms": (1e-3, "milliseconds"),
    "s": (1.0, "seconds"),
}


@dataclass(frozen=True, kw_only=True)
class StatedExposures:
    """Place where exposures are stated, and the unit that they were read in.

    Attributes
    ----------
    where : str
        Such as "the column exposure_ms".
    unit : str or None
        ns, us, ms or s; None where it is not one for all.
    has_option : bool
        Whether --exposure-unit states another; otherwise what is stated has to be corrected.
    """

    where: str = "what was given"
    unit: str | None = None
    has_option: bool = True


_ANYWHERE = StatedExposures()


def impossible_exposures(levels: Sequence[LevelStatistics], *, stated: StatedExposures = _ANYWHERE) -> tuple[Flag, ...]:
    """Return a refusing flag if no camera's sweep has such exposures.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    stated : StatedExposures
        Where their exposures are from.
    """
    longest_s = _longest_s(levels)
    if longest_s is None or _SHORTEST_S <= longest_s <= _LONGEST_S:
        return ()
    return (
        Flag(
            name="wrong_time_unit",
            message=f"the longest exposure is {longest_s:.3g} s, no camera's sweep: exposures are stated in another "
            f"unit than {_as_read(stated)}: {_advice(longest_s, stated)}",
            refuses=True,
        ),
    )


def is_absurd(dark_current_e_per_s: Estimate | None) -> bool:
    """Return whether a dark current, or all that is known of it, is beyond any camera's for visible light."""
    if dark_current_e_per_s is None:
        return False
    found = dark_current_e_per_s
    return abs(found.value) + _BOUND_SIGMA * found.std_error > ABSURD_E_PER_S


def implausible_unit(
    levels: Sequence[LevelStatistics], dark_current_e_per_s: Estimate | None, *, stated: StatedExposures = _ANYWHERE
) -> tuple[Flag, ...]:
    """Return a flag if exposures are unusual and the dark current that they give is no camera's.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    dark_current_e_per_s : Estimate or None
        By the dark mean, as these exposures have it.
    stated : StatedExposures
        Where their exposures are from.
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
            f"{_as_read(stated)}"
            + (", or light reached the dark frames" if resolved else "")
            + f"; the dark current is not known until the unit is: {_advice(longest_s, stated)}",
        ),
    )


def unusual_dark_current(
    dark_current_e_per_s: Estimate | None, *, stated: StatedExposures = _ANYWHERE
) -> tuple[Flag, ...]:
    """Return a flag if a dark current is one of other cameras than usual, as exposures in another unit make it.

    Parameters
    ----------
    dark_current_e_per_s : Estimate or None
        By the dark mean, as these exposures have it.
    stated : StatedExposures
        Where their exposures are from.
    """
    if dark_current_e_per_s is None:
        return ()
    found, reach = dark_current_e_per_s, _BOUND_SIGMA * dark_current_e_per_s.std_error
    most, least = max(found.value, 0.0) + reach, found.value - reach
    if most < _COOLED_E_PER_S and least > -_COOLED_E_PER_S:
        what = f"below {most:.2g} e-/s, as of cooled sensors, or of cameras that take their own dark signal off"
        return (_unusual(what, "shorter", _beside(stated, -1)),)
    if least > _HOT_E_PER_S:
        return (_unusual(f"above {least:.2g} e-/s, as of hot or infrared sensors", "longer", _beside(stated, 1)),)
    return ()


def _unusual(what: str, true_is: str, advice: str) -> Flag:
    return Flag(
        name="unusual_dark_current",
        message=f"the dark current is {what}: if this camera is none of them, its exposures are {true_is} than stated, "
        f"by a wrong unit: {advice}",
    )


def _beside(stated: StatedExposures, step: int) -> str:
    """Return how to state the next larger or smaller unit."""
    units = list(_UNITS)
    place = -1 if stated.unit is None else units.index(stated.unit) + step
    if not stated.has_option or (stated.unit is not None and place not in range(len(units))):
        return f"correct {stated.where}"
    if stated.unit is None:
        return f"look at {stated.where}, or state it with --exposure-unit"
    return f"if {_UNITS[units[place]][1]} stand in {stated.where}, state the unit with --exposure-unit {units[place]}"


def _longest_s(levels: Sequence[LevelStatistics]) -> float | None:
    return max((level.exposure_s for level in levels if level.exposure_s is not None), default=None)


def _as_read(stated: StatedExposures) -> str:
    """Return the unit that exposures were read in, in words."""
    if stated.unit is None:
        return f"was read from {stated.where}"
    return f"the {_UNITS[stated.unit][1]} that were read from {stated.where}"


def _advice(longest_s: float, stated: StatedExposures) -> str:
    if not stated.has_option:
        return f"correct {stated.where}"
    others = [unit for unit in _UNITS if unit != stated.unit]
    likely = _likely_unit(longest_s, stated.unit)
    if stated.unit is None or likely is None:
        return f"state its unit with --exposure-unit {', '.join(others[:-1])} or {others[-1]}"
    seconds, name = _UNITS[likely]
    in_it_s = longest_s * seconds / _UNITS[stated.unit][0]
    return (
        f"if {name} stand in {stated.where}, it is {in_it_s:.3g} s, as usual: state the unit with "
        f"--exposure-unit {likely}"
    )


def _likely_unit(longest_s: float, unit: str | None) -> str | None:
    """Return the nearest unit in which unusual exposures are usual; None where no unit or each of two may be it."""
    if unit is None or _USUAL_S <= longest_s <= _LONGEST_S:
        return None
    by_nearness = sorted(
        _UNITS, key=lambda one: max(_UNITS[one][0] / _UNITS[unit][0], _UNITS[unit][0] / _UNITS[one][0])
    )
    usual = (one for one in by_nearness if _USUAL_S <= longest_s * _UNITS[one][0] / _UNITS[unit][0] <= _LONGEST_S)
    return next(usual, None)
