"""Residual of the solution of one grid in the equation of transfer on a finer one: an estimate of its error."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.scattering import beam_source, project, scattered_source, scattering_of
from model.atmosphere.transfer.successive_orders import OrderSum, Setting, direct_irradiance, ground_light
from model.atmosphere.transfer.transport import Grid, carry, carry_beam, gauss_nodes

# A parabola through the points of an element, read at the points 0, 1/4, 1/2 and 3/4 of it.
_QUARTERS = np.array([[1.0, 0.0, 0.0], [0.375, 0.75, -0.125], [0.0, 1.0, 0.0], [-0.125, 0.75, 0.375]])

_LOWEST_MU = 0.0175  # cosine of 89 degrees: lower lines of sight see the source at one level only


@dataclass(frozen=True, kw_only=True)
class Residual:
    """Residual radiance where light leaves the atmosphere: upward at the top, and downward at the ground.

    Attributes
    ----------
    change
        Largest change of the radiance over directions up to 89 degrees from the vertical, modes added, shape (2,).
    mean
        Mean over the hemisphere of the lowest mode's radiance, shape (2,).
    """

    change: NDArray[np.float64]
    mean: NDArray[np.float64]


def refined(grid: Grid) -> Grid:
    """Grid with every element halved and a quarter more directions.

    Parameters
    ----------
    grid
        Levels and directions.
    """
    middles = (grid.edges[:-1] + grid.edges[1:]) / 2.0
    edges = np.insert(grid.edges, np.arange(1, grid.edges.size), middles)
    nodes, weights = gauss_nodes(grid.nodes.size + ceil(grid.nodes.size / 4))
    return Grid(edges=edges, nodes=nodes, weights=weights, mu0=grid.mu0)


def residual(
    fine: Setting,
    coefficients: NDArray[np.float64],
    result: OrderSum,
    *,
    modes: range,
    polarized: bool,
) -> Residual:
    """Change, by one more order on a finer grid, of the radiance that leaves the atmosphere.

    Parameters
    ----------
    fine
        Setting on the `refined` grid.
    coefficients
        Expansion coefficients of the coarse grid's elements, shape (E, L, 4).
    result
        The sum of orders on the coarse grid.
    modes, polarized
        What the block holds.

    Notes
    -----
    The finer grid's integral of the coarse solution would give the coarse solution back if that were exact. The error
    itself is larger than this by 1/(1 - ratio of successive orders) at most.

    References
    ----------
    definition (residual of an integral equation of the second kind)
    """
    scattering = scattering_of(fine.grid, np.repeat(coefficients, 2, axis=0), modes=modes, polarized=polarized)
    guess = _read_at_fine_levels(result.moments)
    source = scattered_source(scattering, guess, fine.grid)
    irradiance = result.diffuse_irradiance + direct_irradiance(fine.grid) if 0 in modes else 0.0
    ground = ground_light(fine, scattering, irradiance)
    radiance = carry(fine.transport, source, ground) + carry_beam(
        fine.transport, beam_source(scattering, fine.grid), np.zeros_like(ground)
    )
    change = project(scattering, radiance) - guess
    effect = carry(fine.transport, scattered_source(scattering, change, fine.grid), np.zeros_like(ground))
    seen = fine.grid.nodes > _LOWEST_MU
    leaving = np.stack([effect[0, :, 1, seen], effect[-1, :, 0, seen]])
    outward = np.stack([radiance[0, 0, 1, :, 0], radiance[-1, 0, 0, :, 0]])
    return Residual(
        change=np.sum(np.max(np.abs(leaving), axis=(1, 3)), axis=1), mean=np.abs(outward) @ fine.grid.weights
    )


def _read_at_fine_levels(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moments (M, 2E + 1, L, S) by their parabolas at the 4E + 1 levels of halved elements."""
    modes, levels, degrees, stokes_count = moments.shape
    elements = levels // 2
    points = moments[:, 2 * np.arange(elements)[:, np.newaxis] + np.arange(3)]
    quarters = np.einsum("qp,mepls->meqls", _QUARTERS, points)
    inner = quarters.reshape(modes, 4 * elements, degrees, stokes_count)
    return np.concatenate([inner, moments[:, -1:]], axis=1)
