"""The atmosphere in which light is scattered at most once."""

from collections.abc import Sequence
from dataclasses import replace
from math import exp, pi

import numpy as np

from model.atmosphere.layers import Layer, merge_alike
from model.atmosphere.solution import Solution
from model.atmosphere.transport import gauss_nodes

_IRRADIANCE_NODES, _IRRADIANCE_AZIMUTHS = 12, 36  # within 1e-3 for the forward peak of aerosol


def single_solution(layers: Sequence[Layer], *, mu0: float, albedo: float) -> Solution:
    """Diffuse light scattered once, and the beam's light off the ground, unscattered since.

    Parameters
    ----------
    layers
        Homogeneous layers from top to bottom.
    mu0
        Cosine of the solar zenith angle, above 0 to 1.
    albedo
        Albedo of the Lambertian ground, 0 to 1.

    Notes
    -----
    Exact for what it contains; the radiance lacks light scattered more often, a quarter to three quarters of it. Its
    error is not estimated here and stated as 1.

    References
    ----------
    Chandrasekhar, Radiative Transfer (1950), section 7.
    """
    if not (0.0 < mu0 <= 1.0 and 0.0 <= albedo <= 1.0):
        raise ValueError(f"single_solution: mu0 = {mu0!r} must be above 0 to 1, albedo = {albedo!r} from 0 to 1")
    merged = merge_alike(layers)
    edges = np.cumsum([0.0, *(layer.depth for layer in merged)])
    beam_only = Solution(
        layers=tuple(merged),
        mu0=mu0,
        edges=edges,
        blocks=(),
        ground_radiance=albedo / pi * mu0 * exp(-float(edges[-1]) / mu0),
        diffuse_irradiance=0.0,
        orders=1,
        converged=False,
        error_estimate=1.0,
    )
    return replace(beam_only, diffuse_irradiance=_sky_irradiance(beam_only))


def _sky_irradiance(solution: Solution) -> float:
    """Downward irradiance at the ground, over directions."""
    mu, weights = gauss_nodes(_IRRADIANCE_NODES)
    phi_rad = 2.0 * pi * np.arange(_IRRADIANCE_AZIMUTHS) / _IRRADIANCE_AZIMUTHS
    sky = solution.stokes(solution.depth, mu, phi_rad[:, np.newaxis], looking="up")
    return 2.0 * pi * float(np.mean(sky[..., 0], axis=0) @ (weights * mu))
