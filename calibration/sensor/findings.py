"""Findings that speak against a calibration, each with its own name."""

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate, number_with_error, percent_with_error
from calibration.results import Flag
from calibration.sensor.curves import (
    BEND_LEVELS,
    QUANTISATION_LIMIT_DN2,
    SATURATED_FRACTION,
    DarkMatch,
    DarkSignal,
    PhotonTransfer,
    brighter_fatter,
    is_saturated,
    sample_ceiling_dn,
)
from calibration.sensor.judging import is_lamp_sweep
from calibration.sensor.levels import LevelStatistics, describe_level, level_names

# Findings in noise that neighbours, rows, columns or successive frames share, each by its own name

FloatArray = NDArray[np.float64]

_SIGMA = 5.0
# Spreading charge correlates the noise of neighbours by a per cent at most.
_CORRELATION, _FILTERED = 0.02, 0.1
# Dark noise is of the amplifiers: neighbours share none of it.
_DARK_CORRELATION = 0.05
# Lag of a detector leaves less than a per cent of a frame in the next.
_MEMORY = 0.03
_STEADY = 0.05
# Two readout channels differ by a per cent or two, pixels behind colour filters by tens.
_MOSAIC, _COLOURS = 0.03, 0.1
_SHARED_VARIANCE, _BANDED = 0.05, 0.01
_BRIGHT = 0.25


