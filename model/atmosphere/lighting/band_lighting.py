"""Light in a band from a computed atmosphere: few wavelengths, each with its share of the solar spectrum."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.diffuse_light import DiffuseLight
from model.atmosphere.profile import Column
from model.atmosphere.transfer.depth import slant

# Regions of a scene are looked at along the same lines of sight, one after another.
_KEPT = 64


@dataclass(frozen=True, kw_only=True)
class BandLighting:
    """Light in a band from solved atmospheres; a `model.atmosphere.lighting.lighting.Lighting`.

    Attributes
    ----------
    columns
        The atmosphere at each wavelength.
    solutions
        Its diffuse light at each wavelength.
    irradiance
        Share of each wavelength in the irradiance outside the atmosphere, after ozone [W m-2].
    direct_irradiance
        Irradiance of the beam at the ground on a plane normal to it [W m-2].
    wavelength_error
        Relative error of the direct irradiance were it taken from these wavelengths: an estimate of what their number
        costs the diffuse light.
    """

    columns: tuple[Column, ...]
    solutions: tuple[DiffuseLight, ...]
    irradiance: NDArray[np.float64]
    direct_irradiance: float
    wavelength_error: float
    _kept: dict[Hashable, NDArray[np.float64]] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def error_estimate(self) -> float:
        """Estimated relative error of the diffuse light by solver and wavelengths; the profile has its own."""
        return max(solution.error_estimate for solution in self.solutions) + self.wavelength_error

    @property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground [W m-2]."""
        return float(self.irradiance @ [solution.diffuse_irradiance for solution in self.solutions])

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky at the ground without the beam, shape (..., 3) [W m-2 sr-1].

        Parameters
        ----------
        zenith_rad
            Zenith angle of the point, 0 to pi/2 [rad].
        phi_rad
            Azimuth of the sun minus that of the point [rad].

        References
        ----------
        [MK14] eq. (3): the downwelled sky radiance.
        """
        mu = _cosine(zenith_rad)
        return self._band([solution.stokes(solution.depth, mu, phi_rad, looking="up") for solution in self.solutions])

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor over a black target, shape (..., 3) [W m-2 sr-1].

        Parameters
        ----------
        height_m
            Height of the sensor over the ground [m], 0 or more.
        zenith_rad
            View zenith angle, 0 to pi/2 [rad].
        phi_rad
            Azimuth of the sun minus that of the sensor as seen from the target [rad].

        References
        ----------
        [MK14] eq. (4).
        """
        mu, phi = _cosine(zenith_rad), np.asarray(phi_rad, dtype=float)

        def computed() -> NDArray[np.float64]:
            return self._band(
                [
                    path_radiance(solution, tau_above=column.tau_above(height_m), mu=mu, phi_rad=phi)
                    for column, solution in zip(self.columns, self.solutions, strict=True)
                ]
            )

        return self._once(("path", height_m, mu.shape, mu.tobytes(), phi.shape, phi.tobytes()), computed)

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor, in the mean over the spectrum of the beam at the ground.

        Parameters
        ----------
        height_m
            Height of the sensor over the ground [m], 0 or more.
        zenith_rad
            View zenith angle, 0 to pi/2 [rad].

        Notes
        -----
        Right for a surface without colour; for another, take the solutions wavelength by wavelength.

        References
        ----------
        [MK14] eq. (4).
        """
        mu = _cosine(zenith_rad)

        def computed() -> NDArray[np.float64]:
            beam = self.irradiance * [np.exp(-one.depth / one.mu0) for one in self.solutions]
            each = [
                path_transmittance(tau_below=column.depth - column.tau_above(height_m), mu=mu)
                for column in self.columns
            ]
            return np.asarray(np.tensordot(beam / np.sum(beam), np.array(each), 1))

        return self._once(("transmittance", height_m, mu.shape, mu.tobytes()), computed)

    def _once(self, key: Hashable, compute: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return an array of its own, computed where none of the last ones is the same."""
        found = self._kept.get(key)
        if found is None:
            found = compute()
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            self._kept[key] = found
        return found.copy()

    def _band(self, each: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Sum over the wavelengths."""
        return np.asarray(np.tensordot(self.irradiance, np.array(each), 1))


def _cosine(zenith_rad: ArrayLike) -> NDArray[np.float64]:
    """Cosine of zenith angles that were checked; exactly 0 at the horizon."""
    zenith = np.asarray(zenith_rad, dtype=float)
    if not np.all((zenith >= 0.0) & (zenith <= np.pi / 2.0)):
        raise ValueError("zenith_rad must be 0 to pi/2 rad")
    return np.asarray(np.sin(np.pi / 2.0 - zenith))


def path_transmittance(*, tau_below: ArrayLike, mu: ArrayLike) -> NDArray[np.float64]:
    """Transmittance from the ground to a sensor.

    Parameters
    ----------
    tau_below
        Optical depth between the ground and the sensor, 0 or more.
    mu
        Cosine of the view zenith angle, 0 to 1.

    References
    ----------
    [MK14] eq. (4): the transmittance tau of direct and of diffuse reflected light.
    """
    return np.exp(-slant(np.asarray(tau_below, dtype=float), np.asarray(mu, dtype=float)))


def path_radiance(
    solution: DiffuseLight, *, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike
) -> NDArray[np.float64]:
    """Stokes radiance that the air below a sensor adds over a black target, per unit beam irradiance [sr-1].

    Parameters
    ----------
    solution
        The solved atmosphere; the albedo of its ground is that of the target's surroundings.
    tau_above
        Optical depth above the sensor.
    mu
        Cosine of the view zenith angle, 0 to 1.
    phi_rad
        Azimuth of the sun minus azimuth of the sensor as seen from the target [rad].

    Returns
    -------
    ndarray, shape (..., 3)
        S0, S1, S2.

    References
    ----------
    [MK14] eq. (4): the upwelled radiance; with light from the surroundings scattered into the line of sight.
    """
    tau = np.asarray(tau_above, dtype=float)
    stokes = solution.stokes(tau, mu, phi_rad, looking="down")
    below = np.maximum(solution.depth - tau, 0.0)
    stokes[..., 0] -= solution.ground_radiance * path_transmittance(tau_below=below, mu=mu)
    return stokes
