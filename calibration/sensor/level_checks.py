"""Findings in the light of the levels that speak against a calibration, each by its own name."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from calibration.flags import Flag
from calibration.sensor.ceiling import SATURATED_FRACTION
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.level_names import describe_level, level_names

_STEP = 0.01
_STEP_SIGMA = 5.0
_MIXED_STEP = 0.1
# Whole frames of coarse counts differ by this by rounding alone; a level that wanders as all do is not mixed.
_ROUNDING_DN, _WANDER_OF_ALL = 0.3, 8.0
_FLICKER = 0.0015
_PROPORTIONAL = 0.1
_HALF = 0.5
_LEAST_EXPOSURES = 5
_BRIGHT = 0.2
_OUTLIER_FRACTION = 1e-5
_UNEVEN_SHARE = 0.25
_UNEVEN_SIGMA = 5.0


def level_flags(levels: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return what is odd in how frames of a level, and levels, differ.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    """
    found = (
        _swapped(levels),
        _unsteady(levels),
        _flicker(levels),
        _outlier_pixels(levels),
        _uneven_light(levels),
    )
    return tuple(flag for flag in found if flag is not None)


def light_course_flags(levels: Sequence[LevelStatistics], *, wrong: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return what is odd in the course of the light from level to level.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    wrong : sequence of LevelStatistics
        Those of them whose exposure or light is known to be wrong.
    """
    others = [level for level in levels if not any(level is one for one in wrong)]
    found = (_non_monotonic(levels, wrong), _not_proportional(others))
    return tuple(flag for flag in found if flag is not None)


def _spread_dn(level: LevelStatistics) -> float:
    return max(level.frame_means_dn) - min(level.frame_means_dn)


def _step(level: LevelStatistics) -> float:
    """Return the spread of a level's frame means relative to its mean, 0 where noise or rounding explains it."""
    spread = _spread_dn(level)
    least = max(_STEP_SIGMA * np.sqrt(level.temporal_variance_dn2 / level.n_pixels), _ROUNDING_DN)
    return spread / level.mean_dn if spread > least else 0.0


def _all_wander(levels: Sequence[LevelStatistics], worst: LevelStatistics) -> bool:
    """Return whether other flats wander by as many counts, as in the beat of a lamp on alternating current."""
    flats = [v for v in levels if v.kind == "flat" and v.samples.max_fraction < SATURATED_FRACTION]
    if worst.kind == "dark" or len(flats) < _LEAST_EXPOSURES:
        return False
    return _spread_dn(worst) < _WANDER_OF_ALL * float(np.median([_spread_dn(flat) for flat in flats]))


def _swapped(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = [level.mean_dn for level in levels if level.kind == "flat"]
    darks = [level for level in levels if level.kind == "dark"]
    if not flats or not darks:
        return None
    brighter = [level for level in darks if level.mean_dn > np.median(flats)]
    if len(brighter) <= len(darks) // 2:
        return None
    return Flag(
        name="darks_brighter_than_flats",
        message=f"{len(brighter)} of {len(darks)} dark levels are brighter than the middle of the flats "
        f"({float(np.median(flats)):.4g} DN), such as {level_names(brighter[:1])}: dark and flat frames are mixed up, "
        f"or the lens was open: check which is which",
        refuses=True,
    )


def _unsteady(levels: Sequence[LevelStatistics]) -> Flag | None:
    unsteady = [level for level in levels if _step(level) > _STEP]
    if not unsteady:
        return None
    worst = max(_step(level) for level in unsteady)
    if worst > _MIXED_STEP and not _all_wander(levels, max(unsteady, key=_step)):
        return Flag(
            name="mixed_level",
            message=f"frames that should be alike differ by up to {worst:.1%} in their mean: {level_names(unsteady)}; "
            f"that is another exposure, gain or lamp setting and no flicker (at most {_MIXED_STEP:.0%}): "
            f"{_advice_on_mixing(unsteady)}",
            refuses=True,
        )
    return Flag(
        name="unsteady_level",
        message=f"frames that should be alike differ by up to {worst:.1%} in their mean (more than {_STEP:.0%} and "
        f"than noise): {level_names(unsteady)}; the gain does not suffer from flicker, black level and linearity may: "
        f"let lamp and camera warm up",
    )


def _advice_on_mixing(levels: Sequence[LevelStatistics]) -> str:
    if any(level.exposure_s is None for level in levels):
        return (
            "no exposure was recognised for them, so that frames of all exposures count as one level: write it in "
            "their names with its unit (flat_10ms_001.png, exp000522us), state that of bare numbers (exp000522) with "
            "--exposure-unit, or give a table (--table FILE.csv with the columns file, kind, exposure_ms)"
        )
    return "keep automatic exposure and gain off, and give frames of different light as different levels"


def _flicker(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = [v for v in levels if v.kind == "flat" and v.samples.max_fraction < SATURATED_FRACTION]
    if not flats:
        return None
    wander = [
        (float(np.var(flat.frame_means_dn, ddof=1)) - flat.temporal_variance_dn2 / flat.n_pixels) / flat.mean_dn**2
        for flat in flats
    ]
    noise = [flat.temporal_variance_dn2 / flat.n_pixels / flat.mean_dn**2 for flat in flats]
    # Next to no light, what wanders is the black level.
    bright = np.array([flat.mean_dn for flat in flats]) > _BRIGHT * max(flat.mean_dn for flat in flats)
    variance = float(np.mean(np.array(wander)[bright]))
    if variance < _FLICKER**2 or variance < _STEP_SIGMA * float(np.mean(np.array(noise)[bright])):
        return None
    return Flag(
        name="lamp_flicker",
        message=f"the light of flats wanders by {np.sqrt(variance):.2%} (rms) from frame to frame of a level, more "
        f"than {_FLICKER:.2%} and than noise: the gain does not suffer, since the mean of each difference is taken "
        f"off; the means, and with them linearity and quantum efficiency, are known less well: use a steadier lamp",
    )


def _non_monotonic(levels: Sequence[LevelStatistics], wrong: Sequence[LevelStatistics]) -> Flag | None:
    flats = [level for level in levels if level.kind == "flat" and level.exposure_s is not None]
    flats.sort(key=lambda level: (level.exposure_s or 0.0, level.mean_dn))
    drops = [
        after
        for before, after in pairwise(flats)
        if after.exposure_s != before.exposure_s and after.mean_dn < (1.0 - _STEP) * before.mean_dn
    ]
    if not drops:
        return None
    where, named = level_names(drops), wrong or [one for one in drops if _alone_is_dark(one, flats)]
    if wrong:
        where = f"that is by {level_names(wrong)}, which the others do not confirm"
    return Flag(
        name="non_monotonic_sweep",
        level=describe_level(named[0]) if named else None,
        message=f"the mean falls by more than {_STEP:.0%} although the exposure is longer: {where}; the "
        f"light changed during the sweep, or a frame has another exposure than stated: check lamp and shutter",
    )


def _alone_is_dark(level: LevelStatistics, flats: Sequence[LevelStatistics]) -> bool:
    """Return whether a flat is less than half as bright as both neighbours, which follow one another; by exposure."""
    place = next(index for index, one in enumerate(flats) if one is level)
    if not 0 < place < len(flats) - 1:
        return False
    before, after = flats[place - 1].mean_dn, flats[place + 1].mean_dn
    return level.mean_dn < _HALF * before < _HALF * after


def _below_saturation(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    """Return the flats that are neither at the ceiling nor above the one of largest variance."""
    flats = [v for v in levels if v.kind == "flat" and v.samples.max_fraction < SATURATED_FRACTION]
    peak = max(flats, key=lambda level: level.temporal_variance_dn2, default=None)
    return [flat for flat in flats if peak is None or flat.mean_dn <= peak.mean_dn]


def _not_proportional(levels: Sequence[LevelStatistics]) -> Flag | None:
    darks = [level.mean_dn for level in levels if level.kind == "dark"]
    flats = _below_saturation(levels)
    exposures = np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])
    if not darks or np.isnan(exposures).any() or len(np.unique(exposures)) < max(_LEAST_EXPOSURES, len(flats) // 2):
        return None
    signal = np.array([flat.mean_dn for flat in flats]) - float(np.mean(darks))
    if signal.min() <= 0.0:
        return None
    # Without the shortest exposures, which are often longer than stated by a fixed time, and which dark current bends.
    bright = signal > _BRIGHT * signal.max()
    if np.count_nonzero(bright) < _LEAST_EXPOSURES:
        return None
    rate = signal[bright] / exposures[bright]
    off = float(np.abs(rate / np.median(rate) - 1.0).max())
    if off < _PROPORTIONAL:
        return None
    return Flag(
        name="light_not_constant",
        message=f"the signal per exposure time differs by up to {off:.0%} between levels (at most "
        f"{_PROPORTIONAL:.0%} is expected of a sensor): the light changed, an automatic gain or exposure is on, or "
        f"exposures are not as "
        f"stated; the gain does not suffer from the light, its linearity is not known",
    )


def _outlier_pixels(levels: Sequence[LevelStatistics]) -> Flag | None:
    # Next to saturation only few pixels still change, which is no defect.
    levels = [v for v in levels if v.kind == "dark" or v.samples.max_fraction < SATURATED_FRACTION]
    n_all = [level.shape[0] * level.shape[1] for level in levels]
    shares = [1.0 - level.n_pixels / n for level, n in zip(levels, n_all, strict=True)]
    touched = [level for level, share in zip(levels, shares, strict=True) if share > _OUTLIER_FRACTION]
    if not touched:
        return None
    return Flag(
        name="outlier_pixels",
        message=f"up to {max(shares):.2g} of the pixels jump by more than 6 standard deviations between two frames of "
        f"{level_names(touched)} (cosmic hits, telegraph noise, defects); they are left out of these levels",
    )


def _uneven_light(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = [
        level
        for level in levels
        if level.kind == "flat" and level.spatial_variance_dn2 > _UNEVEN_SIGMA * level.spatial_std_error_dn2
    ]
    if not flats:
        return None
    # The level from which the fixed pattern is taken has the most frames; of those the brightest shows it best.
    level = max(flats, key=lambda flat: (flat.n_frames, flat.spatial_variance_dn2))
    share = 1.0 - level.small_scale_variance_dn2 / level.spatial_variance_dn2
    if share < _UNEVEN_SHARE:
        return None
    return Flag(
        name="uneven_light",
        message=f"{share:.0%} of the spatial variance of {describe_level(level)} is smooth across the picture (at most "
        f"{_UNEVEN_SHARE:.0%} is expected of pixels alone): uneven light of the lamp, or shading of the lens; it is "
        f"left out of the best PRNU, that of EMVA 1288 holds it: use an integrating sphere without lens",
    )