def row_column_flags(levels: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return what is odd in the noise of neighbours, and in the means of every second pixel."""
    found = (
        _correlated_noise(levels),
        _smoothed_darks(levels),
        _frames_go_together(levels),
        _colour_mosaic(levels),
        _row_noise(levels),
        _banded_light(levels),
    )
    return tuple(flag for flag in found if flag is not None)


def _bright_flats(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    """Return the flats below saturation in which photons make most of the noise."""
    flats = [v for v in levels if v.kind == "flat" and v.samples.max_fraction < SATURATED_FRACTION]
    darks = [level.mean_dn for level in levels if level.kind == "dark"]
    if not flats or not darks:
        return []
    dark_dn = float(np.mean(darks))
    limit_dn = _BRIGHT * (max(flat.mean_dn for flat in flats) - dark_dn)
    return [flat for flat in flats if flat.mean_dn - dark_dn >= limit_dn]


def _variance(level: LevelStatistics) -> float:
    # A level without noise is refused by another name.
    return level.temporal_variance_dn2 or 1.0


def _correlated_noise(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = _bright_flats(levels)
    if not flats:
        return None
    # What whole lines share is a finding of its own.
    horizontal = float(np.mean([v.row_column.horizontal - v.row_column.row_variance_dn2 / _variance(v) for v in flats]))
    vertical = float(np.mean([v.row_column.vertical - v.row_column.column_variance_dn2 / _variance(v) for v in flats]))
    error = float(np.mean([flat.row_column.std_error for flat in flats])) / np.sqrt(len(flats))
    largest = max(abs(horizontal), abs(vertical))
    if largest < _CORRELATION or largest < _SIGMA * error:
        return None
    return Flag(
        name="correlated_noise",
        message=f"the noise of neighbouring pixels goes together by {horizontal:+.3f} across and {vertical:+.3f} down "
        f"(at most {_CORRELATION} is expected): frames were filtered, interpolated from a colour mosaic, resized or "
        f"compressed with loss (JPEG), and the gain is too small by about twice their sum: switch noise reduction and "
        f"sharpening off, and save raw frames",
        refuses=largest > _FILTERED,
    )


def _smoothed_darks(levels: Sequence[LevelStatistics]) -> Flag | None:
    """Return a flag if dark noise, which a coder throws away first, is shared by neighbours."""
    darks = [v for v in levels if v.kind == "dark" and v.temporal_variance_dn2 > QUANTISATION_LIMIT_DN2]
    shares = [
        (
            one.row_column.horizontal - one.row_column.row_variance_dn2 / one.temporal_variance_dn2,
            one.row_column.vertical - one.row_column.column_variance_dn2 / one.temporal_variance_dn2,
            one.row_column.std_error,
        )
        for one in darks
    ]
    smoothed = [one for one in shares if max(abs(one[0]), abs(one[1])) > max(_DARK_CORRELATION, _SIGMA * one[2])]
    if not darks or len(smoothed) <= len(darks) // 2:
        return None
    horizontal, vertical = (float(np.median([one[axis] for one in shares])) for axis in (0, 1))
    return Flag(
        name="compressed_frames",
        message=f"the noise of neighbouring pixels of dark frames goes together by {horizontal:+.2f} along rows and "
        f"{vertical:+.2f} down columns (at most {_DARK_CORRELATION} either way is expected): frames were compressed "
        f"with loss or filtered, and the noise is not the sensor's: save raw frames, without noise reduction",
        refuses=True,
    )


def _frames_go_together(levels: Sequence[LevelStatistics]) -> Flag | None:
    # Rounding that hides the noise shows what is left of it in a few pixels only.
    noisy = [v for v in levels if v.temporal_variance_dn2 > QUANTISATION_LIMIT_DN2]
    # Light that changes shows the pixels' own response in every difference.
    steady = [v for v in noisy if np.ptp(v.frame_means_dn[:3]) < _STEADY * v.mean_dn]
    stacks = [v.lag for v in steady if v.lag is not None and v.samples.max_fraction < SATURATED_FRACTION]
    if not stacks:
        return None
    share = float(np.mean([lag.share for lag in stacks]))
    error = float(np.sqrt(np.sum([lag.std_error**2 for lag in stacks]))) / len(stacks)
    if share < _MEMORY or share < _SIGMA * error:
        return None
    return Flag(
        name="frames_go_together",
        message=f"the noise of a pixel goes together from one frame to the next by {share:+.3f} (at most {_MEMORY} is "
        f"expected): the camera averages frames in time (noise reduction), so that differences of frames show "
        f"{(1.0 - share) / (1.0 + share):.0%} of the noise, and the gain is too small by as much: switch noise "
        f"reduction off, and save raw frames",
        refuses=share > _FILTERED,
    )


def _colour_mosaic(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = _bright_flats(levels)
    darks = [level.mean_dn for level in levels if level.kind == "dark"]
    if not flats or not darks:
        return None
    flat = max(flats, key=lambda level: level.mean_dn)
    contrast = flat.mosaic_contrast * flat.mean_dn / (flat.mean_dn - float(np.mean(darks)))
    variance_dn2 = max(flat.spatial_variance_dn2, 0.0) + flat.temporal_variance_dn2 / flat.n_frames
    error = np.sqrt(variance_dn2 * 4.0 / flat.n_pixels) / flat.mean_dn
    if contrast < _MOSAIC or contrast < 2.0 * _SIGMA * error:
        return None
    return Flag(
        name="colour_mosaic",
        message=f"the four pixels of a 2 x 2 cell differ by {contrast:.0%} in their means, in even light (at most "
        f"{_MOSAIC:.0%} is expected): these are frames of a sensor behind a mosaic of colour or polarization filters, "
        f"and PRNU and saturation are those of the mixture: give the pixels of one colour (RAW files: --plane)",
        refuses=contrast > _COLOURS,
    )


def _row_noise(levels: Sequence[LevelStatistics]) -> Flag | None:
    darks = [level for level in levels if level.kind == "dark"]
    if not darks:
        return None
    variances = np.mean([_of_lines(level) for level in darks], axis=0)
    errors = np.mean([_errors_of_lines(level) for level in darks], axis=0)
    total = float(np.mean([level.temporal_variance_dn2 for level in darks]))
    shared = {
        line: float(np.sqrt(variance))
        for line, variance, error in zip(("row", "column"), variances, errors, strict=True)
        if variance > _SIGMA * error and variance > _SHARED_VARIANCE * total
    }
    if not shared:
        return None
    sizes = ", ".join(f"{size_dn:.2g} DN by {line}" for line, size_dn in shared.items())
    return Flag(
        name="row_noise",
        message=f"pixels of a line share noise that changes from frame to frame ({sizes}) in {level_names(darks)}: it "
        f"is in the read noise, whose standard error is then too small, and stripes will show in dim scenes; better "
        f"supply and shielding, or a correction by masked pixels, lower it",
    )


def _of_lines(level: LevelStatistics) -> FloatArray:
    return np.array([level.row_column.row_variance_dn2, level.row_column.column_variance_dn2])


def _errors_of_lines(level: LevelStatistics) -> FloatArray:
    return np.array([level.row_column.row_std_error_dn2, level.row_column.column_std_error_dn2])


def _banded_light(levels: Sequence[LevelStatistics]) -> Flag | None:
    flats = _bright_flats(levels)
    if not flats:
        return None
    # Lines that share noise in the dark are a finding of its own.
    in_dark = np.mean([_of_lines(level) for level in levels if level.kind == "dark"], axis=0)
    shares = np.mean([(_of_lines(flat) - in_dark) / _variance(flat) for flat in flats], axis=0)
    errors = np.mean([_errors_of_lines(flat) / _variance(flat) for flat in flats], axis=0) / np.sqrt(len(flats))
    worst = int(np.argmax(shares))
    share = float(shares[worst])
    if share < _BANDED or share < _SIGMA * errors[worst]:
        return None
    return Flag(
        name="banded_light",
        message=f"{share:.1%} of the noise in time of bright flats is common to whole rows or columns (at most "
        f"{_BANDED:.0%} is expected): a lamp on alternating current lights the rows of a rolling shutter unevenly, and "
        f"the gain is too large by as much: use a lamp on direct current, or exposures of whole periods",
        refuses=share > _FILTERED,
    )


# Findings in the light of the levels that speak against a calibration, each by its own name

_STEP = 0.01
_STEP_SIGMA = 5.0
_MIXED_STEP = 0.1
# Whole frames of coarse counts differ by this by rounding alone; a level that wanders as all do is not mixed.
_ROUNDING_DN, _WANDER_OF_ALL = 0.3, 8.0
_FLICKER = 0.0015
_PROPORTIONAL = 0.1
_HALF = 0.5
_LEAST_EXPOSURES = 5
_BRIGHT_LEVEL_CHECKS = 0.2
_OUTLIER_FRACTION = 1e-5
_UNEVEN_SHARE = 0.25
_UNEVEN_SIGMA = 5.0


def level_flags(levels: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return what is odd in how frames of a level, and levels, differ."""
    found = (
        _swapped(levels),
        _unsteady(levels),
        _flicker(levels),
        _outlier_pixels(levels),
        _uneven_light(levels),
    )
    return tuple(flag for flag in found if flag is not None)


def light_course_flags(levels: Sequence[LevelStatistics], *, wrong: Sequence[LevelStatistics]) -> tuple[Flag, ...]:
    """Return what is odd in the course of the light from level to level."""
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
    bright = np.array([flat.mean_dn for flat in flats]) > _BRIGHT_LEVEL_CHECKS * max(flat.mean_dn for flat in flats)
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
    bright = signal > _BRIGHT_LEVEL_CHECKS * signal.max()
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


# Findings in the samples themselves that speak against a calibration, each by its own name

# The standard's own limit: more zeros than this in a dark frame and its lower half is cut off.
_ZERO_FRACTION = 0.005
_PILED_FRACTION = 0.5
_EIGHT_BITS = 255
_MISSING_CODES, _STRETCHED = 0.05, 0.5


def sample_flags(levels: Sequence[LevelStatistics], *, bit_depth: int) -> tuple[Flag, ...]:
    """Return what is wrong with the samples as integers."""
    ceiling_dn = sample_ceiling_dn(levels, bit_depth=bit_depth)
    found = (
        _left_justified(levels),
        _wrong_bit_depth(levels, bit_depth),
        _mixed_bit_depth(levels),
        _low_ceiling(levels, ceiling_dn, bit_depth),
        _clipped_black(levels),
        _repeated_frames(levels),
        _saturated_levels(levels, ceiling_dn),
        _saturated_dark(levels, ceiling_dn),
        _no_noise(levels, ceiling_dn),
        _missing_codes(levels),
    )
    return tuple(flag for flag in found if flag is not None)


def _used_bits(levels: Sequence[LevelStatistics]) -> int:
    return int(np.bitwise_or.reduce([level.samples.used_bits for level in levels]))


def _unused_low_bits(levels: Sequence[LevelStatistics]) -> int:
    used = _used_bits(levels)
    return (used & -used).bit_length() - 1 if used else 0


def _left_justified(levels: Sequence[LevelStatistics]) -> Flag | None:
    shift = _unused_low_bits(levels)
    if shift == 0:
        return None
    largest = max(level.samples.max_dn for level in levels)
    return Flag(
        name="left_justified",
        message=f"all samples are multiples of {2**shift}, up to {largest}: they are shifted to the left by {shift} "
        f"bits, and a gain from them would be {2**shift} times too large; samples have to be right-justified: "
        f"divide them by {2**shift} and state the camera's own bit depth",
        refuses=True,
    )


def _wrong_bit_depth(levels: Sequence[LevelStatistics], bit_depth: int) -> Flag | None:
    if _unused_low_bits(levels):
        return None
    full_scale = 2**bit_depth - 1
    largest = max(level.samples.max_dn for level in levels)
    if largest > full_scale:
        return Flag(
            name="wrong_bit_depth",
            message=f"the largest sample is {largest}, but {bit_depth} bits are stated, which allow {full_scale}; "
            f"state at least {largest.bit_length()} bits",
            refuses=True,
        )
    if largest > full_scale // 4:
        return None
    piled = any(level.samples.max_dn == largest and level.samples.max_fraction > SATURATED_FRACTION for level in levels)
    real_ceiling = piled and largest == 2 ** largest.bit_length() - 1
    reason = "where samples pile up" if real_ceiling else "less than a quarter of what they allow"
    return Flag(
        name="wrong_bit_depth",
        message=f"{bit_depth} bits are stated, but the largest sample is {largest}, {reason}; saturated pixels would "
        f"go unseen: state the camera's own bit depth (these samples fit into {largest.bit_length()} bits)"
        + ("" if real_ceiling else ", or take brighter flats"),
        refuses=real_ceiling,
    )


def _of_fewer_bits(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    """Return flats most of whose samples are at full scale of fewer bits than others have."""
    largest = max(level.samples.max_dn for level in levels)
    return [
        level
        for level in levels
        if level.kind == "flat"
        and level.samples.max_fraction > _PILED_FRACTION
        and _EIGHT_BITS <= level.samples.max_dn < largest
        and level.samples.max_dn & (level.samples.max_dn + 1) == 0
    ]


def _mixed_bit_depth(levels: Sequence[LevelStatistics]) -> Flag | None:
    cut = _of_fewer_bits(levels)
    if not cut:
        return None
    bits, largest = cut[0].samples.max_dn.bit_length(), max(level.samples.max_dn for level in levels)
    return Flag(
        name="mixed_bit_depth",
        message=f"most samples are {cut[0].samples.max_dn}, full scale of {bits} bits, in {level_names(cut)}, while "
        f"others reach {largest}: some of the files were saved with {bits} bits and the others with more: save all "
        f"frames with the camera's own",
        refuses=True,
    )


def _clipped_black(levels: Sequence[LevelStatistics]) -> Flag | None:
    clipped = [v for v in levels if v.kind == "dark" and v.samples.zero_fraction > _ZERO_FRACTION]
    if not clipped:
        return None
    share = max(level.samples.zero_fraction for level in clipped)
    return Flag(
        name="clipped_black",
        message=f"up to {share:.2%} of the samples of dark frames are 0 in {level_names(clipped)}; at most "
        f"{_ZERO_FRACTION:.1%} may be, else the noise below black is cut off: raise the camera's black level "
        f"(offset) and take the frames again",
        refuses=True,
    )


def _rounding_hides_noise(level: LevelStatistics) -> bool:
    """Return whether pixels differ so little, in space and time, that rounding may make all frames the same."""
    return level.spatial_variance_dn2 + level.temporal_variance_dn2 < QUANTISATION_LIMIT_DN2


def _repeated_frames(levels: Sequence[LevelStatistics]) -> Flag | None:
    # Where most samples are at one ceiling, or rounding hides all noise, two frames may well be the same.
    varied = [v for v in levels if v.samples.max_fraction < _PILED_FRACTION and not _rounding_hides_noise(v)]
    counts = Counter(digest for level in varied for digest in level.samples.digests)
    repeated = {digest for digest, count in counts.items() if count > 1}
    if not repeated:
        return None
    touched = [level for level in varied if repeated.intersection(level.samples.digests)]
    return Flag(
        name="repeated_frames",
        message=f"frames are copies of another one, bit by bit ({sum(counts[d] - 1 for d in repeated)} of them), in "
        f"{level_names(touched)}; two frames of a sensor never are: the same buffer was saved twice, or a file is "
        f"listed twice; take these frames again",
        refuses=True,
    )


def _low_ceiling(levels: Sequence[LevelStatistics], ceiling_dn: int, bit_depth: int) -> Flag | None:
    full_scale = 2**bit_depth - 1
    if not full_scale // 4 < ceiling_dn < full_scale or _unused_low_bits(levels):
        return None
    return Flag(
        name="low_ceiling",
        message=f"samples pile up at {ceiling_dn} DN, below the {full_scale} DN that {bit_depth} bits allow: that is "
        f"where this camera saturates (it takes its black level off, or its firmware stops there), and it is taken so "
        f"here; pixels of scenes count as saturated at full scale only: keep them below {ceiling_dn} DN, "
        f"or say `rigctl import --saturation-dn {ceiling_dn}`",
    )


def _saturated_levels(levels: Sequence[LevelStatistics], ceiling_dn: int) -> Flag | None:
    saturated = [level for level in levels if level.kind == "flat" and is_saturated(level, ceiling_dn=ceiling_dn)]
    if not saturated:
        return None
    return Flag(
        name="saturated_levels",
        message=f"more than {SATURATED_FRACTION:.1%} of the samples are at the ceiling ({ceiling_dn} DN) in "
        f"{level_names(saturated)}; left out of the gain, they show where saturation is",
    )


def _saturated_dark(levels: Sequence[LevelStatistics], ceiling_dn: int) -> Flag | None:
    saturated = [level for level in levels if level.kind == "dark" and is_saturated(level, ceiling_dn=ceiling_dn)]
    if not saturated:
        return None
    return Flag(
        name="saturated_dark",
        message=f"more than {SATURATED_FRACTION:.1%} of the samples of dark frames are at the ceiling "
        f"({ceiling_dn} DN) in {level_names(saturated)}: light got in, or dark current fills the pixels; "
        f"cover the lens, or take shorter dark exposures",
        refuses=True,
    )


def _no_noise(levels: Sequence[LevelStatistics], ceiling_dn: int) -> Flag | None:
    # Above the flat of most noise the sensor saturates, perhaps at another value each exposure (black taken off).
    noisy = [level for level in levels if level.kind == "flat" and level.temporal_variance_dn2 > 0.0]
    peak_dn = max(noisy, key=lambda level: level.temporal_variance_dn2).mean_dn if noisy else np.inf
    silent = [
        level
        for level in levels
        if level.temporal_variance_dn2 == 0.0
        and not any(level is one for one in _of_fewer_bits(levels))
        and not (level.kind == "flat" and (is_saturated(level, ceiling_dn=ceiling_dn) or level.mean_dn > peak_dn))
        and not (level.kind == "dark" and _rounding_hides_noise(level))
    ]
    if not silent:
        return None
    return Flag(
        name="no_noise",
        message=f"no pixel changes from frame to frame in {level_names(silent)}; a sensor has noise: these are "
        f"computed pictures, or copies of one; give raw frames",
        refuses=True,
    )


def _missing_codes(levels: Sequence[LevelStatistics]) -> Flag | None:
    combed = [level for level in levels if level.samples.missing_codes > _MISSING_CODES]
    # One level may stand where a converter of its own has gaps.
    if len(combed) <= len(levels) // 2 or _unused_low_bits(levels):
        return None
    share = float(np.median([level.samples.missing_codes for level in combed]))
    return Flag(
        name="missing_codes",
        message=f"{share:.0%} of the values amid the others never occur: samples were multiplied, or passed through a "
        f"table, after the converter (digital gain, gamma, a change of bits), so that rounding makes more noise than "
        f"1/12 DN^2, and a gain in these counts is not the converter's: switch digital gain, gamma and tone mapping "
        f"off, and save samples with the bits that the converter has (not stretched to 16)",
        refuses=share > _STRETCHED,
    )


# Findings in dark signal and photon-transfer curve that speak against a calibration, each by its own name

# A curve that is off its own first slope by so much is no photon noise of a linear sensor.
_NO_LINE = 0.3
# Beyond saturation the mean grows by little; a curve whose variance falls while the mean goes on is a tone curve.
_BEYOND_SATURATION = 1.5
_BEND = 0.02
_BEND_SIGMA = 3.0
_LEFT_SIGMA = 2.0
_SCATTER = 0.005
_NOT_LINEAR = 0.01
_LAMP = 0.01
_SCATTER_CHI2_PER_DOF = 3.0
_CLAMP_SIGMA = 5.0


def curve_flags(
    flats: Sequence[LevelStatistics], transfer: PhotonTransfer, dark: DarkSignal, match: DarkMatch
) -> tuple[Flag, ...]:
    """Return what is odd in the fits."""
    found = (
        _not_photon_noise(transfer),
        _too_few_levels(transfer),
        _saturation_not_reached(flats, transfer),
        _bent(transfer),
        _scattered(transfer),
        _not_linear(transfer),
        _unsteady_lamp(transfer),
        _uncovered(flats, transfer, match),
        _single_dark_exposure(dark),
        _dark_current_changed(dark),
        _quantisation_limited(transfer, dark),
        _black_clamp(transfer, dark),
    )
    return tuple(flag for flag in found if flag is not None)


def _relative_bend(transfer: PhotonTransfer) -> float:
    """Return by which share the curve departs from its first slope, at the brightest point of the fit."""
    top_dn = transfer.top_dn
    return (transfer.bend + transfer.cubic * top_dn) * top_dn / transfer.gain_dn_per_e


def _relative_bend_error(transfer: PhotonTransfer) -> float:
    """Return the standard error of the bend at the brightest point of the fit."""
    top_dn = transfer.top_dn
    gradient = top_dn ** np.arange(1, len(transfer.fit.parameters))
    own = gradient @ transfer.fit.covariance[1:, 1:] @ gradient
    return float(np.sqrt(own)) / transfer.gain_dn_per_e


def _not_photon_noise(transfer: PhotonTransfer) -> Flag | None:
    bend = abs(_relative_bend(transfer))
    is_line = transfer.gain_dn_per_e > 0.0 and (bend < _NO_LINE or bend < _BEND_SIGMA * _relative_bend_error(transfer))
    if is_line and not _falls_early(transfer):
        return None
    signal, variance = transfer.points.signal_dn, transfer.points.variance_dn2
    first, last = np.flatnonzero(transfer.used if not is_line else ~transfer.points.saturated)[[0, -1]]
    return Flag(
        name="not_photon_noise",
        message=f"the temporal variance goes from {variance[first]:.4g} to {variance[last]:.4g} DN^2 while the signal "
        f"goes from {signal[first]:.4g} to {signal[last]:.4g} DN; photon noise grows in proportion to the signal: "
        f"switch gamma, tone mapping, noise reduction and compression off, and check kinds and exposures",
        refuses=True,
    )


def _falls_early(transfer: PhotonTransfer) -> bool:
    """Return whether the variance is largest at a signal far below others that are not saturated."""
    peak, open_ = transfer.saturation, transfer.points.signal_dn[~transfer.points.saturated]
    return peak is not None and float(open_.max()) > _BEYOND_SATURATION * transfer.points.signal_dn[peak.upper]


def _too_few_levels(transfer: PhotonTransfer) -> Flag | None:
    n_used = int(np.count_nonzero(transfer.used))
    if n_used >= BEND_LEVELS:
        return None
    return Flag(
        name="too_few_levels",
        message=f"{n_used} of {len(transfer.used)} flat levels can be used for the gain; with fewer than {BEND_LEVELS} "
        f"neither bend nor scatter of the photon-transfer curve is seen, and a sensor that is not linear has a "
        f"larger error than stated: take 10 levels or more between dark and 80 % of saturation",
    )


def _saturation_not_reached(flats: Sequence[LevelStatistics], transfer: PhotonTransfer) -> Flag | None:
    if transfer.saturation is not None:
        return None
    more = "go on with a brighter lamp" if is_lamp_sweep(flats) else "add longer exposures"
    return Flag(
        name="saturation_not_reached",
        message=f"no rise and fall of the temporal variance is seen up to the brightest level "
        f"({transfer.points.signal_dn.max():.4g} DN above dark), so saturation is not known: {more}, "
        f"until most of the picture is saturated",
    )


def _bent(transfer: PhotonTransfer) -> Flag | None:
    bend = _relative_bend(transfer)
    if abs(bend) < _BEND or abs(bend) < _BEND_SIGMA * _relative_bend_error(transfer):
        return None
    return Flag(
        name="bent_photon_transfer",
        message=f"at {transfer.top_dn:.4g} DN the photon-transfer curve is {bend:+.1%} off its slope at no signal "
        f"(more than {_BEND:.0%} and than noise): {_cause(transfer)}; the gain given is the one at no signal, and "
        f"noise predicted for bright scenes is off by as much",
    )


def _cause(transfer: PhotonTransfer) -> str:
    """Return what bends the curve, as far as its direction and the response of the sensor tell."""
    spreading, curve = brighter_fatter(transfer), transfer.linearity
    rises = _relative_bend(transfer) > 0.0
    if spreading is None or curve is None:
        # Charge that spreads between pixels only ever takes variance away.
        return (
            "the response is not linear (digital corrections, gamma), or light or gain changed within levels"
            if rises
            else "the sensor is not linear, or charge spreads between pixels"
        )
    top_dn = transfer.top_dn
    response = (curve.quadratic_per_dn + curve.cubic_per_dn2 * top_dn) * top_dn
    found = f"mean against {curve.light} is {response:+.2%} off its line there"
    left = f"{percent_with_error(spreading.value, spreading.std_error)}"
    if abs(spreading.value) < _LEFT_SIGMA * spreading.std_error:
        return f"{found}, and what that does not explain ({left}) is within its error"
    if spreading.value > 0.0:
        return f"{found}, and {left} more is left that no spreading of charge makes: another noise grows with the light"
    return f"{found}, and {left} is left for charge that spreads between pixels"


def _scattered(transfer: PhotonTransfer) -> Flag | None:
    scatter, chi2_per_dof = transfer.fit.scatter / abs(transfer.gain_dn_per_e), transfer.fit.chi2_per_dof
    if chi2_per_dof is None or chi2_per_dof < _SCATTER_CHI2_PER_DOF or scatter < _SCATTER:
        return None
    return Flag(
        name="scattered_photon_transfer",
        message=f"the points scatter by {scatter:.1%} about the photon-transfer curve, more than their sampling "
        f"explains (chi-squared {chi2_per_dof:.3g} per degree of freedom); the standard errors hold it: more "
        f"exposures make the gain better, more frames at each do not",
    )


def _not_linear(transfer: PhotonTransfer) -> Flag | None:
    curve = transfer.linearity
    if curve is None:
        return None
    top_dn = transfer.top_dn
    off = (curve.quadratic_per_dn + curve.cubic_per_dn2 * top_dn) * top_dn
    gradient = np.array([top_dn, top_dn**2])
    error = float(np.sqrt(gradient @ curve.covariance @ gradient))
    if abs(off) < _NOT_LINEAR or abs(off) < _BEND_SIGMA * error:
        return None
    return Flag(
        name="response_not_linear",
        message=f"at {top_dn:.4g} DN the mean is {percent_with_error(off, error)} off its slope at no signal (more "
        f"than {_NOT_LINEAR:.0%}): radiances of bright scenes are off by as much; the response is in the calibration, "
        f"or expose so that scenes stay below {_NOT_LINEAR / abs(off) * top_dn:.0f} DN",
    )


def _unsteady_lamp(transfer: PhotonTransfer) -> Flag | None:
    curve = transfer.linearity
    if curve is None or curve.relative_scatter < _LAMP:
        return None
    return Flag(
        name="unsteady_lamp",
        message=f"the means of the levels scatter by {curve.relative_scatter:.1%} about a smooth response to the "
        f"{curve.light} (more than {_LAMP:.0%}): the lamp flickers or drifts between levels, or exposures are not "
        f"exact; the gain stands, with a larger error since the response is known less well: let the lamp warm up",
    )


def _uncovered(flats: Sequence[LevelStatistics], transfer: PhotonTransfer, match: DarkMatch) -> Flag | None:
    uncovered = [flats[index] for index in np.flatnonzero(transfer.used & ~match.covered).tolist()]
    if not uncovered:
        return None
    return Flag(
        name="dark_exposure_missing",
        message=f"there are no dark frames around the exposure of "
        f"{level_names(uncovered)}; those of the nearest exposure were taken, and the difference in dark current "
        f"counts as signal: take dark frames at the exposures of the flats, or at the shortest and the longest",
    )


def _single_dark_exposure(dark: DarkSignal) -> Flag | None:
    if dark.has_slope or dark.is_curved:
        return None
    return Flag(
        name="single_dark_exposure",
        message="dark frames have one exposure, or exposures are not known: there is no dark current, and what it adds "
        "within this exposure counts as black level and read noise; take dark frames at two or more exposures, the "
        "longest as long as it may be",
    )


def _dark_current_changed(dark: DarkSignal) -> Flag | None:
    if not dark.is_curved:
        return None
    bend, error = float(dark.mean_fit.parameters[2]), float(np.sqrt(dark.mean_fit.covariance[2, 2]))
    return Flag(
        name="dark_current_changed",
        message=f"the mean of dark frames is no straight line of their exposure ("
        f"{number_with_error(bend, error, sign='+')} DN/s^2): "
        f"the sensor warmed up or cooled down while they were taken, or light got in: the dark current is not known, "
        f"black level and read noise are those of a curve: let the camera warm up for half an hour, and take the dark "
        f"frames in mixed order",
    )


def _quantisation_limited(transfer: PhotonTransfer, dark: DarkSignal) -> Flag | None:
    if not dark.quantisation_limited:
        return None
    limit_dn = np.sqrt(QUANTISATION_LIMIT_DN2)
    return Flag(
        name="quantisation_limited",
        message=f"the temporal noise of dark frames is below {limit_dn:.2f} DN, where rounding to whole counts hides "
        f"it: the read noise is only known to be below {limit_dn / abs(transfer.gain_dn_per_e):.3g} e-; raise the "
        f"camera's gain to measure it",
    )


def _black_clamp(transfer: PhotonTransfer, dark: DarkSignal) -> Flag | None:
    fit = dark.variance_fit
    if fit is None or not dark.has_slope:
        return None
    by_mean, by_variance = dark.mean_fit.parameters[1], fit.parameters[1] / transfer.gain_dn_per_e
    error = np.hypot(np.sqrt(dark.mean_fit.covariance[1, 1]), np.sqrt(fit.covariance[1, 1]) / transfer.gain_dn_per_e)
    if abs(by_mean - by_variance) < _CLAMP_SIGMA * error:
        return None
    return Flag(
        name="black_clamp",
        message=f"with exposure the mean of dark frames grows by {by_mean:.4g} DN/s, their variance says "
        f"{by_variance:.4g} DN/s (difference more than {_CLAMP_SIGMA:.0f} standard errors): the camera takes dark "
        f"signal off by itself, or dark frames were not dark; the dark current given is that of the mean",
    )


# Findings in the parameters themselves: numbers that no sensor has, each by its own name


def parameter_flags(*, dark_current_e_per_s: Estimate | None, quantum_efficiency: Estimate | None) -> tuple[Flag, ...]:
    """Return what is odd in the parameters."""
    found = (_negative(dark_current_e_per_s), _too_efficient(quantum_efficiency))
    return tuple(flag for flag in found if flag is not None)


def _negative(found: Estimate | None) -> Flag | None:
    if found is None or found.value > -_SIGMA * found.std_error:
        return None
    return Flag(
        name="negative_dark_current",
        message=f"the dark mean falls with exposure, by "
        f"{number_with_error(-found.value, found.std_error)} e-/s: the camera "
        f"takes off more than its dark signal, its black level drifts, or exposures are mixed up; see the dark "
        f"current by variance",
    )


def _too_efficient(found: Estimate | None) -> Flag | None:
    if found is None or found.value - _SIGMA * found.std_error < 1.0:
        return None
    return Flag(
        name="quantum_efficiency_above_one",
        message=f"there are "
        f"{number_with_error(found.value, found.std_error)} electrons a photon, of which there can be one "
        f"at most: the photons are not those of one pixel and one exposure, or irradiance or pixel area are wrong",
    )
