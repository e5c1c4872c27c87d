"""Length of a Gaussian vector in a plane: mean and variance, for any mean and any two standard deviations."""

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_hermite

FloatArray = NDArray[np.float64]

# From this many standard deviations on, the kink of the length at the origin is out of reach of the Hermite rule.
_SMOOTH = 10.0
_HERMITE_NODES = 12
_LOG_STEP = 0.28
_LOG_TIMES = np.arange(-26.0, 40.0, _LOG_STEP)
# Rows at once: the arrays then stay in the cache.
_CHUNK = 128


def rice_moments(
    mean_1: FloatArray, mean_2: FloatArray, sigma_1: FloatArray, sigma_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how much the mean length exceeds the length of the mean, and the variance of the length.

    Parameters
    ----------
    mean_1, mean_2
        Mean of the two independent components, shape (K,).
    sigma_1, sigma_2
        Their standard deviations, shape (K,), sigma_1 >= sigma_2 >= 0.

    Returns
    -------
    excess, variance
        Shape (K,): E|X| - |E X| and var |X|. Relative error about 1e-13.

    Notes
    -----
    Far from the origin a product Gauss-Hermite rule is used, near it
    sqrt(E X^2) - E|X| = 1/(2 sqrt pi) int [M(t) - exp(-t E X^2)] t^(-3/2) dt, M(t) = E exp(-t X^2),
    with t = e^u and the trapezoidal rule in u: analytic for |Im u| < pi/2, it converges as exp(-pi^2 / step).

    References
    ----------
    Definition; S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46, doi:10.1002/j.1538-7305.1945.tb00453.x, for equal
    deviations.
    """
    excess, variance = np.zeros_like(mean_1), np.zeros_like(mean_1)
    length = np.hypot(mean_1, mean_2)
    far = length >= _SMOOTH * sigma_1
    for index in _chunks(np.flatnonzero(far & (sigma_1 > 0.0))):
        excess[index], variance[index] = _far(mean_1[index], mean_2[index], sigma_1[index], sigma_2[index])
    for index in _chunks(np.flatnonzero(~far)):
        excess[index], variance[index] = _near(mean_1[index], mean_2[index], sigma_1[index], sigma_2[index])
    return excess, variance


def _chunks(index: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    return [index[start : start + _CHUNK] for start in range(0, index.size, _CHUNK)]


def _far(
    mean_1: FloatArray, mean_2: FloatArray, sigma_1: FloatArray, sigma_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    nodes, weights = gauss_hermite(_HERMITE_NODES)
    grid_1, grid_2 = (axis.ravel() for axis in np.meshgrid(nodes, nodes))
    weight = np.outer(weights, weights).ravel()
    step_1, step_2 = np.multiply.outer(sigma_1, grid_1), np.multiply.outer(sigma_2, grid_2)
    length = np.hypot(mean_1, mean_2)[:, None]
    moved = np.hypot(mean_1[:, None] + step_1, mean_2[:, None] + step_2)
    change = step_1 * (2.0 * mean_1[:, None] + step_1) + step_2 * (2.0 * mean_2[:, None] + step_2)
    change /= moved + length
    excess = change @ weight
    return excess, ((change - excess[:, None]) ** 2) @ weight


def _near(
    mean_1: FloatArray, mean_2: FloatArray, sigma_1: FloatArray, sigma_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    square = mean_1**2 + mean_2**2 + sigma_1**2 + sigma_2**2
    root = np.sqrt(square)
    time = np.exp(_LOG_TIMES)
    growth, log_mean = np.zeros((square.size, time.size)), np.zeros((square.size, time.size))
    for mean, sigma in ((mean_1, sigma_1), (mean_2, sigma_2)):
        twice = np.multiply.outer(2.0 * sigma**2 / square, time)
        pull = np.multiply.outer(mean**2 / square, time) / (1.0 + twice)
        growth += 0.5 * _log1p_remainder(twice) + pull * twice
        log_mean -= 0.5 * np.log1p(twice) + pull
    # The exponent is growth - time = log_mean; the first form is precise at small times, the second at large ones.
    early = np.exp(-time) * np.expm1(np.minimum(growth, 1.0))
    rise = np.where(growth < 1.0, early, np.exp(log_mean) - np.exp(-time))
    loss = root * (rise @ np.exp(-0.5 * _LOG_TIMES)) * _LOG_STEP / (2.0 * np.sqrt(np.pi))
    excess = (sigma_1**2 + sigma_2**2) / (root + np.hypot(mean_1, mean_2)) - loss
    return excess, loss * (2.0 * root - loss)


def _log1p_remainder(x: FloatArray) -> FloatArray:
    """Return x - log(1 + x) for x >= 0, without cancellation at small x."""
    small = x < 0.03
    y = np.where(small, x, 0.0)
    series = np.zeros_like(y)
    for order in range(10, 1, -1):
        series = 1.0 / order - y * series
    series = y * y * series
    return np.where(small, series, x - np.log1p(x))
