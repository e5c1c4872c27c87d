"""Chance that a pixel is clipped, in the converter or in its well."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from model.sensor.sensor import Sensor

FloatArray = NDArray[np.float64]


def saturation_probability(
    sensor: Sensor, level: FloatArray, unquantised_var: FloatArray, spatial_cov: FloatArray
) -> FloatArray:
    """Return the larger of the chances of clipping in the converter and in the pixel's well."""
    noise = sensor.noise
    spatial = np.diagonal(spatial_cov, axis1=-2, axis2=-1)
    top = 2.0**sensor.bit_depth - 0.5 - noise.black_level_dn
    clipped = _exceedance(level, top, unquantised_var + spatial)
    if noise.saturation_e is None:
        return clipped
    well = noise.gain_dn_per_e * noise.saturation_e
    in_well = unquantised_var - (noise.gain_dn_per_e * noise.read_noise_e) ** 2 + spatial
    return np.maximum(clipped, _exceedance(level, well, in_well))


def _exceedance(mean: FloatArray, limit: float, var: FloatArray) -> FloatArray:
    sigma = np.sqrt(np.maximum(var, 0.0))
    certain = (mean > limit).astype(np.float64)
    return np.where(sigma > 0.0, ndtr((mean - limit) / np.where(sigma > 0.0, sigma, 1.0)), certain)
