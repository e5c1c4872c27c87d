"""Noise-equivalent degree of linear polarization: how much DoLP unpolarized light shows by noise alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair
from model.processing.dolp import moments
from model.stokes import checked_stokes, require_positive_intensity

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class NoiseEquivalent:
    """DoLP from noise alone, each of shape (...).

    Parameters
    ----------
    first_order
        sqrt((var S1 + var S2) / 2) / S0: deviation of DoLP to first order as DoLP goes to 0, rms over the
        directions of polarization. The usual NEDoLP.
    worst_direction
        The same for the direction of polarization with the largest variance.
    mean, std
        Mean and standard deviation of the DoLP that is measured of unpolarized light, by quadrature; 1.2533 and
        0.6551 times `first_order` for equal variances and S0 known. Not a number where DoLP has no moments.
    """

    first_order: FloatArray
    worst_direction: FloatArray
    mean: FloatArray
    std: FloatArray


def noise_equivalent(stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, tolerance: float = 1e-9) -> NoiseEquivalent:
    """Return the noise-equivalent DoLP for given intensity and covariance.

    Parameters
    ----------
    stokes_mean
        Shape (..., 3); only S0 > 0 is used, S1 and S2 are taken to be zero.
    stokes_cov
        Covariance of the noise, shape (..., 3, 3), in the square of the unit of `stokes_mean`.
    tolerance
        Relative error allowed of the exact values.

    Returns
    -------
    NoiseEquivalent
        Of first order and exact.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, or S0 is not positive.
    """
    mean, cov = checked_pair(checked_stokes(stokes_mean), stokes_cov)
    require_positive_intensity(mean)
    s0 = mean[..., 0]
    exact = moments(mean * np.array([1.0, 0.0, 0.0]), cov, tolerance=tolerance)
    values = np.linalg.eigvalsh(cov[..., 1:, 1:])
    return NoiseEquivalent(
        first_order=np.sqrt(np.maximum(np.sum(values, axis=-1), 0.0) / 2.0) / s0,
        worst_direction=np.sqrt(np.maximum(values[..., -1], 0.0)) / s0,
        mean=exact.mean,
        std=exact.std,
    )
