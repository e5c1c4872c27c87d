"""A sky by formula: right in its geometry, rough in its numbers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.transfer.phase import rayleigh_column

_GRADATION = (-1.0, -0.32)
_INDICATRIX = (10.0, -3.0, 0.45)


def analytic_sky(
    *, mu0: float, zenith_radiance: float, dolp_max: float, zenith_rad: ArrayLike, phi_rad: ArrayLike
) -> NDArray[np.float64]:
    """Stokes radiance of a clear sky by formula, shape (..., 3), in the unit of the zenith radiance.

    Parameters
    ----------
    mu0
        Cosine of the solar zenith angle, above 0.
    zenith_radiance
        S0 at the zenith.
    dolp_max
        Degree of polarization 90 degrees from the sun, 0 to 1. Aerosol decides it: 0.15 to 0.25 is usual in haze.
    zenith_rad, phi_rad
        Zenith angle of the point, and azimuth of the sun minus that of the point [rad].

    Notes
    -----
    Vibration across the scattering plane, as for light scattered once: there are no neutral points beside the sun.

    References
    ----------
    ISO 15469:2004 / CIE S 011, sky type 12 (radiance); Rayleigh's law (polarization).
    """
    zenith, phi = np.broadcast_arrays(np.asarray(zenith_rad, dtype=float), np.asarray(phi_rad, dtype=float))
    mu = np.maximum(np.cos(zenith), 0.0)
    beam = np.sqrt(1.0 - mu0**2)
    from_sun = np.arccos(np.clip(mu * mu0 + np.sin(zenith) * beam * np.cos(phi), -1.0, 1.0))
    radiance = _gradation(mu) * _indicatrix(from_sun)
    radiance *= zenith_radiance / (_gradation(np.array(1.0)) * _indicatrix(np.arccos(np.array(mu0))))
    column = rayleigh_column(mu=-mu, beam_mu=-mu0, phi_rad=phi)
    share = column / column[..., :1] * np.array([1.0, -dolp_max, -dolp_max])
    return np.asarray(radiance[..., np.newaxis] * share)


def _gradation(mu: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance over zenith angle."""
    factor, rate = _GRADATION
    exponent = np.full(mu.shape, -np.inf)
    np.divide(rate, mu, out=exponent, where=mu > 0.0)
    return np.asarray(1.0 + factor * np.exp(exponent))


def _indicatrix(from_sun_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance over the angle from the sun."""
    factor, rate, back = _INDICATRIX
    peak = np.exp(rate * from_sun_rad) - np.exp(rate * np.pi / 2.0)
    return np.asarray(1.0 + factor * peak + back * np.cos(from_sun_rad) ** 2)


@dataclass(frozen=True, kw_only=True)
class AnalyticLighting:
    """A sky by formula with the beam and the path of another lighting; a `model.atmosphere.lighting.lighting.Lighting`.

    Attributes
    ----------
    path_and_beam
        Where all but the sky comes from.
    mu0
        Cosine of the solar zenith angle.
    zenith_radiance
        S0 at the zenith [W m-2 sr-1].
    dolp_max
        Degree of polarization 90 degrees from the sun.
    """

    path_and_beam: Lighting
    mu0: float
    zenith_radiance: float
    dolp_max: float

    @property
    def direct_irradiance(self) -> float:
        """Irradiance of the beam at the ground on a plane normal to it [W m-2]."""
        return self.path_and_beam.direct_irradiance

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky, shape (..., 3) [W m-2 sr-1].

        References
        ----------
        definition: see `analytic_sky`
        """
        return analytic_sky(
            mu0=self.mu0,
            zenith_radiance=self.zenith_radiance,
            dolp_max=self.dolp_max,
            zenith_rad=zenith_rad,
            phi_rad=phi_rad,
        )

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor."""
        return self.path_and_beam.transmittance(height_m=height_m, zenith_rad=zenith_rad)

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor, shape (..., 3) [W m-2 sr-1]."""
        return self.path_and_beam.path(height_m=height_m, zenith_rad=zenith_rad, phi_rad=phi_rad)
