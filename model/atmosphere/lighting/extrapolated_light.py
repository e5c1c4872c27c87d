"""Light between layers of no thickness, from two cuts of the same air: the error of layers falls as their square."""

from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.lighting.diffuse_light import DiffuseLight

Number = TypeVar("Number", float, NDArray[np.float64])


@dataclass(frozen=True, kw_only=True)
class ExtrapolatedLight:
    """A `model.atmosphere.lighting.diffuse_light.DiffuseLight` from two others: Richardson's extrapolation.

    Attributes
    ----------
    coarse
        Light of some layers.
    fine
        Of the same layers, each cut in two; so are the solver's elements in each.

    Notes
    -----
    What is left of the layers' error falls as the fourth power of their thickness, at their faces. Within a layer
    it falls as the square: of where in it one reads the light the error is no smooth function.

    References
    ----------
    L. F. Richardson, Phil. Trans. R. Soc. A 210 (1911) 307, doi:10.1098/rsta.1911.0009.
    """

    coarse: DiffuseLight
    fine: DiffuseLight

    @property
    def mu0(self) -> float:
        """Cosine of the solar zenith angle."""
        return self.fine.mu0

    @property
    def depth(self) -> float:
        """Extinction optical depth, that of both."""
        return self.fine.depth

    @property
    def ground_radiance(self) -> float:
        """Radiance that leaves the Lambertian ground [sr-1]."""
        return _extrapolated(self.coarse.ground_radiance, self.fine.ground_radiance)

    @property
    def diffuse_irradiance(self) -> float:
        """Downward diffuse irradiance at the ground."""
        return _extrapolated(self.coarse.diffuse_irradiance, self.fine.diffuse_irradiance)

    @property
    def converged(self) -> bool:
        """True if both have what was asked for."""
        return self.coarse.converged and self.fine.converged

    @property
    def error_estimate(self) -> float:
        """Estimated error of the radiance as a share of its mean, but for layers: that of the finer one."""
        return self.fine.error_estimate

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Stokes radiance as `model.atmosphere.transfer.solution.Solution.stokes` has it, shape (..., 3) [sr-1]."""
        coarse, fine = (one.stokes(tau_above, mu, phi_rad, looking=looking) for one in (self.coarse, self.fine))
        return _extrapolated(coarse, fine)


def _extrapolated(coarse: Number, fine: Number) -> Number:
    return fine + (fine - coarse) / 3.0
