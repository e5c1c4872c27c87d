"""Scattering of the radiance on a grid, for a block of azimuth modes, in expansion space."""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.transfer.spherical_functions import stokes_basis
from model.atmosphere.transfer.transport import Grid


@dataclass(frozen=True, kw_only=True)
class Scattering:
    """Scattering of a block of azimuth modes.

    Attributes
    ----------
    basis
        Shape (M, Y, X), Y = L degrees times S Stokes components, X = 2N directions times S.
    projector
        The basis times the quadrature weights, shape (M, X, Y).
    beam
        Expansion of unpolarized light along the beam, shape (M, L, S).
    coefficients
        Expansion coefficients of each element, shape (E, L, 4).
    """

    basis: NDArray[np.float64]
    projector: NDArray[np.float64]
    beam: NDArray[np.float64]
    coefficients: NDArray[np.float64]


def scattering_of(grid: Grid, coefficients: NDArray[np.float64], *, modes: range, polarized: bool) -> Scattering:
    """Operators of a block of azimuth modes.

    Parameters
    ----------
    grid
        Levels and directions.
    coefficients
        Expansion coefficients of each element, shape (E, L, 4).
    modes
        The azimuth modes of the block.
    polarized
        Whether I, Q and U are carried, or I alone.

    References
    ----------
    Siewert, Astron. Astrophys. 109 (1982) 195.
    """
    kept = slice(0, 3 if polarized else 1)
    degrees = coefficients.shape[1]
    directions = np.append(grid.direction_mu, -grid.mu0)
    basis = stokes_basis(degree_max=degrees - 1, order_max=max(modes), mu=directions)[min(modes) :, :, kept, :, kept]
    light = basis[:, :, :, :-1]
    stokes_count = light.shape[2]
    flat = light.reshape(len(modes), degrees * stokes_count, -1)
    weights = np.repeat(np.tile(grid.weights, 2), stokes_count)
    return Scattering(
        basis=flat,
        projector=np.ascontiguousarray(np.swapaxes(flat * weights, 1, 2)),
        beam=basis[:, :, :, -1, 0],
        coefficients=coefficients,
    )


def project(scattering: Scattering, radiance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expansion of a radiance over direction, shape (M, levels, L, S), from shape (levels, M, 2, N, S).

    Parameters
    ----------
    scattering
        With its projector onto the expansion.
    radiance
        At the levels, both ways, shape (levels, M, 2, N, S).
    """
    levels, modes = radiance.shape[:2]
    flat = radiance.reshape(levels, modes, -1).swapaxes(0, 1)
    return (flat @ scattering.projector).reshape(modes, levels, *scattering.beam.shape[1:])


def scattered_source(scattering: Scattering, moments: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Source of light scattered once more, shape (E, 3, M, 2, N, S), from an expansion at the levels.

    Parameters
    ----------
    scattering
        Matrices and basis.
    moments
        Expansion of the radiance at the levels, shape (M, levels, L, S).
    grid
        Levels and directions.

    References
    ----------
    Chandrasekhar, Radiative Transfer (1950), section 7: the source is half the integral over the cosine.
    """
    expansion = element_expansion(scattering.coefficients, moments)
    modes, elements, points, degrees, stokes_count = expansion.shape
    source = expansion.reshape(modes, elements * points, degrees * stokes_count) @ scattering.basis
    source *= 0.5
    shape = (modes, elements, points, 2, grid.nodes.size, stokes_count)
    return np.moveaxis(source.reshape(shape), 0, 2)


def element_expansion(coefficients: NDArray[np.float64], moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expansion of twice the source at the three points of each element, shape (M, E, 3, L, S).

    Parameters
    ----------
    coefficients
        Of the matrices of each element, shape (E, L, 4).
    moments
        Expansion of the radiance at the levels, shape (M, 2 E + 1, L, S).
    """
    points = 2 * np.arange(coefficients.shape[0])[:, np.newaxis] + np.arange(3)
    return apply_coefficients(coefficients[:, np.newaxis], moments[:, points])


def apply_coefficients(coefficients: NDArray[np.float64], expansion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Product of the matrices B_l of `stokes_basis` with an expansion (..., L, S); for S = 1 of a1 alone.

    Parameters
    ----------
    coefficients
        a1, a2, a3, b1 of each degree, shape (..., L, 4).
    expansion
        Shape (..., L, S), S of 1 or 3.

    References
    ----------
    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237.
    """
    if expansion.shape[-1] == 1:
        return coefficients[..., :1] * expansion
    # In one piece numpy's inner loop runs over degrees and components, not over the three components alone.
    product = np.ascontiguousarray(coefficients[..., :3]) * expansion
    product[..., 0] += coefficients[..., 3] * expansion[..., 1]
    product[..., 1] += coefficients[..., 3] * expansion[..., 0]
    return product


def beam_source(scattering: Scattering, grid: Grid) -> NDArray[np.float64]:
    """Source of the beam of unit irradiance in each element without its extinction, shape (E, M, 2, N, S).

    Parameters
    ----------
    scattering
        Matrices, basis and the beam's own expansion.
    grid
        Levels and directions.

    References
    ----------
    Chandrasekhar, Radiative Transfer (1950), section 7.
    """
    modes, degrees, stokes_count = scattering.beam.shape
    expansion = apply_coefficients(scattering.coefficients, scattering.beam[:, np.newaxis])
    source = expansion.reshape(modes, -1, degrees * stokes_count) @ scattering.basis
    shape = (modes, -1, 2, grid.nodes.size, stokes_count)
    return np.moveaxis(source.reshape(shape), 0, 1) / (4.0 * pi)
