"""Mean and deviation of DoLP of few photo-electrons: the plain sum over all Poisson counts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]

# Counts less likely than this are left out, channel by channel.
_LEAST_PROBABILITY = 1e-15
# Combinations of counts that are summed at most: four channels of some 60 electrons each, half a second.
MOST_COMBINATIONS = 30_000_000
_CHUNK = 2_000_000


class TooManyCountsError(ValueError):
    """A sum over counts would be too long."""


@dataclass(frozen=True, kw_only=True)
class PoissonDolp:
    """DoLP of Poisson counts, given that S0 > 0.

    Attributes
    ----------
    mean, std
        Of sqrt(S1^2 + S2^2) / S0.
    without_light
        Probability of S0 <= 0, which the moments leave out.
    error
        Probability of the counts that the sum leaves out, rounding included.
    """

    mean: float
    std: float
    without_light: float
    error: float


def poisson_dolp(plan: Design, stokes_e: ArrayLike) -> PoissonDolp:
    """Return the exact moments of DoLP under shot noise alone.

    Parameters
    ----------
    plan
        Angles and inverse, N channels.
    stokes_e
        Mean Stokes parameters, shape (3,), no more polarized than light can be [e-].

    Raises
    ------
    ValueError
        A channel has a mean below 0.
    TooManyCountsError
        So many electrons arrive, or angles are so many, that the sum has more than 3e7 terms. The deviation of Gaussian
        counts (`model.processing.dolp`) is about 1 % too large there, and less by as much as there is more light.

    References
    ----------
    [MK14] section II-C, Fig. 5; definition of the mean of a function of independent Poisson counts.
    """
    light_e = np.asarray(stokes_e, dtype=np.float64)
    means_e = plan.system @ light_e
    if np.any(means_e < -1e-12 * np.abs(means_e).max()) or not np.all(np.isfinite(means_e)):
        raise ValueError(f"stokes_e = {light_e} puts {means_e.min():g} e- behind an angle; allowed is 0 and above")
    counts = [_likely_counts(mean) for mean in np.maximum(means_e, 0.0)]
    combinations = float(np.prod([found.size for found, _ in counts], dtype=np.float64))
    if combinations > MOST_COMBINATIONS:
        raise TooManyCountsError(
            f"stokes_e = {light_e} allows {combinations:.1e} combinations of counts; summed are {MOST_COMBINATIONS:g} "
            "at most"
        )
    half = len(counts) // 2
    return _summed(_halves(plan.inverse[:, :half], counts[:half]), _halves(plan.inverse[:, half:], counts[half:]))


def _likely_counts(mean_e: float) -> tuple[FloatArray, FloatArray]:
    """Return counts and their probabilities."""
    if mean_e == 0.0:
        return np.zeros(1), np.ones(1)
    counts = np.arange(np.ceil(mean_e + 40.0 + 12.0 * np.sqrt(mean_e)))
    probability = np.exp(counts * np.log(mean_e) - mean_e - gammaln(counts + 1.0))
    likely = probability > _LEAST_PROBABILITY
    return counts[likely], probability[likely]


def _halves(inverse: FloatArray, counts: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return what some channels add to the Stokes parameters, shape (P, 3), and how likely, shape (P,)."""
    stokes, probability = np.zeros((1, 3)), np.ones(1)
    for column, (found, likely) in zip(inverse.T, counts, strict=True):
        stokes = (stokes[:, None, :] + found[:, None] * column).reshape(-1, 3)
        probability = np.outer(probability, likely).ravel()
    return stokes, probability


def _summed(first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]) -> PoissonDolp:
    sums = np.zeros(4)
    stokes, probability = second
    rows = max(1, _CHUNK // probability.size)
    for start in range(0, first[1].size, rows):
        part = slice(start, start + rows)
        s0, s1, s2 = (first[0][part, None, k] + stokes[:, k] for k in range(3))
        weight = first[1][part, None] * probability
        # Rounding of the inverse may leave something where counts cancel.
        lit = s0 > 1e-9
        degree = np.hypot(s1, s2) / np.where(lit, s0, 1.0)
        seen = np.where(lit, weight, 0.0)
        sums += [seen.sum(), (seen * degree).sum(), (seen * degree**2).sum(), weight.sum()]
    seen_all, first_moment, second_moment, all_of_it = sums
    mean = first_moment / seen_all
    return PoissonDolp(
        mean=float(mean),
        std=float(np.sqrt(max(second_moment / seen_all - mean**2, 0.0))),
        without_light=float(max(all_of_it - seen_all, 0.0)),
        error=float(abs(1.0 - all_of_it)),
    )
