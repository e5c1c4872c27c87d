"""Probability of a sector of directions for a Gaussian vector in a plane, seen from the origin."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, ndtr

from model.quadrature import gauss_legendre, integrate_panels

FloatArray = NDArray[np.float64]

_GROWTH = np.concatenate([[0.0, 0.5, 1.5, 4.0], 4.0 * 3.0 ** np.arange(1.0, 32.0)])


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
