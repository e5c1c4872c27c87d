"""Protocol of the light of an atmosphere, from whatever source."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Lighting(Protocol):
    """Light of one sun position in one band: on a target at the ground, and on the way to a sensor.

    Azimuths are phi = azimuth(sun) - azimuth(point of the sky, or sensor as seen from the target), Stokes parameters
    in the frame of the conventions (S1 > 0 horizontal, S2 > 0 at +45 degrees).
    """

    @property
    def direct_irradiance(self) -> float:
        """Irradiance of the beam at the ground on a plane normal to it [W m-2]."""
        ...

    def sky(self, *, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance of the sky at the ground without the beam, shape (..., 3) [W m-2 sr-1]."""
        ...

    def transmittance(self, *, height_m: float, zenith_rad: ArrayLike) -> NDArray[np.float64]:
        """Transmittance from the ground to a sensor at a height over it, seen at a zenith angle."""
        ...

    def path(self, *, height_m: float, zenith_rad: ArrayLike, phi_rad: ArrayLike) -> NDArray[np.float64]:
        """Stokes radiance added below the sensor over a black target, shape (..., 3) [W m-2 sr-1]."""
        ...
