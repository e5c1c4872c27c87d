"""Search for quantiles of many distributions at once: Newton's method on normal scores within a shrinking bracket."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

FloatArray = NDArray[np.float64]
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
