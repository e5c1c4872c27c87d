"""Errors that rounding to whole counts leaves in means and variances whose noise hardly dithers it."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_HALVINGS = 30


def least_noise_dn2(variance_dn2: FloatArray, spatial_dn2: FloatArray) -> FloatArray:
    """Return the least noise in time before rounding that a measured variance may come of [DN^2].

    Parameters
    ----------
    variance_dn2, spatial_dn2 : arrays
        Variance in time as measured, rounding included; variance from pixel to pixel, >= 0 [DN^2].

    Notes
    -----
    Noise that hardly dithers is seen larger by up to its rounding error, where the mean is half-way between two
    counts; taken at its face it would promise a dither that is not there. What is seen at most grows with the noise, so
    that halving an interval finds the root.
    """
    low, high = np.zeros_like(variance_dn2), np.maximum(variance_dn2, 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        seen = middle + 1.0 / 12.0 + np.sqrt(2.0) * variance_rounding_error_dn2(middle, spatial_dn2)
        low, high = np.where(seen < variance_dn2, middle, low), np.where(seen < variance_dn2, high, middle)
    return low


def mean_rounding_error_dn(noise_dn2: FloatArray) -> FloatArray:
    """Return the rms error that rounding leaves in a mean, over all places between two counts [DN].

    Parameters
    ----------
    noise_dn2 : array
        Variance before rounding, in time and from pixel to pixel, >= 0 [DN^2].

    Notes
    -----
    The first harmonic: exp(-2 pi^2 noise) sin(2 pi mean) / pi.

    References
    ----------
    Widrow and Kollar, Quantization Noise (2008), chapter 4.
    """
    error: FloatArray = np.exp(-2.0 * np.pi**2 * noise_dn2) / (np.pi * np.sqrt(2.0))
    return error


def variance_rounding_error_dn2(temporal_dn2: FloatArray, spatial_dn2: FloatArray) -> FloatArray:
    """Return the rms error that rounding leaves in a variance in time beyond 1/12 DN^2, over all places [DN^2].

    Parameters
    ----------
    temporal_dn2, spatial_dn2 : arrays
        Variance before rounding in time, and from pixel to pixel, >= 0 [DN^2]. The second only spreads the places.

    Notes
    -----
    The first harmonic: (4 noise + 1 / pi^2) exp(-2 pi^2 noise) cos(2 pi mean).

    References
    ----------
    Widrow and Kollar, Quantization Noise (2008), chapter 4.
    """
    decay = np.exp(-2.0 * np.pi**2 * (temporal_dn2 + spatial_dn2))
    error: FloatArray = (4.0 * temporal_dn2 + 1.0 / np.pi**2) * decay / np.sqrt(2.0)
    return error


def spatial_rounding_error_dn2(temporal_dn2: FloatArray, spatial_dn2: FloatArray) -> FloatArray:
    """Return the rms error that rounding leaves in a variance from pixel to pixel, over all places [DN^2].

    Parameters
    ----------
    temporal_dn2, spatial_dn2 : arrays
        Variance before rounding in time, and from pixel to pixel, >= 0 [DN^2].

    Notes
    -----
    Where rounding moves means by exp(-2 pi^2 noise) sin(2 pi mean) / pi, pixels that differ are pushed together or
    apart by its slope: twice the covariance of place and move, by Stein's lemma.
    """
    error: FloatArray = np.sqrt(8.0) * spatial_dn2 * np.exp(-2.0 * np.pi**2 * (temporal_dn2 + spatial_dn2))
    return error
