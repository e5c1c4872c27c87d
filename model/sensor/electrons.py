"""Electrons and counts of a pixel per radiance."""

import numpy as np
from scipy import constants

from model.sensor.sensor import Sensor, aperture_factor


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
    return float(energy / (constants.h * constants.c))


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
    lambda_used / lambda_effective - 1, see `model.sensor.spectral_response`.

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
