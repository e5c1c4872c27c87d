"""Radiance at every level and quadrature direction, from the source function in every element."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.depth import slant, source_weights
from model.atmosphere.transfer.first_order import beam_share
from model.quadrature import gauss_legendre

_PARTS = np.array([0.5, 1.0])  # of an element: its middle and its far face


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Levels and directions of one run.

    Levels are the faces and the middles of E elements, 2E + 1 of them from the top. Arrays of radiance have the axes
    level, azimuth mode, way (0 down, 1 up), direction, Stokes component; arrays of source have element and point
    (top, middle, bottom of it) in place of level.

    Attributes
    ----------
    edges
        Optical depths of the elements' faces, shape (E + 1,).
    nodes, weights
        Quadrature for the cosine over (0, 1), shape (N,).
    mu0
        Cosine of the solar zenith angle.
    """

    edges: NDArray[np.float64]
    nodes: NDArray[np.float64]
    weights: NDArray[np.float64]
    mu0: float

    @property
    def depths(self) -> NDArray[np.float64]:
        """Optical depth of each element."""
        return np.diff(self.edges)

    @property
    def direction_mu(self) -> NDArray[np.float64]:
        """Cosine of propagation from the upward vertical of all 2N directions, first those downward."""
        return np.concatenate([-self.nodes, self.nodes])


@dataclass(frozen=True, kw_only=True)
class Transport:
    """Transport between the levels of a grid: extinction, and sources on the way.

    Attributes
    ----------
    decay
        Transmittance from an element's face to its middle and to its far face, shape (2, E, N).
    source_weight
        Weights of the source where light comes in, in the middle, at the far face; shape (3, 2, E, N).
    beam_weight
        Weights of a source exp(-tau/mu0), shape (2 parts, E, 2 ways, N).
    """

    decay: NDArray[np.float64]
    source_weight: NDArray[np.float64]
    beam_weight: NDArray[np.float64]


def gauss_nodes(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights for integrals over the cosine in (0, 1): Gauss-Legendre in its square root.

    Parameters
    ----------
    count
        Of nodes, 1 or more.

    Notes
    -----
    The square root crowds the nodes at the horizon, where the radiance of thin layers bends within a cosine of the
    order of their optical depth. Polynomials of the cosine are exact up to degree count - 1.
    """
    root, weight = gauss_legendre(count)
    return root**2, 2.0 * weight * root


def transport_of(grid: Grid) -> Transport:
    """Extinction between the levels of a grid.

    Parameters
    ----------
    grid
        Levels and directions.
    """
    path = slant(grid.depths[:, np.newaxis], grid.nodes)
    weights = source_weights(path=path, part=_PARTS[:, np.newaxis, np.newaxis])
    crossed = _PARTS[:, np.newaxis, np.newaxis] * grid.depths[:, np.newaxis]
    down, up = (beam_share(depth=crossed, mu=grid.nodes, mu0=grid.mu0, upward=upward) for upward in (False, True))
    start_of_down = grid.edges[:-1, np.newaxis]
    start_of_up = grid.edges[1:, np.newaxis] - crossed
    lit = np.stack([down * np.exp(-start_of_down / grid.mu0), up * np.exp(-start_of_up / grid.mu0)], axis=2)
    return Transport(
        decay=np.exp(-path * _PARTS[:, np.newaxis, np.newaxis]),
        source_weight=np.moveaxis(weights, -1, 0),
        beam_weight=lit,
    )


def carry(transport: Transport, source: NDArray[np.float64], ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance at all levels that a source in the elements and light from the ground make.

    Parameters
    ----------
    transport
        Extinction.
    source
        Shape (E, 3, M, 2, N, S).
    ground
        Radiance that leaves the ground upward, shape (M, N, S).

    Returns
    -------
    ndarray, shape (2E + 1, M, 2, N, S)
    """
    elements, _, modes, _, nodes, stokes_count = source.shape
    flat = source.reshape(elements, 3, modes, 2, nodes * stokes_count)
    weight = _for_each_component(transport.source_weight, stokes_count)[..., np.newaxis, :]
    steps = np.empty((2, elements, modes, 2, nodes * stokes_count))
    # Each way by the order in which its light meets the elements, and within one their points.
    for way, met in ((0, flat[..., 0, :]), (1, flat[::-1, ::-1, :, 1])):
        along = weight if way == 0 else weight[:, :, ::-1]
        np.multiply(along[0], met[:, 0], out=steps[..., way, :])
        steps[..., way, :] += along[1] * met[:, 1]
        steps[..., way, :] += along[2] * met[:, 2]
    return _accumulate(transport, steps, ground)


def carry_beam(transport: Transport, strength: NDArray[np.float64], ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance at all levels of light scattered once, and of the beam's light from the ground.

    Parameters
    ----------
    transport
        Extinction.
    strength
        Source of the beam in each element at unit irradiance, shape (E, M, 2, N, S).
    ground
        Radiance that leaves the ground upward, shape (M, N, S).

    Returns
    -------
    ndarray, shape (2E + 1, M, 2, N, S)
    """
    added = transport.beam_weight[:, :, np.newaxis, :, :, np.newaxis] * strength
    steps = np.stack([added[:, :, :, 0], added[:, ::-1, :, 1]], axis=3)
    return _accumulate(transport, steps.reshape(*steps.shape[:-2], ground[0].size), ground)


def _for_each_component(factors: NDArray[np.float64], stokes_count: int) -> NDArray[np.float64]:
    """Factors of directions, shape (..., N), for every component of each, shape (..., N S).

    Numpy's inner loop then runs over all of these, not over the few components.
    """
    return np.repeat(factors, stokes_count, axis=-1)


def _accumulate(transport: Transport, steps: NDArray[np.float64], ground: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance at all levels from what each element adds at its middle and far face, shape (2, E, M, 2, N S).

    The two ways run through the elements in opposite order: they are in that of the light, and stepped at once.
    """
    count, modes = steps.shape[1:3]
    by_way = np.stack([transport.decay, transport.decay[:, ::-1]], axis=2)
    decay = _for_each_component(by_way, ground.shape[-1])[:, :, np.newaxis]
    faces = np.zeros((count + 1, *steps.shape[2:]))
    faces[0, :, 1] = ground.reshape(modes, steps.shape[-1])
    for step in range(count):
        np.multiply(faces[step], decay[1, step], out=faces[step + 1])
        faces[step + 1] += steps[1, step]
    middles = faces[:-1] * decay[0]
    middles += steps[0]
    levels = np.empty((2 * count + 1, *steps.shape[2:]))
    levels[::2, :, 0], levels[1::2, :, 0] = faces[:, :, 0], middles[:, :, 0]
    levels[::2, :, 1], levels[1::2, :, 1] = faces[::-1, :, 1], middles[::-1, :, 1]
    return levels.reshape(*levels.shape[:-1], *ground.shape[1:])
