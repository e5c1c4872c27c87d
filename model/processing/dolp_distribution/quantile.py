"""Quantiles of DoLP given S0 > 0."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from model.processing.dolp_distribution.distribution import pair_tails, paired
from model.processing.dolp_distribution.frame import DolpFrame
from model.processing.dolp_distribution.quantile_search import find_quantiles

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
