"""The pass of `maps` over counts, compiled by numba: one thread, an arctangent of its own."""

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]

# Frames that are taken at once, and pixels of a block where that takes more than one pass: their sums stay in the
# second-level cache.
GROUP = 4
_BLOCK = 16_384
# arctan(t) / t in powers of t^2 on [0, 1], through Chebyshev nodes of 8 terms: 6e-8 at most, as single precision.
_TERMS = 8
_NODES = 0.5 + 0.5 * np.cos(np.pi * (np.arange(_TERMS) + 0.5) / _TERMS)
_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7 = np.linalg.solve(
    np.vander(_NODES, increasing=True), np.arctan(np.sqrt(_NODES)) / np.sqrt(_NODES)
).astype(np.float32)
_ZERO, _HALF = np.float32(0.0), np.float32(0.5)
_QUARTER_PI, _HALF_PI, _PI = np.float32(np.pi / 4), np.float32(np.pi / 2), np.float32(np.pi)
_BELOW_PI: np.float32 = np.nextafter(_PI, _ZERO)
_TINY, _INFINITE = np.float32(1e-38), np.float32(np.inf)


def _half_argument_of(x: np.float32, y: np.float32) -> np.float32:
    """Return half of the argument of x + i y, in [0, pi)."""
    wide, high = abs(x), abs(y)
    long = wide if wide > high else high
    short = high if wide > high else wide
    ratio = short / (long + _TINY)
    square = ratio * ratio
    value = _C7
    value = value * square + _C6
    value = value * square + _C5
    value = value * square + _C4
    value = value * square + _C3
    value = value * square + _C2
    value = value * square + _C1
    value = value * square + _C0
    half: np.float32 = value * ratio * _HALF
    half = half if high <= wide else _QUARTER_PI - half
    half = half if x >= _ZERO else _HALF_PI - half
    half = half if y >= _ZERO else _PI - half
    return half if half < _BELOW_PI else _BELOW_PI


# Numba tells no types: its functions are bound to names that have them.
_half_argument: Callable[[np.float32, np.float32], np.float32] = numba.njit(
    inline="always", fastmath={"contract", "arcp", "nsz"}, error_model="numpy"
)(_half_argument_of)


def _add_group_of(
    frames: tuple[NDArray[np.uint16] | Float32Array, ...],
    weights: Float32Array,
    whole_dn: Float32Array,
    rest: Float32Array,
    begins: bool,
    ends: bool,
    planes: tuple[Float32Array, ...],
    valid: NDArray[np.bool_],
) -> None:
    """Add four frames to the Stokes parameters of a block; the last four give the other planes as well.

    Four at once, since each look at an array is checked against every array that is written: with more of them the
    compiler takes one pixel at a time.
    """
    first, second, third, fourth = frames
    s0, s1, s2, dolp, aolp_rad = planes
    for i in range(valid.size):
        a, b = np.float32(first[i]) - whole_dn[0], np.float32(second[i]) - whole_dn[1]
        c, d = np.float32(third[i]) - whole_dn[2], np.float32(fourth[i]) - whole_dn[3]
        x = -rest[0] if begins else s0[i]
        y = -rest[1] if begins else s1[i]
        z = -rest[2] if begins else s2[i]
        x += weights[0, 0] * a + weights[0, 1] * b + weights[0, 2] * c + weights[0, 3] * d
        y += weights[1, 0] * a + weights[1, 1] * b + weights[1, 2] * c + weights[1, 3] * d
        z += weights[2, 0] * a + weights[2, 1] * b + weights[2, 2] * c + weights[2, 3] * d
        s0[i], s1[i], s2[i] = x, y, z
        if ends:
            degree = np.sqrt(y * y + z * z) / x
            dolp[i], aolp_rad[i] = degree, _half_argument(y, z)
            valid[i] = (x > _ZERO) & (degree < _INFINITE)


_add_group: Callable[..., None] = numba.njit(nogil=True, fastmath={"contract", "arcp", "nsz"}, error_model="numpy")(
    _add_group_of
)


def _fill_maps(
    first: int,
    last: int,
    counts: NDArray[np.uint16] | Float32Array,
    weights: Float32Array,
    whole_dn: Float32Array,
    rest: Float32Array,
    planes: Float32Array,
    valid: NDArray[np.bool_],
) -> None:
    """Fill Stokes parameters, DoLP, AoLP and their validity."""
    final, step = counts.shape[0] - 1, max(last - first, 1) if counts.shape[0] <= GROUP else _BLOCK
    for start in range(first, last, step):
        stop = min(start + step, last)
        filled = (
            planes[0, start:stop],
            planes[1, start:stop],
            planes[2, start:stop],
            planes[3, start:stop],
            planes[4, start:stop],
        )
        for k in range(0, final + 1, GROUP):
            # Where frames are wanting the last one comes again, with no weight.
            frames = (
                counts[k, start:stop],
                counts[min(k + 1, final), start:stop],
                counts[min(k + 2, final), start:stop],
                counts[min(k + 3, final), start:stop],
            )
            group = slice(k, k + GROUP)
            ends = k + GROUP > final
            _add_group(frames, weights[:, group], whole_dn[group], rest, k == 0, ends, filled, valid[start:stop])


fill_maps: Callable[..., None] = numba.njit(
    cache=True, nogil=True, fastmath={"contract", "arcp", "nsz"}, error_model="numpy"
)(_fill_maps)
