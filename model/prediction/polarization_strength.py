"""Strength of the polarization of a predicted region: the distribution of its DoLP, and its noise floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair
from model.prediction.prediction import RegionPrediction
from model.processing import dolp
from model.stokes import checked_stokes, require_positive_intensity

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PolarizationStrength:
    """Strength and certainty of the polarization of a region, of one cycle.

    Parameters
    ----------
    probabilities, quantiles
        Quantiles of the pixels' DoLP given S0 > 0; they exist whether or not moments do.
    nedolp
        First-order noise-equivalent DoLP from temporal noise: the deviation of DoLP that unpolarised light of this
        intensity would show. None where nothing is known of temporal noise.
    unpolarised_mean
        Mean DoLP that unpolarised light of this intensity shows by noise alone; not a number where it does not exist.
    """

    probabilities: FloatArray
    quantiles: FloatArray
    nedolp: float | None
    unpolarised_mean: float


def polarization_strength(
    prediction: RegionPrediction, *, probabilities: Sequence[float] = (0.025, 0.5, 0.975)
) -> PolarizationStrength:
    """Return the distribution of a region's DoLP in a few numbers, and its noise floor.

    Parameters
    ----------
    prediction
        Of the region.
    probabilities
        For which to give quantiles, each in (0, 1).

    Raises
    ------
    ValueError
        The mean of S0 is not above 0.

    References
    ----------
    [MK14] section IV-A; definition.
    """
    stokes = prediction.stokes_dn
    is_known = bool(np.any(prediction.stokes_noise_dn2))
    floor = noise_equivalent(stokes.mean, prediction.stokes_noise_dn2, tolerance=1e-6) if is_known else None
    levels = np.asarray(probabilities, dtype=np.float64)
    return PolarizationStrength(
        probabilities=levels,
        quantiles=np.asarray(dolp.quantile(levels, stokes.mean, stokes.cov)),
        nedolp=None if floor is None else float(floor.first_order),
        unpolarised_mean=np.nan if floor is None else float(floor.mean),
    )


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
    exact = dolp.moments(mean * np.array([1.0, 0.0, 0.0]), cov, tolerance=tolerance)
    values = np.linalg.eigvalsh(cov[..., 1:, 1:])
    return NoiseEquivalent(
        first_order=np.sqrt(np.maximum(np.sum(values, axis=-1), 0.0) / 2.0) / s0,
        worst_direction=np.sqrt(np.maximum(values[..., -1], 0.0)) / s0,
        mean=exact.mean,
        std=exact.std,
    )
