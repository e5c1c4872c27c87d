"""Trends in numbers with errors: a weighted straight line, and the correlation of ranks."""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True)
class DriftLine:
    """A weighted straight line.

    Attributes
    ----------
    slope, std_error
        Per unit of the abscissa.
    chi_square, degrees_of_freedom
        Of what the line leaves.
    """

    slope: float
    std_error: float
    chi_square: float
    degrees_of_freedom: int


def drift_line(at: ArrayLike, values: ArrayLike, std_errors: ArrayLike) -> DriftLine:
    """Return the straight line through numbers that are weighted by their errors.

    Parameters
    ----------
    at
        Abscissa, such as a time, shape (n,), n >= 3, not all the same.
    values
        Shape (n,).
    std_errors
        Of the values, shape (n,), > 0, independent.

    Raises
    ------
    ValueError
        Fewer than three numbers, one abscissa for all, or an error that is not above 0.
    """
    x, y, s = (np.asarray(row, dtype=np.float64) for row in (at, values, std_errors))
    if x.size < 3 or np.ptp(x) == 0.0 or not np.all(s > 0.0):
        raise ValueError("a drift needs three numbers or more at different places, each with an error above 0")
    off = x - np.average(x, weights=s**-2.0)
    line, cov = np.polyfit(off, y, 1, w=1.0 / s, cov="unscaled")
    return DriftLine(
        slope=float(line[0]),
        std_error=float(np.sqrt(cov[0, 0])),
        chi_square=float(np.sum(((y - np.polyval(line, off)) / s) ** 2)),
        degrees_of_freedom=x.size - 2,
    )


FloatArray = NDArray[np.float64]

# All orders of so many numbers are counted, ties or not.
_COUNTED = 7


@dataclass(frozen=True, kw_only=True)
class RankCorrelation:
    """Kendall's tau of a prediction and a measurement over the pairs whose order is known.

    Attributes
    ----------
    numbers
        How many numbers were ordered.
    pairs, known_pairs
        Pairs of them, and those that differ by more than their error on both sides.
    concordant
        Known pairs that are in the same order on both sides.
    tau
        Of all pairs, errors aside: (concordant - discordant) / pairs; a pair that is equal on a side is neither.
    p_value
        Chance of so large a tau, one-sided, if both orders had nothing to do with each other.
    """

    numbers: int
    pairs: int
    known_pairs: int
    concordant: int
    tau: float
    p_value: float

    @property
    def share_concordant(self) -> float | None:
        """Share of the known pairs that are in the same order; None where none is known."""
        return None if self.known_pairs == 0 else self.concordant / self.known_pairs


def rank_correlation(
    predicted: ArrayLike, measured: ArrayLike, *, predicted_cov: ArrayLike, measured_cov: ArrayLike, sigmas: float = 2.0
) -> RankCorrelation:
    """Return how well a prediction has the order of what was measured.

    Parameters
    ----------
    predicted, measured
        Shape (n,), n >= 2.
    predicted_cov, measured_cov
        Covariances, shape (n, n): what is common to two numbers does not blur their order.
    sigmas
        A pair is known on a side where it differs by more than so many standard errors of its difference, >= 0.

    Raises
    ------
    ValueError
        Shapes do not fit, or there are fewer than two numbers.

    Notes
    -----
    With up to seven numbers the p value counts all orders, without ties 1/n! at the least: three numbers in order have
    the chance 1/6, so "the trend" of three is weak evidence however small their errors are. Beyond, it is that of
    `scipy.stats.kendalltau`: exact without ties, normal with them.

    References
    ----------
    Kendall, M. G. (1938), "A new measure of rank correlation", Biometrika 30, 81-93, doi:10.1093/biomet/30.1-2.81.
    """
    model, data = np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    if model.ndim != 1 or model.shape != data.shape or model.size < 2:
        raise ValueError(f"predicted {model.shape} and measured {data.shape}; allowed are two equal rows of 2 or more")
    first, second = np.triu_indices(model.size, k=1)
    steps = model[second] - model[first], data[second] - data[first]
    known = np.ones(first.size, dtype=np.bool_)
    for step, cov in zip(steps, (predicted_cov, measured_cov), strict=True):
        known &= np.abs(step) > sigmas * _step_errors(np.asarray(cov, dtype=np.float64), first, second)
    agreed = np.sign(steps[0]) * np.sign(steps[1])
    return RankCorrelation(
        numbers=int(model.size),
        pairs=int(first.size),
        known_pairs=int(known.sum()),
        concordant=int(np.sum(agreed[known] > 0.0)),
        tau=float(agreed.mean()),
        p_value=_p_value(model, data, float(agreed.sum())),
    )


def _step_errors(cov: FloatArray, first: NDArray[np.intp], second: NDArray[np.intp]) -> FloatArray:
    variances = np.diag(cov)
    return np.sqrt(np.maximum(variances[first] + variances[second] - 2.0 * cov[first, second], 0.0))


def _p_value(model: FloatArray, data: FloatArray, total: float) -> float:
    n = model.size
    if np.ptp(model) == 0.0 or np.ptp(data) == 0.0:
        return 1.0
    if n > _COUNTED:
        from scipy.stats import kendalltau

        return float(kendalltau(model, data, alternative="greater").pvalue)
    signs = np.sign(model[:, None] - model[None, :])
    orders = np.array(list(permutations(range(n))))
    other = np.sign(data[:, None] - data[None, :])
    totals = np.array([np.sum(signs * other[np.ix_(order, order)]) for order in orders]) / 2.0
    return float(np.mean(totals >= total - 0.5))
