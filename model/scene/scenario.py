"""Scenario of a prediction: the light of each region at the aperture, the sensor, and its readout."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.sensor.imperfections import PERFECT, Imperfections
from model.sensor.sensor import Sensor

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RegionLight:
    """The Stokes radiance that comes from a region to the aperture, and how it differs from pixel to pixel.

    Parameters
    ----------
    name
        Of the region.
    stokes_radiance
        Mean (S0, S1, S2), shape (3,) [W m-2 sr-1, in band].
    texture_rms
        Relative rms of a factor common to the whole Stokes vector of a pixel, >= 0.
    texture_cov
        Covariance of the pixels' Stokes radiance beyond that factor, shape (3, 3) [(W m-2 sr-1)^2].
    field_cov
        Covariance from what varies smoothly over the region, shape (3, 3) [(W m-2 sr-1)^2]; None for none.
    falloff_mean, falloff_var
        Mean and variance, over the region's pixels, of what the lens lets through off its axis; independent of the
        light.

    Notes
    -----
    A common factor has the rank-one covariance texture_rms^2 S S'; it moves DoLP by nothing at first order,
    where a diagonal covariance does.

    References
    ----------
    [MK14] eq. (7), (10).
    """

    name: str
    stokes_radiance: FloatArray
    texture_rms: float
    texture_cov: FloatArray
    field_cov: FloatArray | None = None
    falloff_mean: float = 1.0
    falloff_var: float = 0.0

    def aperture_moments(self) -> Moments:
        """Return mean and covariance of the Stokes radiance over the region's pixels, [MK14] eq. (10)."""
        squared = np.outer(self.stokes_radiance, self.stokes_radiance)
        texture = self.texture_rms**2 * squared + self.texture_cov
        square_mean = self.falloff_mean**2 + self.falloff_var
        return Moments(mean=self.falloff_mean * self.stokes_radiance, cov=square_mean * texture + self.smooth_cov())

    def smooth_cov(self) -> FloatArray:
        """Return the part of that covariance which varies smoothly over the region, shape (3, 3)."""
        squared = np.outer(self.stokes_radiance, self.stokes_radiance)
        over_field = np.zeros((3, 3)) if self.field_cov is None else self.field_cov
        return np.asarray(self.falloff_var * squared + (self.falloff_mean**2 + self.falloff_var) * over_field)


@dataclass(frozen=True, kw_only=True)
class Readout:
    """Readout: angles, cycles and processing of the frames.

    Parameters
    ----------
    angles_rad
        Angles of the polarizer's axis, one per frame of a cycle, shape (N,) [rad]; in a comparison those that the
        stage read back.
    channel_names
        A name for each of them, as it stands in a report: "dn_45".
    cycles
        How many times all angles are gone through, >= 1.
    extinction_ratio
        Of the polarizer, as the processing takes it to be; infinite for ideal.
    noise_factor
        What the processing makes of the variance of temporal noise before anything else, one factor a frame, such as
        by interpolation between pixels; None for nothing.
    flat_error
        Relative standard deviation of the error of each frame's flat field over the pixels, one a frame; None where
        frames are not divided by a flat field, and show the response of each pixel.
    """

    angles_rad: FloatArray
    channel_names: tuple[str, ...]
    cycles: int
    extinction_ratio: float
    noise_factor: FloatArray | None = None
    flat_error: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Light, sensor and readout of a prediction; `imperfections` are the session's."""

    regions: tuple[RegionLight, ...]
    sensor: Sensor
    readout: Readout
    imperfections: Imperfections = PERFECT
