"""The law of a count: a normal signal, rounded to a whole number and clipped at both ends of the range.

A camera adds photons, electrons of its readout and a black level, multiplies by its gain, rounds, and stores numbers
from 0 to full scale. Before rounding the sum is normal from about ten electrons on. This module alone treats rounding
and clipping: `rounded_moments` predicts mean and variance of counts from those of the signal, `estimate_signal`
estimates the signal from counts and tests the law.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.numerics import gammainc, ndtr

FloatArray = NDArray[np.float64]

# Variance of a rounding error, uniform over one count.
ROUNDING_VAR_DN2 = 1.0 / 12.0
# Noise that dithers the rounding: the mean shifts by less than 2e-5 counts.
DITHERED_DN = 0.7
# Harmonics of the periodic error: the last is 1e-16 for noise of a third of a step, and 1/40 of the first without
# noise.
_HARMONICS, _MANY = np.arange(1.0, 9.0), np.arange(1.0, 41.0)


def rounded_moments(
    level_dn: ArrayLike, var_dn2: ArrayLike, spread_dn2: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the shift of the mean by rounding, and the variance of the rounded signal.

    Parameters
    ----------
    level_dn
        Mean before rounding, black level included, because its place between two whole numbers matters.
    var_dn2
        Variance from frame to frame.
    spread_dn2
        Variance of the level over the averaged pixels, which also dithers.

    Returns
    -------
    shift_dn, variance_dn2
        The variance from frame to frame, averaged over the pixels: `var_dn2` + 1/12 if noise dithers.

    References
    ----------
    Sripad and Snyder (1977), IEEE Trans. Acoust. Speech Signal Process. 25, 442: the error of rounding is a sawtooth,
    whose Fourier series has closed means for normal signals.
    """
    level, var, spread = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (level_dn, var_dn2, spread_dn2)))
    turn, k = 2.0 * np.pi * level[..., None] * _HARMONICS, _HARMONICS
    fading = (-1.0) ** k * np.exp(-2.0 * (np.pi * k) ** 2 * (var + spread)[..., None])
    shift = np.sum(fading * np.sin(turn) / (np.pi * k), axis=-1)
    harmonics = np.sum(fading * np.cos(turn) * (4.0 * var[..., None] + (np.pi * k) ** -2.0), axis=-1)
    # Mean square of the pixels' shifts, from the first harmonic if they have a spread.
    own = np.exp(-4.0 * np.pi**2 * var) * (1.0 - np.exp(-8.0 * np.pi**2 * spread) * np.cos(2.0 * turn[..., 0]))
    squared = np.where(spread > 0.0, own / (2.0 * np.pi**2), shift**2)
    return shift, np.maximum(var + ROUNDING_VAR_DN2 + harmonics - squared, 0.0)


def rounding_error_rms(std_dn: ArrayLike) -> FloatArray:
    """Return the rms shift of a mean by rounding, over all places between two whole numbers.

    Widrow and Kollar, Quantization Noise (2008), chapter 4: the error is a sum of harmonics damped by noise.
    """
    damped = np.exp(-2.0 * (np.pi * _MANY * np.asarray(std_dn, dtype=np.float64)[..., None]) ** 2)
    return np.asarray(np.sqrt(0.5 * np.sum((damped / (np.pi * _MANY)) ** 2, axis=-1)))


@dataclass(frozen=True, kw_only=True, eq=False)
class SignalEstimate:
    """Mean of the signal behind counts, by maximum likelihood.

    Attributes
    ----------
    mean_dn, std_dn
        Of the signal before rounding and clipping.
    at_ends
        Share of the counts at each end of the range, shape (2,).
    misfit
        Chi-square of the shares of counts over their number, less the part due to chance; 0 for the law itself,
        infinite if counts lie at an end of the range that noise does not reach.
    is_tested
        True with more than three different counts; fewer always fit some standard deviation.
    stands_for
        Value for each count from the lower end to the upper: their mean over the counts is `mean_dn`, and their scatter
        gives its error.
    """

    mean_dn: float
    std_dn: float
    at_ends: FloatArray
    misfit: float
    is_tested: bool
    stands_for: FloatArray


