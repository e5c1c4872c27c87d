"""Electron equation for a band resolved into wavelength samples."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.sensor.electrons import photon_conversion
from model.sensor.sensor import Sensor

FloatArray = NDArray[np.float64]


def spectral_electrons_per_radiance(
    sensor: Sensor,
    *,
    wavelength_m: ArrayLike,
    optics_transmittance: ArrayLike,
    quantum_efficiency: ArrayLike,
    relative_response: ArrayLike = 1.0,
) -> FloatArray:
    """Return weights w with photo-electrons = sum_k w_k L_k for spectral radiance L at sampled wavelengths.

    Parameters
    ----------
    sensor
        Aperture, pixel and exposure are taken from it; its band values are not.
    wavelength_m
        Samples [m], shape (K,), K >= 2, increasing.
    optics_transmittance, quantum_efficiency, relative_response
        At the samples, shape (K,) or scalar, each in [0, 1]. If the response already contains the quantum
        efficiency, give its peak as `quantum_efficiency`, so that it counts once.

    Returns
    -------
    ndarray
        Shape (K,), [e- per W m-2 sr-1 m-1]: the trapezoidal rule for
        pi A t / ((1 + 4 f#^2) h c) int tau eta R lambda L dlambda.

    Raises
    ------
    ValueError
        If the samples do not increase or a factor is outside [0, 1].

    References
    ----------
    [MK14] eq. (17), with pi.
    """
    wavelength = _checked_wavelengths(wavelength_m)
    response = np.ones_like(wavelength)
    for name, values in (
        ("optics_transmittance", optics_transmittance),
        ("quantum_efficiency", quantum_efficiency),
        ("relative_response", relative_response),
    ):
        factor = np.asarray(values, dtype=np.float64)
        if np.any(~((factor >= 0.0) & (factor <= 1.0))):
            raise ValueError(f"{name} runs from {np.min(factor)} to {np.max(factor)}; allowed is 0 to 1")
        response = response * factor
    return photon_conversion(sensor) * response * wavelength * _trapezoid_weights(wavelength)


def effective_wavelength_m(wavelength_m: ArrayLike, weight: ArrayLike) -> float:
    """Return the wavelength that makes the band form of the electron equation exact.

    Parameters
    ----------
    wavelength_m
        Samples [m], shape (K,), K >= 2, increasing.
    weight
        Spectral radiance times transmittance, quantum efficiency and response at the samples, shape (K,),
        >= 0.

    Returns
    -------
    float
        int w lambda dlambda / int w dlambda [m], by the trapezoidal rule.

    Raises
    ------
    ValueError
        If the samples do not increase, or no weight is positive.

    References
    ----------
    Definition.
    """
    wavelength = _checked_wavelengths(wavelength_m)
    weights = np.asarray(weight, dtype=np.float64) * _trapezoid_weights(wavelength)
    total = float(np.sum(weights))
    if np.any(weights < 0.0) or not total > 0.0:
        raise ValueError("weight must be >= 0 everywhere and > 0 somewhere")
    return float(np.sum(weights * wavelength)) / total


def _checked_wavelengths(wavelength_m: ArrayLike) -> FloatArray:
    wavelength = np.asarray(wavelength_m, dtype=np.float64)
    if wavelength.ndim != 1 or wavelength.size < 2 or np.any(np.diff(wavelength) <= 0.0) or wavelength[0] <= 0:
        raise ValueError("wavelength_m must be two or more increasing samples above 0 m")
    return wavelength


def _trapezoid_weights(nodes: FloatArray) -> FloatArray:
    steps = np.diff(nodes)
    weights: FloatArray = 0.5 * (np.concatenate([[0.0], steps]) + np.concatenate([steps, [0.0]]))
    return weights
