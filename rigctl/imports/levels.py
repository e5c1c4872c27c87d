"""A camera's bits by a histogram of counts: how they are justified, where they end, what is missing."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

LEVELS = 65536
_NEAR = 9
# How many pixels have to share a value before it is more than chance.
_SHARE_OF_PIXELS = 1e-3
_PIXELS = 20
_TIMES_ITS_NEIGHBOURS = 20
_NEAR_THE_TOP = 0.9
_LEVELS_OF_A_NOISY_IMAGE = 16
# Patterns are looked for in so many counts and more, where so many pixels fall on each; so many gaps are not chance.
_TRIMMED, _SPIKE = 0.02, 3.0
_TELLING_COUNTS, _PIXELS_A_COUNT, _LEAST_GAPS = 12, 30.0, 3


@dataclass(frozen=True, kw_only=True)
class Plateau:
    """A value that suspiciously many pixels share."""

    value_dn: int  #: The value.
    fraction: float  #: Share of pixels that have it.
    certain: bool  #: Nothing but saturation explains it.


def histogram(counts: NDArray[Any]) -> NDArray[np.int64]:
    """Return the number of pixels at each count from 0 to the largest up to 65535; fractions are rounded."""
    if counts.dtype != np.uint16:
        whole = np.rint(counts)
        counts = whole[(whole >= 0) & (whole < LEVELS)].astype(np.uint16)
    return np.bincount(counts.ravel(), minlength=1)


def common_zero_bits(levels: NDArray[np.int64]) -> int:
    """Return how many of the lowest bits are zero in every count; 0 where all counts are 0."""
    used = int(np.bitwise_or.reduce(np.flatnonzero(levels)))
    return (used & -used).bit_length() - 1 if used else 0


def largest(levels: NDArray[np.int64]) -> int:
    """Return the largest count that there is [DN]."""
    return int(np.flatnonzero(levels)[-1]) if levels.any() else 0


def saturation_plateau(levels: NDArray[np.int64], *, full_scale_dn: int) -> Plateau | None:
    """Return the plateau of saturated pixels below full scale, or None.

    More than 0.1 % of the pixels, and 20 or more, share the largest count; that is 20 times as many as any other
    count in the tenth below it has; and the image has noise (16 levels or more), so that it is not a drawing. It is
    certain where the largest count also lies above 90 % of full scale.
    """
    top = largest(levels)
    below = levels[int(_NEAR_THE_TOP * top) : top]
    shared = levels[top] >= _TIMES_ITS_NEIGHBOURS * below.max(initial=1)
    noisy = np.count_nonzero(levels) >= _LEVELS_OF_A_NOISY_IMAGE
    if top >= full_scale_dn or not (shared and noisy and _is_many(levels, top)):
        return None
    return Plateau(value_dn=top, fraction=_fraction(levels, top), certain=top > _NEAR_THE_TOP * full_scale_dn)


def missing_pixels(levels: NDArray[np.int64], *, black_level_dn: float | None) -> Plateau | None:
    """Return the plateau of pixels at 0 that cannot be dark, or None.

    More than 0.1 % of the pixels, and 20 or more, are 0, but not all; and none lies between 0 and half of the
    black level, or of 64 DN where that is not known. It is certain where the black level is known.
    """
    darkest = 64.0 if black_level_dn is None else black_level_dn
    gap = levels[1 : int(np.ceil(darkest / 2.0))]
    if not _is_many(levels, 0) or gap.size == 0 or gap.any() or largest(levels) == 0:
        return None
    return Plateau(value_dn=0, fraction=_fraction(levels, 0), certain=black_level_dn is not None)


def _is_many(levels: NDArray[np.int64], value_dn: int) -> bool:
    return bool(levels[value_dn] >= max(_PIXELS, _SHARE_OF_PIXELS * levels.sum()))


def _fraction(levels: NDArray[np.int64], value_dn: int) -> float:
    return float(levels[value_dn] / levels.sum())


def _lonely_ends(occupied: NDArray[np.intp], step: int) -> list[int]:
    """Return the lowest and the highest count where nothing is near: what a border holds, or where counts are cut."""
    if occupied.size < _TELLING_COUNTS:
        return []
    far = 2 * step
    low = [int(occupied[0])] if occupied[1] - occupied[0] > far else []
    return low + ([int(occupied[-1])] if occupied[-1] - occupied[-2] > far else [])


def odd_pattern(levels: NDArray[np.int64]) -> str:
    """Return a sentence if the histogram has steps or gaps that no camera makes, else an empty text.

    Only counts between the 2nd and the 98th percentile are used, in steps of the common zero bits, and only where so
    many pixels have each count that a missing count is not chance.
    """
    if not levels.any():
        return ""
    step = 1 << common_zero_bits(levels)
    # A border or a clipped sky is a spike, and not an end of the range.
    plain = np.minimum(levels, _SPIKE * np.median(levels[levels > 0]))
    plain[_lonely_ends(np.flatnonzero(levels), step)] = 0
    shares = np.cumsum(plain) / max(float(plain.sum()), 1.0)
    low, high = (int(np.searchsorted(shares, share)) for share in (_TRIMMED, 1.0 - _TRIMMED))
    low += -low % step
    counts = np.arange(low, high + 1, step)
    here = levels[counts]
    if counts.size < _TELLING_COUNTS or float(here.mean()) < _PIXELS_A_COUNT:
        return ""
    stuck = _stuck_bits(counts[here > 0], step)
    if stuck:
        return f"{' and '.join(stuck)} in every count from {low} to {high}: a bit is stuck, or was masked"
    gaps = counts[(here == 0) & (_usual_near(here) > _PIXELS_A_COUNT)]
    if gaps.size < _LEAST_GAPS:
        return ""
    first = ", ".join(str(gap) for gap in gaps[:3])
    return (
        f"{gaps.size} of {counts.size} counts from {low} to {high} never occur ({first}, ...): codes are missing, or "
        "counts were stretched or went through a table"
    )


def _usual_near(pixels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many pixels a count usually has among its nine neighbours: the second largest number of them."""
    padded = np.pad(pixels, _NEAR // 2, mode="symmetric")
    return np.asarray(np.sort(sliding_window_view(padded, _NEAR), axis=1)[:, -2])


def _stuck_bits(used: NDArray[np.int64], step: int) -> list[str]:
    """Return the bits that are the same in all counts though these span both of their values several times."""
    found = []
    span = int(used[-1] - used[0])
    for bit in range(step.bit_length() - 1, 16):
        if span < 4 << bit:
            break
        values = (used >> bit) & 1
        if np.all(values == values[0]):
            found.append(f"bit {bit} is {values[0]}")
    return found
