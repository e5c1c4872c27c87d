"""Light taken as so much of the one atmosphere and so much of another: how unsure one is of a kind of aerosol."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.lighting import Lighting


@dataclass(frozen=True, kw_only=True, eq=False)
class MixedLighting:
    """Two lights mixed linearly; a `model.atmosphere.lighting.lighting.Lighting`.

    No atmosphere is such a mixture, but for light scattered once: the share makes the choice between two atmospheres
    one number, with a derivative and a standard uncertainty.

    Attributes
    ----------
    first, second
        Lights of one sun position in one band.
    share
        Of the second. Outside 0 to 1 the mixture is extrapolated, as a central difference at an end asks for.
    """

    first: Lighting
    second: Lighting
    share: float

    @property
    def direct_irradiance(self) -> float:
        """Irradiance of the beam at the ground on a plane normal to it [W m-2]."""
        return float(self._mixed(np.array(self.first.direct_irradiance), np.array(self.second.direct_irradiance)))

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky; arguments as in `Lighting.sky`."""
        each = (light.sky(zenith_rad=zenith_rad, phi_rad=phi_rad) for light in (self.first, self.second))
        return self._mixed(*each)

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance to a sensor; arguments as in `Lighting.transmittance`."""
        each = (light.transmittance(height_m=height_m, zenith_rad=zenith_rad) for light in (self.first, self.second))
        return self._mixed(*each)

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below a sensor; arguments as in `Lighting.path`."""
        each = (
            light.path(height_m=height_m, zenith_rad=zenith_rad, phi_rad=phi_rad) for light in (self.first, self.second)
        )
        return self._mixed(*each)

    def _mixed(self, first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((1.0 - self.share) * first + self.share * second)
