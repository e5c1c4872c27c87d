"""Temporal noise of a pixel's counts, and the chance that a pixel is clipped."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.sensor.sensor import Sensor, SensorNoise
from model.special_functions import ndtr

FloatArray = NDArray[np.float64]

# Variance of a rounding error, uniform over one count.
_QUANTISATION_VAR_DN2 = 1.0 / 12.0


def temporal_variance_dn2(signal_dn: ArrayLike, *, noise: SensorNoise, exposure_s: ArrayLike) -> FloatArray:
    """Return the variance of a pixel's counts from frame to frame of a constant scene.

    Parameters
    ----------
    signal_dn
        Mean signal, black level and dark signal taken off, any shape [DN].
    noise
        Noise parameters.
    exposure_s
        Exposure time, broadcast against the signal [s].

    Returns
    -------
    ndarray
        Kn^2 (shot noise of light and dark electrons + read noise + 1/12) [DN^2].

    Notes
    -----
    Differs from [MK14]: the signal in eq. (19) is taken with the black level off and dark electrons in.

    References
    ----------
    [MK14] eq. (19), (32).
    """
    variance = unquantised_variance_dn2(signal_dn, noise=noise, exposure_s=exposure_s)
    rounding = _QUANTISATION_VAR_DN2 if noise.quantisation else 0.0
    return np.asarray(noise.noise_factor**2 * (variance + rounding))


def unquantised_variance_dn2(signal_dn: ArrayLike, *, noise: SensorNoise, exposure_s: ArrayLike) -> FloatArray:
    """Return what `temporal_variance_dn2` does before rounding, and without the noise factor [DN^2].

    Parameters
    ----------
    signal_dn
        Mean counts without the dark level [DN], 0 or more; broadcasts with the exposure.
    noise
        Of the sensor.
    exposure_s
        Above 0 [s].

    References
    ----------
    [MK14] eq. (19).
    """
    gain = noise.gain_dn_per_e
    dark_dn = gain * noise.dark_current_e_per_s * np.asarray(exposure_s, dtype=np.float64)
    light_dn = np.asarray(signal_dn, dtype=np.float64) * (1.0 if noise.shot_noise else 0.0)
    return np.asarray(gain * (light_dn + dark_dn) + (gain * noise.read_noise_e) ** 2)


def saturation_probability(
    sensor: Sensor, level: FloatArray, unquantised_var: FloatArray, spatial_cov: FloatArray
) -> FloatArray:
    """Return the larger of the chances of clipping in the converter and in the pixel's well.

    Parameters
    ----------
    sensor
        With its well and its converter.
    level
        Mean counts without the black level, dark signal included, shape (..., N) [DN].
    unquantised_var
        Temporal variance before rounding, shape (..., N) [DN^2].
    spatial_cov
        Covariance over the pixels, shape (..., N, N) [DN^2].

    References
    ----------
    Definition; counts are taken as normal.
    """
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
