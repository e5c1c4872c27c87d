"""Plane-parallel vector radiative transfer by successive orders of scattering."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import acos, cos, degrees, exp, inf, pi, radians

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.delta_m_truncation import delta_m_truncated
from model.atmosphere.transfer.depth import element_edges
from model.atmosphere.transfer.expansion_length import degree_max, mode_blocks, truncation_error
from model.atmosphere.transfer.layers import Layer, merge_alike
from model.atmosphere.transfer.phase import AerosolKind, expansion_coefficients, layers_of_kind
from model.atmosphere.transfer.residual import refined, residual
from model.atmosphere.transfer.scattering import element_expansion, scattering_of
from model.atmosphere.transfer.solution import ModeBlock, Solution
from model.atmosphere.transfer.successive_orders import (
    OrderSum,
    Setting,
    direct_irradiance,
    mean_radiance_of,
    sum_orders,
)
from model.atmosphere.transfer.transport import Grid, gauss_nodes, transport_of

__all__ = ["Layer", "Solution", "solve"]

_HALVINGS = 4  # of the outermost elements, which the source's t log t asks for
_SMALLEST_MU0 = cos(radians(85.0)) - 1e-12  # rounding of a caller's 85 degrees
_LARGEST_RATIO = 0.99  # of successive orders, where an error is taken to grow a hundredfold


def solve(
    layers: Sequence[Layer],
    *,
    mu0: float,
    albedo: float,
    aerosol: AerosolKind = AerosolKind.DEPOLARIZING,
    nodes: int = 16,
    element_depth: float = 0.02,
    tolerance: float = 1e-6,
    max_orders: int = 500,
) -> Solution:
    """Diffuse polarized light of a plane-parallel atmosphere under the sun, at every level and in every direction.

    Parameters
    ----------
    layers
        Homogeneous layers from top to bottom; may be empty.
    mu0
        Cosine of the solar zenith angle, cos(85 deg) to 1.
    albedo
        Albedo of the Lambertian ground, 0 to 1.
    aerosol
        What scattering by the aerosol does to polarization; spheres ask for a matrix in every layer that has aerosol.
    nodes
        Quadrature directions of each hemisphere, 4 or more; an asymmetry above 0.8 asks for more than 16.
    element_depth
        Largest optical depth in which the source is taken as a parabola, above 0.
    tolerance
        Estimated share, in the mean radiance of any level, of the orders left out, above 0.
    max_orders
        Where to stop in any case; the solution then says `converged = False`.

    Raises
    ------
    ValueError
        An argument outside its range.

    Notes
    -----
    Light scattered once is exact. Error against published tables for molecules: 2e-5 of the radiance from the zenith
    to 89 degrees, optical depth 0.005 to 2; Henyey-Greenstein g = 0.65: 2e-5, g = 0.76: 2e-4. The forward
    peak of a scattering matrix that the directions cannot resolve counts as not scattered, except in light scattered
    once (delta-M with TMS, see `model.atmosphere.transfer.delta_m_truncation`). The number of orders
    grows with the depth (70 at 2, conservative), so does the time. Refraction and curvature are left out.

    References
    ----------
    Lenoble et al., J. Quant. Spectrosc. Radiat. Transfer 107 (2007) 479, doi:10.1016/j.jqsrt.2007.03.010 (method).
    """
    check_scene(mu0=mu0, albedo=albedo)
    _check_settings(nodes=nodes, element_depth=element_depth, tolerance=tolerance, max_orders=max_orders)
    kind = AerosolKind(aerosol)
    alike = merge_alike(layers_of_kind(layers, kind))
    degree = degree_max(alike, nodes=nodes)
    merged = delta_m_truncated(alike, degree=degree)
    grid, owner = _grid(merged, mu0=mu0, nodes=nodes, element_depth=element_depth)
    setting = Setting(
        grid=grid, transport=transport_of(grid), albedo=albedo, tolerance=tolerance, max_orders=max_orders
    )
    coefficients = expansion_coefficients(merged, degree_max=degree, aerosol=kind)[owner]
    blocks = solve_blocks(setting, coefficients, mode_blocks(degree, kind))
    irradiance = blocks[0].result.diffuse_irradiance
    return Solution(
        layers=tuple(merged),
        mu0=mu0,
        edges=grid.edges,
        blocks=tuple(
            ModeBlock(modes=block.modes, expansion=element_expansion(coefficients, block.result.moments))
            for block in blocks
        ),
        ground_radiance=albedo / pi * (direct_irradiance(grid) + irradiance),
        # The forward peak, which counted as the beam, is diffuse light.
        diffuse_irradiance=irradiance + direct_irradiance(grid) - mu0 * exp(-_full_depth(merged) / mu0),
        orders=max(block.result.orders for block in blocks),
        converged=all(block.result.tail <= tolerance for block in blocks),
        error_estimate=estimate_error(setting, coefficients, blocks) + truncation_error(merged, degree=degree, mu0=mu0),
    )


def _full_depth(layers: Sequence[Layer]) -> float:
    """Extinction optical depth of all layers."""
    return sum(layer.full_depth for layer in layers)


def _grid(layers: Sequence[Layer], *, mu0: float, nodes: int, element_depth: float) -> tuple[Grid, NDArray[np.int_]]:
    """Levels and directions, and the layer of each element."""
    edges, owner = element_edges(layers, element_depth=element_depth, halvings=_HALVINGS)
    mu, weights = gauss_nodes(nodes)
    return Grid(edges=edges, nodes=mu, weights=weights, mu0=mu0), owner


def check_scene(*, mu0: float, albedo: float) -> None:
    """Refuse what the physics does not cover.

    Parameters
    ----------
    mu0
        Cosine of the solar zenith angle, cos(85 deg) to 1.
    albedo
        Albedo of the ground, 0 to 1.

    Raises
    ------
    ValueError
        One of them is outside its range.
    """
    if not mu0 <= 1.0:
        raise ValueError(f"solve: mu0 = {mu0!r}, but the cosine of the solar zenith angle is at most 1")
    if mu0 < _SMALLEST_MU0:
        zenith = degrees(acos(max(mu0, -1.0)))
        raise ValueError(
            f"solve: solar zenith {zenith:.2f} deg (mu0 = {mu0:.5f}), allowed is 0 to 85 deg: "
            "a plane-parallel atmosphere is wrong for a lower sun"
        )
    if not 0.0 <= albedo <= 1.0:
        raise ValueError(f"solve: albedo = {albedo!r}, allowed is 0 to 1")


def _check_settings(*, nodes: int, element_depth: float, tolerance: float, max_orders: int) -> None:
    """Refuse numerical settings without meaning."""
    for name, value, least in (("nodes", nodes, 4), ("max_orders", max_orders, 1)):
        if value < least:
            raise ValueError(f"solve: {name} = {value!r}, allowed is {least} or more")
    for name, number in (("element_depth", element_depth), ("tolerance", tolerance)):
        if not 0.0 < number < inf:
            raise ValueError(f"solve: {name} = {number!r}, but it must be finite and above 0")


@dataclass(frozen=True, kw_only=True)
class SolvedBlock:
    """A block of azimuth modes and the sum of its orders.

    Attributes
    ----------
    modes
        The azimuth modes; the first block begins with 0.
    polarized
        Whether Q and U were carried.
    result
        The sum of orders.
    """

    modes: range
    polarized: bool
    result: OrderSum


def solve_blocks(
    setting: Setting, coefficients: NDArray[np.float64], blocks: Sequence[tuple[range, bool]]
) -> list[SolvedBlock]:
    """Orders of scattering summed for each block; all are measured by the mean radiance, which the first one has.

    Parameters
    ----------
    setting
        Grid, extinction between its levels, and ground.
    coefficients
        Of the scattering matrices of each element, as `expansion_coefficients` has them, shape (E, L, 4).
    blocks
        Azimuth modes that are solved together and whether they carry polarization; those with mode 0 first.

    References
    ----------
    definition: see `model.atmosphere.transfer.successive_orders.sum_orders`
    """
    solved: list[SolvedBlock] = []
    for modes, polarized in blocks:
        scattering = scattering_of(setting.grid, coefficients, modes=modes, polarized=polarized)
        mean = mean_radiance_of(solved[0].result.moments) if solved else None
        result = sum_orders(setting, scattering, mean_radiance=mean)
        solved.append(SolvedBlock(modes=modes, polarized=polarized, result=result))
    return solved


def estimate_error(setting: Setting, coefficients: NDArray[np.float64], blocks: Sequence[SolvedBlock]) -> float:
    """Estimated error of quadrature and of the orders left out, as a share of the mean radiance that leaves.

    Parameters
    ----------
    setting
        Grid, extinction between its levels, and ground, that were solved with.
    coefficients
        Of the scattering matrices of each element, shape (E, L, 4).
    blocks
        What was solved.

    Notes
    -----
    The larger share of the light that leaves at the top and at the ground; the errors of the blocks are added.

    References
    ----------
    definition: see `model.atmosphere.transfer.residual.residual`
    """
    grid = refined(setting.grid)
    fine = replace(setting, grid=grid, transport=transport_of(grid))
    residuals = [
        residual(fine, coefficients, block.result, modes=block.modes, polarized=block.polarized) for block in blocks
    ]
    change = np.zeros(2)
    for block, missed in zip(blocks, residuals, strict=True):
        change += missed.change / (1.0 - min(block.result.ratio, _LARGEST_RATIO))
    mean = residuals[0].mean
    share = np.divide(change, mean, out=np.zeros(2), where=mean > 0.0)
    return float(np.max(share)) + sum(block.result.tail for block in blocks)
