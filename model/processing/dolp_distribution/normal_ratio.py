"""Distribution of the ratio of two normal variables, given that the denominator is positive."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre, integrate_panels
from model.special_functions import erfcx, ndtr

FloatArray = NDArray[np.float64]

_GROWTH = np.concatenate([[0.0, 0.5, 1.5, 4.0], 4.0 * 3.0 ** np.arange(1.0, 32.0)])
# A denominator this many standard deviations from zero is as good as known for the angle at the origin.
_FAR = 1e12


def direction_density(distance: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the density of the direction of a vector with unit covariance.

    Parameters
    ----------
    distance
        Length of the mean, >= 0.
    angle_rad
        Angle from the direction of the mean [rad].

    Returns
    -------
    ndarray
        Arguments broadcast [rad^-1].

    References
    ----------
    Definition (offset normal distribution).
    """
    along, across = distance * np.cos(angle_rad), distance * np.sin(angle_rad)
    density: FloatArray = np.exp(-0.5 * across**2) / np.sqrt(2.0 * np.pi)
    # For along < 0 the two terms of the front form cancel.
    front = np.exp(-0.5 * distance**2) / (2.0 * np.pi) + density * along * ndtr(along)
    back = 1.0 - np.abs(along) * np.sqrt(0.5 * np.pi) * erfcx(np.abs(along) / np.sqrt(2.0))
    return np.where(along >= 0.0, front, np.exp(-0.5 * distance**2) * back / (2.0 * np.pi))


def sector_probability(
    distance: FloatArray, lower_rad: FloatArray, upper_rad: FloatArray, opening_rad: FloatArray
) -> FloatArray:
    """Return the probability that the direction of a vector with unit covariance lies in a sector.

    Parameters
    ----------
    distance
        Length of the mean, shape (M,), >= 0, finite.
    lower_rad, upper_rad
        Angles from the direction of the mean, shape (M,), -2 pi <= lower <= upper <= 2 pi [rad].
    opening_rad
        upper - lower, known better than their difference; used where the sector is slender [rad].

    Returns
    -------
    ndarray
        Shape (M,), to relative precision.
    """
    slender = opening_rad * (1.0 + distance) ** 2 < 0.1
    wide = ~slender
    result = np.empty_like(distance)
    result[slender] = _slender(distance[slender], lower_rad[slender], opening_rad[slender])
    result[wide] = _wide(distance[wide], lower_rad[wide], upper_rad[wide])
    return result


def _slender(distance: FloatArray, lower_rad: FloatArray, opening_rad: FloatArray) -> FloatArray:
    nodes, weights = gauss_legendre(10)
    angle = lower_rad[:, None] + np.multiply.outer(opening_rad, nodes)
    return np.asarray(opening_rad * (direction_density(distance[:, None], angle) @ weights))


def _wide(distance: FloatArray, lower_rad: FloatArray, upper_rad: FloatArray) -> FloatArray:
    width = 1.0 / (1.0 + distance)
    marks = np.multiply.outer(width, np.concatenate([-_GROWTH[::-1], _GROWTH]))
    marks = np.concatenate([np.tile([[-np.pi, np.pi]], (width.size, 1)), marks], axis=1)
    # Far from the mean the density falls within 1 / distance^2 of the ends.
    fall = np.multiply.outer(width**2, _GROWTH)
    ends = np.concatenate([lower_rad[:, None] + fall, upper_rad[:, None] - fall], axis=1)
    cuts = np.clip(np.concatenate([marks, ends], axis=1), lower_rad[:, None], upper_rad[:, None])
    cuts = np.sort(np.concatenate([lower_rad[:, None], cuts, upper_rad[:, None]], axis=1), axis=1)
    found = integrate_panels(
        lambda index, angle: direction_density(distance[index][:, None], angle)[None],
        cuts=cuts,
        tolerance=1e-13,
        noise=np.full(width.shape, 1e-15),
    )
    return np.asarray(found.value[:, 0])


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
