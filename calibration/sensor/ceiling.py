"""The value at which samples end: full scale of their bits, or a smaller one at which they pile up."""

from collections.abc import Sequence

from calibration.sensor.frame_statistics import LevelStatistics

# A level with more of its samples at the ceiling is saturated.
SATURATED_FRACTION = 1e-3
# Noise alone puts a few samples of a level at its largest value, or a few per mille where rounding is coarse.
_PILED_FRACTION = 0.5
_ALIKE_LEVELS = 2


def sample_ceiling_dn(levels: Sequence[LevelStatistics], *, bit_depth: int) -> int:
    """Return the value at which a saturated pixel stands [DN].

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels.
    bit_depth : int
        Bits per sample that are stated.

    Notes
    -----
    Full scale, unless no sample reaches it and flats end at a smaller value: one of them with half of its samples
    there, or two with 0.1 % each. A black level that is taken off after the converter does that, and some firmware.
    """
    full_scale_dn = (1 << bit_depth) - 1
    largest = max(level.samples.max_dn for level in levels)
    at_largest = [
        level.samples.max_fraction
        for level in levels
        if level.kind == "flat" and level.samples.max_dn == largest and level.samples.max_fraction > SATURATED_FRACTION
    ]
    if not at_largest or (max(at_largest) < _PILED_FRACTION and len(at_largest) < _ALIKE_LEVELS):
        return full_scale_dn
    return min(largest, full_scale_dn)


def is_saturated(level: LevelStatistics, *, ceiling_dn: int) -> bool:
    """Return whether more than 0.1 % of a level's samples stand at the ceiling [DN]."""
    return level.samples.max_dn >= ceiling_dn and level.samples.max_fraction > SATURATED_FRACTION
