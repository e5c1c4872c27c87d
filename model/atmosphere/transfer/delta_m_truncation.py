"""The forward peak of a scattering matrix that few directions cannot hold: counted as not scattered."""

from collections.abc import Sequence
from dataclasses import replace
from math import exp

import numpy as np

from model.atmosphere.transfer.layers import Layer
from model.atmosphere.transfer.scattering_matrix import ScatteringMatrix


def forward_share(layer: Layer, *, degree: int) -> float:
    """Share of the aerosol's scattering in the peak beyond a degree; 0 where the expansion has ended or is negative.

    Parameters
    ----------
    layer
        With a scattering matrix, or without.
    degree
        The last that is kept, 0 or more.

    References
    ----------
    Wiscombe, J. Atmos. Sci. 34 (1977) 1408: the first coefficient left out, over 2l + 1.
    """
    if layer.matrix is None or layer.matrix.coefficients.shape[0] <= degree + 1:
        return 0.0
    return max(float(layer.matrix.coefficients[degree + 1, 0]) / (2 * degree + 3), 0.0)


def delta_m_truncated(layers: Sequence[Layer], *, degree: int) -> list[Layer]:
    """Layers whose scattering matrices give up the forward peak that an expansion to a degree cannot hold.

    Parameters
    ----------
    layers
        From top to bottom.
    degree
        The last that the expansion holds, 0 or more.

    Notes
    -----
    Delta-M: light in the peak counts as not scattered, as much of it as makes the first degree left out vanish. Light
    scattered once keeps the exact matrix, along the paths of the lesser depth (TMS). What remains is the shape of the
    aureole of light scattered twice and more, within some ten degrees of the sun.

    References
    ----------
    Wiscombe, J. Atmos. Sci. 34 (1977) 1408; Nakajima & Tanaka, J. Quant. Spectrosc. Radiat. Transfer 40 (1988) 51,
    doi:10.1016/0022-4073(88)90031-3.
    """
    return [replace(layer, forward_share=forward_share(layer, degree=degree)) for layer in layers]


def with_truncated_matrix(layers: Sequence[Layer], *, degree: int) -> list[Layer]:
    """Layers of lesser depth and albedo, whose matrices end at a degree: as `delta_m_truncated`, also seen once.

    Parameters
    ----------
    layers
        From top to bottom.
    degree
        The last that the matrices keep, 0 or more.

    Notes
    -----
    Fluxes of their light, together with that of the peak, are those of the layers given, and far easier to integrate.

    References
    ----------
    Wiscombe, J. Atmos. Sci. 34 (1977) 1408.
    """
    return [_truncated(layer, degree) for layer in layers]


def peak_irradiance(layers: Sequence[Layer], truncated: Sequence[Layer], *, mu0: float) -> float:
    """Irradiance of the ground by the forward peak, per unit of the beam's: diffuse light that counted as the beam.

    Parameters
    ----------
    layers, truncated
        From top to bottom, as they are and without their forward peaks.
    mu0
        Cosine of the solar zenith angle, above 0 to 1.
    """
    full, counted = (sum(layer.depth for layer in each) for each in (layers, truncated))
    return mu0 * (exp(-counted / mu0) - exp(-full / mu0))


def single_peak_irradiance(layers: Sequence[Layer], *, degree: int, mu0: float) -> float:
    """Irradiance of the ground by light of the forward peak that was scattered once, per unit beam irradiance.

    Parameters
    ----------
    layers
        From top to bottom.
    degree
        The last that is no part of the peak, 0 or more.
    mu0
        Cosine of the solar zenith angle, above 0 to 1.

    References
    ----------
    definition: it goes on along the beam.
    """
    depth = sum(layer.depth for layer in layers)
    scattered = sum(forward_share(layer, degree=degree) * layer.ssa_aerosol * layer.tau_aerosol for layer in layers)
    return scattered * exp(-depth / mu0)


def truncated_by_absorption(layers: Sequence[Layer], *, degree: int) -> list[Layer]:
    """Layers of the same depth whose matrices end at a degree, the forward peak taken from their albedo."""
    return [_cut(layer, degree) for layer in layers]


def _truncated(layer: Layer, degree: int) -> Layer:
    """Return one layer of `with_truncated_matrix`."""
    lost = layer.ssa_aerosol * forward_share(layer, degree=degree)
    cut = _cut(layer, degree)
    return replace(cut, tau_aerosol=layer.tau_aerosol * (1.0 - lost), ssa_aerosol=cut.ssa_aerosol / (1.0 - lost))


def _cut(layer: Layer, degree: int) -> Layer:
    """Return one layer of `truncated_by_absorption`."""
    share = forward_share(layer, degree=degree)
    if layer.matrix is None or share == 0.0:
        return layer
    series = layer.matrix.coefficients[: degree + 1].copy()
    peak = share * (2.0 * np.arange(degree + 1) + 1.0)
    series[:, 0] -= peak
    series[2:, 1:3] -= peak[2:, np.newaxis]
    matrix = ScatteringMatrix(coefficients=series / (1.0 - share), error_estimate=layer.matrix.error_estimate)
    return replace(layer, ssa_aerosol=layer.ssa_aerosol * (1.0 - share), matrix=matrix)
