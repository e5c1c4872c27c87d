"""Quantiles of DoLP given S0 > 0."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from model.processing.dolp_frame import DolpFrame
from model.processing.dolp_law import pair_tails, paired

FloatArray = NDArray[np.float64]

_MAX_STEPS = 200
# Error of the normal score at which a Newton step ends the search: what remains is of the order of its square.
_SETTLED = 1e-8
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
    Newton's method on the normal score of the smaller tail over the logarithm of DoLP, within a shrinking
    bracket.

    References
    ----------
    Definition.
    """
    frame, index, wanted, shape = paired(p, stokes_mean, stokes_cov, name="p")
    if np.any(~((wanted >= 0.0) & (wanted <= 1.0))):
        raise ValueError(f"p runs from {np.min(wanted)} to {np.max(wanted)}; allowed is 0 to 1")
    result = np.where(wanted == 0.0, 0.0, np.inf)
    inner = (wanted > 0.0) & (wanted < 1.0)
    result[inner] = _solve(frame[index[inner]], wanted[inner])
    return np.asarray(result.reshape(shape)[()])


def _solve(frame: DolpFrame, p: FloatArray) -> FloatArray:
    log_x = np.log(_guess(frame, p))
    low, high = np.full_like(p, -_LOG_RANGE), np.full_like(p, _LOG_RANGE)
    wanted = ndtri(p)
    active = np.arange(p.size)
    for _ in range(_MAX_STEPS):
        error, slope = _score_error(frame[active], log_x[active], wanted[active])
        low[active] = np.where(error < 0.0, log_x[active], low[active])
        high[active] = np.where(error < 0.0, high[active], log_x[active])
        step = _step(error, slope, low[active] - log_x[active], high[active] - log_x[active])
        log_x[active] += step
        settled = np.abs(error) * (1.0 + np.abs(wanted[active])) < _SETTLED
        unresolved = high[active] - low[active] <= 1e-15 * (1.0 + np.abs(log_x[active]))
        active = active[~(settled | unresolved)]
        if active.size == 0:
            break
    return np.exp(log_x)


def _score_error(frame: DolpFrame, log_x: FloatArray, wanted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normal score of the law at x less the one wanted, and its slope over log x."""
    x = np.exp(log_x)
    found = pair_tails(frame, x)
    score = np.where(found.lower < found.upper, ndtri(found.lower), -ndtri(found.upper))
    with np.errstate(over="ignore", invalid="ignore"):
        slope = found.density * x * np.sqrt(2.0 * np.pi) * np.exp(0.5 * score**2)
    return score - wanted, slope


def _step(error: FloatArray, slope: FloatArray, to_low: FloatArray, to_high: FloatArray) -> FloatArray:
    """Return Newton's step where it stays within the bracket, else half of the bracket or one, if that is less."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        newton = -error / slope
    usable = np.isfinite(newton) & (newton >= to_low) & (newton <= to_high)
    bisection = np.where(error < 0.0, np.minimum(0.5 * to_high, 1.0), np.maximum(0.5 * to_low, -1.0))
    return np.where(usable, np.clip(newton, -3.0, 3.0), bisection)


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
    square = safe * np.maximum(root, 0.1 * np.minimum(p, 0.1)) ** 3
    return np.asarray(np.sqrt(square) / bright)