_STEPS, _LEAST_COUNTS, _TINY = 60, 3, 1e-280


def estimate_signal(counts: NDArray[np.integer], *, highest: int) -> SignalEstimate | None:
    """Return mean and deviation of the normal signal behind counts; None if the counts do not determine them.

    Parameters
    ----------
    counts
        Of one level of light, any shape; for 0 and `highest` the signal lies there or beyond.
    highest
        Count at the upper end of the range, > 0.

    Notes
    -----
    Fewer than three different counts do not determine a deviation. Normal texture only widens the law.
    """
    number = np.bincount(np.minimum(np.ravel(counts), highest), minlength=highest + 1).astype(np.float64)
    kinds = np.flatnonzero(number)
    if kinds.size < _LEAST_COUNTS:
        return None
    total, at = number.sum(), np.arange(highest + 1.0)
    mean = float(number @ at) / total
    std = max(float(np.sqrt(number @ (at - mean) ** 2 / total)), 0.2)
    for _ in range(_STEPS):
        share, scores = _law(mean, std, highest)
        information = np.einsum("k,ki,kj->ij", share, scores, scores)
        step = np.linalg.solve(information, number @ scores / total)
        step = np.clip(step, -0.5 * std, [0.5 * std, std])
        mean, std = mean + float(step[0]), std + float(step[1])
        if np.all(np.abs(step) < 1e-9 * std):
            break
    else:
        return None
    influence = np.linalg.solve(information, scores.T)[0]
    return SignalEstimate(
        mean_dn=mean,
        std_dn=std,
        at_ends=number[[0, -1]] / total,
        misfit=_misfit(number, total * share),
        is_tested=kinds.size > _LEAST_COUNTS,
        stands_for=mean + influence,
    )


# Rarer counts are grouped; number of deviations of chi-square allowed for chance.
_LEAST_EXPECTED, _CHANCE, _UNLIKELY = 5.0, 4.0, 1e-5


def _misfit(number: FloatArray, expected: FloatArray) -> float:
    often = expected >= _LEAST_EXPECTED
    for at_end, lawful in zip(number[[0, -1]], expected[[0, -1]], strict=True):
        # Not clipped by noise.
        if lawful < _LEAST_EXPECTED and at_end > 0.0 and float(gammainc(at_end, lawful)) < _UNLIKELY:
            return float(np.inf)
    apart = number[often] - expected[often]
    rest = float(np.sum(number[~often]) - np.sum(expected[~often]))
    squares = float(np.sum(apart**2 / expected[often])) + rest**2 / max(float(expected[~often].sum()), _LEAST_EXPECTED)
    freedom = max(float(often.sum()) - 2.0, 0.0)
    return max(squares - freedom - _CHANCE * float(np.sqrt(2.0 * freedom)), 0.0) / float(number.sum())


def _law(mean: float, std: float, highest: int) -> tuple[FloatArray, FloatArray]:
    """Return the share of each count, and the derivatives of its logarithm by mean and deviation, shape (K, 2)."""
    edges = np.concatenate([[-np.inf], np.arange(highest) + 0.5, [np.inf]])
    z = (edges - mean) / std
    # Differences of the smaller tails, without cancellation.
    low, high = np.where(z[:-1] > 0.0, -z[1:], z[:-1]), np.where(z[:-1] > 0.0, -z[:-1], z[1:])
    share = np.asarray(ndtr(high)) - np.asarray(ndtr(low))
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    weighted = np.where(np.isfinite(z), z, 0.0) * density
    safe = np.maximum(share, _TINY)[:, None]
    scores = np.stack([-np.diff(density), -np.diff(weighted)], axis=1) / (safe * std)
    # If the share underflows the count is an outlier with its own place.
    off = ((np.arange(highest + 1.0) - mean) / std)[:, None]
    return share, np.where(share[:, None] > _TINY, scores, np.concatenate([off, off**2 - 1.0], axis=1) / std)
