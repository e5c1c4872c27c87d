"""The chi-square distribution in closed form, to full relative accuracy in both tails."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.special_functions import erfcx, gamma, gammainccinv, gammaincinv

FloatArray = NDArray[np.float64]

_POLISHES = 2  # Newton steps; the start is good to 1e-8 or better in every release of SciPy
# Beyond so many degrees of freedom powers and factorials leave the range of a double: the start stays as it is.
_MOST_POLISHED = 200

_SERIES_TERMS = 30  # and two a degree of freedom: the last is below 1e-17 of the sum


def upper_quantile(probability: ArrayLike, degrees: int) -> FloatArray:
    """Return the value that a chi-square variable exceeds with this probability.

    Parameters
    ----------
    probability
        Any shape, in [0, 1]; 0 gives infinity, 1 gives 0.
    degrees
        Degrees of freedom, 1 or more.

    Raises
    ------
    ValueError
        If an argument is out of its range.

    Notes
    -----
    Accurate to rounding from 1e-300 to 1 - 1e-16: Newton's method on the logarithm of the probability, with
    the residual taken from the closed form; above 1/2 on the lower tail 1 - probability, which is exact there. Of more
    than 200 degrees of freedom to 1e-8.
    """
    p = np.asarray(probability, dtype=np.float64)
    if degrees < 1:
        raise ValueError(f"degrees is {degrees}; allowed is 1 or more")
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError(f"probability has values from {np.min(p)} to {np.max(p)}; allowed is 0 to 1")
    inside = (p > 0.0) & (p < 1.0)
    rare, common = inside & (p <= 0.5), inside & (p > 0.5)
    half = np.where(p == 0.0, np.inf, 0.0)
    if np.any(rare):
        half[rare] = _half_of_rare(p[rare], degrees)
    if np.any(common):
        half[common] = _half_of_common(p[common], degrees)
    return 2.0 * half


def _polishes(degrees: int) -> int:
    return _POLISHES if degrees <= _MOST_POLISHED else 0


def _scaled_tail(half: FloatArray, degrees: int) -> FloatArray:
    """Return exp(half) P(chi-square > 2 half): all terms are positive."""
    if degrees % 2:
        total, power, term = erfcx(np.sqrt(half)), 0.5, np.sqrt(half) / gamma(1.5)
    else:
        total, power, term = np.zeros_like(half), 0.0, np.ones_like(half)
    while power < 0.5 * degrees - 0.75:
        total = total + term
        power += 1.0
        term = term * half / power
    return np.asarray(total, dtype=np.float64)


def _density(half: FloatArray, degrees: int) -> FloatArray:
    """Return exp(half) times the density of the half."""
    return np.asarray(half ** (0.5 * degrees - 1.0) / gamma(0.5 * degrees), dtype=np.float64)


def _half_of_rare(p: FloatArray, degrees: int) -> FloatArray:
    half = np.asarray(gammainccinv(0.5 * degrees, p), dtype=np.float64)
    for _ in range(_polishes(degrees)):
        scaled = _scaled_tail(half, degrees)
        excess = (np.exp(-0.5 * half) / p) * (scaled * np.exp(-0.5 * half)) - 1.0
        half = half + np.log1p(excess) * scaled / _density(half, degrees)
    return half


def _half_of_common(p: FloatArray, degrees: int) -> FloatArray:
    q = 1.0 - p
    half = np.asarray(gammaincinv(0.5 * degrees, q), dtype=np.float64)
    for _ in range(_polishes(degrees)):
        scaled = _scaled_lower_tail(half, degrees)
        excess = np.exp(-half) * scaled / q - 1.0
        half = half * (1.0 - excess * scaled / (half * _density(half, degrees)))
    return half


def _scaled_lower_tail(half: FloatArray, degrees: int) -> FloatArray:
    """Return exp(half) P(chi-square <= 2 half) for a half below the median, by its power series."""
    order = 0.5 * degrees
    term = half**order / gamma(order + 1.0)
    total = term
    for k in range(1, _SERIES_TERMS + 2 * degrees):
        term = term * half / (order + k)
        total = total + term
    return np.asarray(total, dtype=np.float64)
