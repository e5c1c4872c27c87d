"""The pass of `maps` over counts, compiled by numba: one thread, with its own arctangent."""

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
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_QUARTER_PI, _HALF_PI, _PI = np.float32(np.pi / 4), np.float32(np.pi / 2), np.float32(np.pi)
_BELOW_PI: np.float32 = np.nextafter(_PI, _ZERO)
_TINY, _INFINITE = np.float32(1e-38), np.float32(np.inf)
_FASTMATH = {"contract", "arcp", "nsz"}


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


# Numba has no types: its functions get typed names.
_half_argument: Callable[[np.float32, np.float32], np.float32] = numba.njit(
    inline="always", fastmath=_FASTMATH, error_model="numpy"
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

    Four at once, because the compiler checks every read array against every written one, and with more of them does not
    vectorise.
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


_add_group: Callable[..., None] = numba.njit(nogil=True, fastmath=_FASTMATH, error_model="numpy")(_add_group_of)


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
            # Missing frames are replaced by the last one with zero weight.
            frames = (
                counts[k, start:stop],
                counts[min(k + 1, final), start:stop],
                counts[min(k + 2, final), start:stop],
                counts[min(k + 3, final), start:stop],
            )
            group = slice(k, k + GROUP)
            ends = k + GROUP > final
            _add_group(frames, weights[:, group], whole_dn[group], rest, k == 0, ends, filled, valid[start:stop])


fill_maps: Callable[..., None] = numba.njit(cache=True, nogil=True, fastmath=_FASTMATH, error_model="numpy")(_fill_maps)


def _covariance_of(products: Float32Array, sigma: tuple[np.float32, ...]) -> tuple[np.float32, ...]:
    """Return the covariance of S0, S1, S2 (00, 11, 22, 01, 02, 12) from the deviations of four counts of a pixel."""
    a, b, c, d = sigma[0] * sigma[0], sigma[1] * sigma[1], sigma[2] * sigma[2], sigma[3] * sigma[3]
    return (
        products[0, 0] * a + products[0, 1] * b + products[0, 2] * c + products[0, 3] * d,
        products[1, 0] * a + products[1, 1] * b + products[1, 2] * c + products[1, 3] * d,
        products[2, 0] * a + products[2, 1] * b + products[2, 2] * c + products[2, 3] * d,
        products[3, 0] * a + products[3, 1] * b + products[3, 2] * c + products[3, 3] * d,
        products[4, 0] * a + products[4, 1] * b + products[4, 2] * c + products[4, 3] * d,
        products[5, 0] * a + products[5, 1] * b + products[5, 2] * c + products[5, 3] * d,
    )


def _deviations_of(
    stokes: tuple[np.float32, ...], dolp: np.float32, cov: tuple[np.float32, ...]
) -> tuple[np.float32, np.float32]:
    """Return the deviations of DoLP and AoLP of a pixel, by the formulas of `maps`."""
    s0, s1, s2 = stokes
    v00, v11, v22, v01, v02, v12 = cov
    length = dolp * s0
    # Divided first and chosen then: a division that depends on a condition is not vectorised.
    cosine, sine = s1 / length, s2 / length
    cosine, sine = cosine if length > _ZERO else _ONE, sine if length > _ZERO else _ZERO
    mixed = _TWO * v12 * cosine * sine
    along = v11 * cosine * cosine + v22 * sine * sine + mixed
    across = v11 * sine * sine + v22 * cosine * cosine - mixed
    along += dolp * (dolp * v00 - _TWO * (v01 * cosine + v02 * sine))
    along, across = along if along > _ZERO else _ZERO, across if across > _ZERO else _ZERO
    return np.sqrt(along) / s0, np.sqrt(across) / (_TWO * length)


_covariance: Callable[..., tuple[np.float32, ...]] = numba.njit(inline="always", fastmath=_FASTMATH)(_covariance_of)
_deviations: Callable[..., tuple[np.float32, np.float32]] = numba.njit(
    inline="always", fastmath=_FASTMATH, error_model="numpy"
)(_deviations_of)


def _fill_deviations(
    stokes: tuple[Float32Array, ...],
    dolp: Float32Array,
    products: Float32Array,
    sigma: tuple[Float32Array, ...],
    filled: tuple[Float32Array, ...],
) -> None:
    """Fill the deviations of DoLP and AoLP from those of four counts, each (P,), or (1,) for all pixels."""
    s0, s1, s2 = stokes
    dolp_std, angle_std = filled
    first, second, third, fourth = sigma
    cov = _covariance(products, (first[0], second[0], third[0], fourth[0]))
    if first.size == 1:
        for i in range(dolp.size):
            dolp_std[i], angle_std[i] = _deviations((s0[i], s1[i], s2[i]), dolp[i], cov)
    else:
        for i in range(dolp.size):
            cov = _covariance(products, (first[i], second[i], third[i], fourth[i]))
            dolp_std[i], angle_std[i] = _deviations((s0[i], s1[i], s2[i]), dolp[i], cov)


fill_deviations: Callable[..., None] = numba.njit(cache=True, nogil=True, fastmath=_FASTMATH, error_model="numpy")(
    _fill_deviations
)
