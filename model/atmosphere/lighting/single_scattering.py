"""The atmosphere in which light is scattered at most once."""

from collections.abc import Sequence
from dataclasses import replace
from math import exp, pi

import numpy as np

from model.atmosphere.lighting.diffuse_light import MATRIX_DEGREE, sky_irradiance
from model.atmosphere.transfer.delta_m_truncation import single_peak_irradiance, truncated_by_absorption
from model.atmosphere.transfer.layers import Layer, merge_alike
from model.atmosphere.transfer.solution import Solution


def single_solution(layers: Sequence[Layer], *, mu0: float, albedo: float, **_: object) -> Solution:
    """Diffuse light scattered once, and the beam's light off the ground, unscattered since; called like the solver.

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
    # The sky's irradiance is that of a matrix without its peak, and the peak's.
    smooth = truncated_by_absorption(merged, degree=MATRIX_DEGREE)
    sky = sky_irradiance(_beam_only(smooth, mu0=mu0, albedo=0.0))
    peak = single_peak_irradiance(merged, degree=MATRIX_DEGREE, mu0=mu0)
    return replace(_beam_only(merged, mu0=mu0, albedo=albedo), diffuse_irradiance=sky + peak)


def _beam_only(layers: Sequence[Layer], *, mu0: float, albedo: float) -> Solution:
    """Light scattered once, its irradiance left open."""
    edges = np.cumsum([0.0, *(layer.depth for layer in layers)])
    return Solution(
        layers=tuple(layers),
        mu0=mu0,
        edges=edges,
        blocks=(),
        ground_radiance=albedo / pi * mu0 * exp(-float(edges[-1]) / mu0),
        diffuse_irradiance=0.0,
        orders=1,
        converged=False,
        error_estimate=1.0,
    )
