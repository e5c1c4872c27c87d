"""Distribution of the ratio of two normal variables, given that the denominator is positive."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from model.processing.dolp_distribution.planar_sector import direction_density, sector_probability

FloatArray = NDArray[np.float64]

# A denominator this many standard deviations from zero is as good as known for the angle at the origin.
_FAR = 1e12


@dataclass(frozen=True, kw_only=True)
class NormalRatio:
    """M ratios Y / X of independent normal variables, each parameter of shape (M,).

    Parameters
    ----------
    mean_y, sigma_y
        Numerator, sigma_y > 0.
    mean_x, sigma_x
        Denominator, sigma_x >= 0; X > 0 must have probability.
    """

    mean_y: FloatArray
    sigma_y: FloatArray
    mean_x: FloatArray
    sigma_x: FloatArray


def between(ratio: NormalRatio, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return Pr(lower < Y / X <= upper, X > 0), not divided by Pr(X > 0).

    Parameters
    ----------
    ratio
        M ratios.
    lower, upper
        Shape (M,), lower <= upper; may be infinite.

    Returns
    -------
    ndarray
        Shape (M,), to relative precision.
    """
    distance, low, _ = _direction(ratio, lower)
    high = _direction(ratio, upper)[1]
    # Angles run from -pi to pi about the mean; the half plane X > 0 is one connected piece of them.
    high = np.where(high < low, high + 2.0 * np.pi, high)
    return sector_probability(distance, low, high, _opening(ratio, lower, upper))


def density(ratio: NormalRatio, value: FloatArray) -> FloatArray:
    """Return the density of Y / X with X > 0, not divided by Pr(X > 0).

    Parameters
    ----------
    ratio
        M ratios.
    value
        Shape (M,), finite.

    Returns
    -------
    ndarray
        Shape (M,).
    """
    distance, angle, jacobian = _direction(ratio, value)
    return np.asarray(direction_density(distance, angle) * jacobian)


def positive(ratio: NormalRatio) -> FloatArray:
    """Return the probability of a positive denominator.

    Parameters
    ----------
    ratio
        M ratios.

    Returns
    -------
    ndarray
        Shape (M,).
    """
    return np.asarray(ndtr(ratio.mean_x / _sigma_x(ratio)))


def _sigma_x(ratio: NormalRatio) -> FloatArray:
    return np.maximum(ratio.sigma_x, np.abs(ratio.mean_x) / _FAR)


def _opening(ratio: NormalRatio, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the angle between two directions; as a difference of angles it would lose a far tail."""
    ahead_low, side_low = _components(ratio, lower)
    ahead_high, side_high = _components(ratio, upper)
    finite = np.isfinite(lower) & np.isfinite(upper)
    difference = np.where(finite, upper, 0.0) - np.where(finite, lower, 0.0)
    cross = np.where(
        finite, difference / (_sigma_x(ratio) * ratio.sigma_y), ahead_low * side_high - side_low * ahead_high
    )
    return np.arctan2(cross, ahead_low * ahead_high + side_low * side_high)


def _components(ratio: NormalRatio, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the whitened direction of (1, value)."""
    infinite = np.isinf(value)
    ahead = np.where(infinite, 0.0, 1.0 / _sigma_x(ratio))
    return ahead, np.where(infinite, np.sign(value), np.where(infinite, 0.0, value) / ratio.sigma_y)


def _direction(ratio: NormalRatio, value: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance of the whitened mean, angle of the direction (1, value) from it, and d angle / d value."""
    sigma_x = _sigma_x(ratio)
    mean_x, mean_y = ratio.mean_x / sigma_x, ratio.mean_y / ratio.sigma_y
    ahead, side = _components(ratio, value)
    infinite = np.isinf(value)
    finite = np.where(infinite, 0.0, value)
    # Cross product with the mean from the difference, so that nothing cancels at high signal to noise.
    apart = np.where(infinite, side * mean_x, (finite * ratio.mean_x - ratio.mean_y) / (sigma_x * ratio.sigma_y))
    along = ahead * mean_x + side * mean_y
    jacobian = 1.0 / (sigma_x * ratio.sigma_y * (ahead**2 + side**2))
    return np.hypot(mean_x, mean_y), np.arctan2(apart, along), jacobian
