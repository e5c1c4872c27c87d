"""An atmosphere that weakens the beam and scatters no light anywhere: where all scattered light is left out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.atmosphere.transfer.layers import Layer


@dataclass(frozen=True, kw_only=True)
class UnlitSolution:
    """A `model.atmosphere.lighting.diffuse_light.DiffuseLight` without light.

    Attributes
    ----------
    mu0, depth
        Cosine of the solar zenith angle, and extinction optical depth.
    """

    mu0: float
    depth: float
    ground_radiance: float = 0.0
    diffuse_irradiance: float = 0.0
    converged: bool = True
    error_estimate: float = 0.0

    def stokes(
        self, tau_above: ArrayLike, mu: ArrayLike, phi_rad: ArrayLike, *, looking: Literal["up", "down"]
    ) -> NDArray[np.float64]:
        """Return zeros, shape (..., 3) [sr-1]."""
        shape = np.broadcast_shapes(np.shape(tau_above), np.shape(mu), np.shape(phi_rad))
        return np.zeros((*shape, 3))


def unlit_solution(layers: Sequence[Layer], *, mu0: float, **_: Any) -> UnlitSolution:
    """Return an atmosphere of the depth of these layers that scatters nothing; called like the solver.

    Parameters
    ----------
    layers
        Homogeneous layers.
    mu0
        Cosine of the solar zenith angle, above 0 to 1.
    """
    return UnlitSolution(mu0=mu0, depth=float(sum(layer.full_depth for layer in layers)))
