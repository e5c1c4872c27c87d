"""Strength of the polarization of a predicted region: the distribution of its DoLP, and its noise floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.prediction.prediction import RegionPrediction
from model.processing import dolp
from model.processing.nedolp import noise_equivalent

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
