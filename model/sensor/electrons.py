"""Electrons of a pixel per radiance, and the wavelength that stands for a band."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.sensor.sensor import Sensor, aperture_factor

FloatArray = NDArray[np.float64]

# Exact by the definition of the units.
_PLANCK_J_S, _LIGHT_M_PER_S = 6.62607015e-34, 299_792_458.0


def photon_conversion(sensor: Sensor) -> float:
    """Return pi A t sin^2 / (h c): electrons per radiance and wavelength of a pixel with unit efficiency.

    Parameters
    ----------
    sensor
        Pixel, exposure and aperture.

    Returns
    -------
    float
        [e- per (W m-2 sr-1) m].

    References
    ----------
    [MK14] eq. (17), with pi.
    """
    irradiance = np.pi * aperture_factor(sensor)
    energy = irradiance * sensor.pixel_pitch_m**2 * sensor.exposure_s
    return float(energy / (_PLANCK_J_S * _LIGHT_M_PER_S))


def electrons_per_radiance(sensor: Sensor) -> float:
    """Return the photo-electrons of a pixel and frame per unit of band radiance behind the polarizer.

    Parameters
    ----------
    sensor
        Optics, exposure and quantum efficiency; the polarizer is not in this factor.

    Returns
    -------
    float
        [e- per W m-2 sr-1]; linear in exposure, pixel area and quantum efficiency.

    Notes
    -----
    Differs from [MK14]: eq. (17) as printed lacks pi. With one effective wavelength the relative error is
    lambda_used / lambda_effective - 1, see `model.sensor.electrons`.

    References
    ----------
    [MK14] eq. (17).
    """
    efficiency = sensor.optics_transmittance * sensor.quantum_efficiency
    return photon_conversion(sensor) * efficiency * sensor.wavelength_m


def counts_per_radiance(sensor: Sensor) -> float:
    """Return the counts of a pixel and frame behind the polarizer per unit of unpolarized band radiance.

    Parameters
    ----------
    sensor
        Optics, exposure, polarizer, quantum efficiency and gain.

    Returns
    -------
    float
        [DN per W m-2 sr-1], > 0: the mean over polarizer angles, black level and dark signal taken off.

    References
    ----------
    [MK14] eq. (11), (17), (19).
    """
    transmitted = 0.5 * (sensor.tau_parallel + sensor.tau_perpendicular)
    return sensor.noise.gain_dn_per_e * electrons_per_radiance(sensor) * transmitted


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
