"""Findings in the samples themselves that speak against a calibration, each by its own name."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from calibration.flags import Flag
from calibration.sensor.ceiling import SATURATED_FRACTION, is_saturated, sample_ceiling_dn
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.level_names import level_names

# The standard's own limit: more zeros than this in a dark frame and its lower half is cut off.
_ZERO_FRACTION = 0.005
_PILED_FRACTION = 0.5
_EIGHT_BITS = 255
_MISSING_CODES, _STRETCHED = 0.05, 0.5


def sample_flags(levels: Sequence[LevelStatistics], *, bit_depth: int) -> tuple[Flag, ...]:
    """Return what is wrong with the samples as integers.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    bit_depth : int
        Bits per sample that are stated.
    """
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
