"""Diffuse light of a solved atmosphere, whoever solved it, and the irradiance of the ground by its sky."""

from math import pi
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.transfer.transport import gauss_nodes


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


_NODES, _AZIMUTHS = 12, 36  # within 1e-3 for a forward peak of the aerosol that an expansion to MATRIX_DEGREE holds
MATRIX_DEGREE = 17


def sky_irradiance(light: DiffuseLight) -> float:
    """Downward diffuse irradiance at the ground, per unit beam irradiance.

    Parameters
    ----------
    light
        A sky without a sharp aureole (see `model.atmosphere.transfer.delta_m_truncation.with_truncated_matrix`).
    """
    mu, weights = gauss_nodes(_NODES)
    phi_rad = 2.0 * pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    sky = light.stokes(light.depth, mu, phi_rad[:, np.newaxis], looking="up")
    return 2.0 * pi * float(np.mean(sky[..., 0], axis=0) @ (weights * mu))
