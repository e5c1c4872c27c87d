"""Protocol of a solved atmosphere, whoever solved it."""

from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


class DiffuseLight(Protocol):
    """Diffuse light of one sun position, one ground and one wavelength, per unit irradiance of the beam."""

    @property
    def mu0(self) -> float:
        """Cosine of the solar zenith angle."""
        ...

    @property
    def depth(self) -> float:
        """Extinction optical depth."""
        ...

    @property
    def ground_radiance(self) -> float:
        """Radiance that leaves the Lambertian ground [sr-1]."""
        ...

    @property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground."""
        ...

    @property
    def converged(self) -> bool:
        """True if what was asked for was reached."""
        ...

    @property
    def error_estimate(self) -> float:
        """Estimated error of the radiance as a share of its mean."""
        ...

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance as `model.atmosphere.transfer.solution.Solution.stokes` has it, shape (..., 3) [sr-1]."""
        ...
