"""The pass of `maps` over counts, compiled by numba: one thread, an arctangent of its own."""

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]

# Pixels of a block: its planes stay in the first-level cache.
_BLOCK = 1024
# arctan(t) / t in powers of t^2 on [0, 1], through Chebyshev nodes of 9 terms: 1.0e-8 at most, below single precision.
_TERMS = 9
_NODES = 0.5 + 0.5 * np.cos(np.pi * (np.arange(_TERMS) + 0.5) / _TERMS)
_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8 = np.linalg.solve(
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
    value = _C8
    value = value * square + _C7
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


def _fill_maps(
    first: int,
    last: int,
    counts: NDArray[np.uint16] | Float32Array,
    inverse: Float32Array,
    whole_dn: Float32Array,
    rest: Float32Array,
    s0: Float32Array,
    s1: Float32Array,
    s2: Float32Array,
    dolp: Float32Array,
    aolp_rad: Float32Array,
    valid: NDArray[np.bool_],
) -> None:
    """Fill Stokes parameters, DoLP, AoLP and their validity.

    Parameters
    ----------
    first, last
        The pixels that are filled: from `first` to before `last`.
    counts
        Shape (N, P), contiguous [DN].
    inverse
        Shape (3, N).
    whole_dn
        Whole counts that are taken off each frame, shape (N,) [DN].
    rest
        What is taken off S0, S1, S2 after that, shape (3,).
    s0, s1, s2, dolp, aolp_rad, valid
        Shape (P,), filled.
    """
    angles = counts.shape[0]
    for start in range(first, last, _BLOCK):
        size = min(_BLOCK, last - start)
        a, b, c = s0[start : start + size], s1[start : start + size], s2[start : start + size]
        d, e, good = dolp[start : start + size], aolp_rad[start : start + size], valid[start : start + size]
        for angle in range(angles):
            frame, level = counts[angle, start : start + size], whole_dn[angle]
            w0, w1, w2 = inverse[0, angle], inverse[1, angle], inverse[2, angle]
            # The first frame writes and the others add: no pass to clear the block before.
            if angle == 0:
                for i in range(size):
                    signal = np.float32(frame[i]) - level
                    a[i], b[i], c[i] = w0 * signal - rest[0], w1 * signal - rest[1], w2 * signal - rest[2]
            else:
                for i in range(size):
                    signal = np.float32(frame[i]) - level
                    a[i] += w0 * signal
                    b[i] += w1 * signal
                    c[i] += w2 * signal
        for i in range(size):
            d[i] = np.sqrt(b[i] * b[i] + c[i] * c[i]) / a[i]
        for i in range(size):
            e[i] = _half_argument(b[i], c[i])
        for i in range(size):
            good[i] = (a[i] > _ZERO) & (d[i] < _INFINITE)


fill_maps: Callable[..., None] = numba.njit(
    cache=True, nogil=True, fastmath={"contract", "arcp", "nsz"}, error_model="numpy"
)(_fill_maps)
