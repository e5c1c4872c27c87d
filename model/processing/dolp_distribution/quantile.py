"""Quantiles of DoLP given S0 > 0."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.dolp_distribution.distribution import pair_tails, paired
from model.processing.dolp_distribution.frame import DolpFrame
from model.special_functions import ndtri

FloatArray = NDArray[np.float64]

# The search runs over the logarithm of DoLP.
_LOG_RANGE = 700.0


def quantile(p: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return the value that DoLP, given S0 > 0, does not exceed with probability p.

    Parameters
    ----------
    p
        Probability, 0 to 1; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), positive semi-definite; singular is allowed.

    Returns
    -------
    ndarray
        DoLP; 0 for p = 0 and infinite for p = 1.

    Raises
    ------
    ValueError
        If p is outside 0 to 1, the arguments are no mean and covariance, or S0 > 0 has no probability.

    Notes
    -----
    The search runs over the logarithm of DoLP, with the smaller tail.
    """
    frame, index, wanted, shape = paired(p, stokes_mean, stokes_cov, name="p")
    if np.any(~((wanted >= 0.0) & (wanted <= 1.0))):
        raise ValueError(f"p runs from {np.min(wanted)} to {np.max(wanted)}; allowed is 0 to 1")
    result = np.where(wanted == 0.0, 0.0, np.inf)
    inner = (wanted > 0.0) & (wanted < 1.0)
    result[inner] = _solve(frame[index[inner]], wanted[inner])
    return np.asarray(result.reshape(shape)[()])


def _solve(frame: DolpFrame, p: FloatArray) -> FloatArray:
    def distribution(index: NDArray[np.int64], log_x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x = np.exp(log_x)
        found = pair_tails(frame[index], x)
        return found.lower, found.upper, found.density * x

    return np.exp(find_quantiles(distribution, p=p, start=np.log(_guess(frame, p)), reach=_LOG_RANGE))


def _guess(frame: DolpFrame, p: FloatArray) -> FloatArray:
    """Return a first quantile: Q^2 at the mean of S0 as a scaled chi-square variable (Wilson and Hilferty)."""
    bright = np.maximum(frame.mean_0, frame.sigma_0)
    common_1, common_2 = frame.excess_1 / bright, frame.excess_2 / bright
    var_1, var_2 = common_1**2 + frame.radius_1**2, common_2**2 + frame.radius_2**2
    cross = common_1 * common_2
    trace = frame.polarized**2 + var_1 + var_2
    along = frame.mean_1**2 * var_1 + 2.0 * frame.mean_1 * frame.mean_2 * cross + frame.mean_2**2 * var_2
    spread = 2.0 * (var_1**2 + 2.0 * cross**2 + var_2**2) + 4.0 * along
    safe = np.where(trace > 0.0, trace, 1.0)
    narrow = spread / (9.0 * safe**2)
    root = 1.0 - narrow + ndtri(p) * np.sqrt(narrow)
    square = safe * np.maximum(root, 0.1 * np.maximum(np.minimum(p, 0.1), 1e-60)) ** 3
    return np.asarray(np.sqrt(square) / bright)


IntArray = NDArray[np.int64]

_MAX_STEPS = 400
# Error of the normal score at which a Newton step ends the search: what remains is of the order of its square.
_SETTLED = 1e-8
_LONGEST_STEP = 3.0


def find_quantiles(
    distribution: Callable[[IntArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]],
    *,
    p: FloatArray,
    start: FloatArray,
    reach: float,
) -> FloatArray:
    """Return the places at which increasing distributions reach given probabilities.

    Parameters
    ----------
    distribution
        Of (number of each distribution, places), both of shape (K,): returns lower tail, upper tail and density per
        unit of place. A distribution may jump.
    p
        Probabilities, shape (M,), above 0 and below 1.
    start
        First places, shape (M,).
    reach
        The search covers places from -reach to reach.

    Returns
    -------
    ndarray
        Shape (M,), to rounding; the place of the jump where a distribution jumps over p.

    Raises
    ------
    ValueError
        If a search does not end, which means that a distribution is not increasing.
    """
    place, wanted = start.copy(), ndtri(p)
    low, high = np.full_like(p, -reach), np.full_like(p, reach)
    last = np.full_like(p, np.inf)
    active = np.arange(p.size)
    for _ in range(_MAX_STEPS):
        error, slope = _score_error(distribution(active, place[active]), wanted[active])
        low[active] = np.where(error < 0.0, place[active], low[active])
        high[active] = np.where(error < 0.0, high[active], place[active])
        open_ended = (low[active] == -reach) | (high[active] == reach)
        ends = low[active] - place[active], high[active] - place[active]
        last[active] = _step(error, slope, *ends, np.where(open_ended, np.inf, np.abs(last[active])))
        before = place[active]
        place[active] += last[active]
        stuck = np.abs(place[active] - before) <= 2e-16 * (1.0 + np.abs(before))
        settled = np.abs(error) * (1.0 + np.abs(wanted[active])) < _SETTLED
        unresolved = high[active] - low[active] <= 1e-15 * (1.0 + np.abs(place[active]))
        active = active[~(settled | stuck | unresolved)]
        if active.size == 0:
            return place
    raise ValueError(f"the search for {active.size} quantiles does not end; the first is p = {p[active[0]]:.17g}")


def _score_error(found: tuple[FloatArray, FloatArray, FloatArray], wanted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normal score of the distribution less the one wanted, and its slope."""
    lower, upper, density = found
    score = np.where(lower < upper, ndtri(lower), -ndtri(upper))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        slope = np.sqrt(2.0 * np.pi) * np.exp(np.log(density) + 0.5 * score**2)
    return score - wanted, slope


def _step(
    error: FloatArray, slope: FloatArray, to_low: FloatArray, to_high: FloatArray, last: FloatArray
) -> FloatArray:
    """Return Newton's step where it stays within the bracket and halves the last one, else to the middle.

    Before the bracket has two ends that were tried, the middle is no more than 1 away.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        newton = -error / slope
    usable = (
        np.isfinite(newton)
        & np.isfinite(slope)
        & (newton >= to_low)
        & (newton <= to_high)
        & (np.abs(newton) <= 0.5 * last)
    )
    middle = 0.5 * (to_low + to_high)
    longest = np.where(np.isinf(last), 1.0, np.inf)
    toward = np.where(error < 0.0, np.minimum(0.5 * to_high, longest), np.maximum(0.5 * to_low, -longest))
    return np.where(usable, np.clip(newton, -_LONGEST_STEP, _LONGEST_STEP), np.where(np.isinf(last), toward, middle))
