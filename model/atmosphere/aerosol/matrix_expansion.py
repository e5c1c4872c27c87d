"""Scattering matrix of many spheres, summed at quadrature angles and expanded in generalised spherical functions."""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.aerosol.mie_sphere import amplitude_sums, efficiencies, sphere_coefficients, sphere_terms
from model.atmosphere.transfer.spherical_functions import matrix_functions

# Terms of the largest sphere of each group: spheres of one group share their angles.
_GROUP_TERMS = (16, 24, 36, 54, 80, 120, 180, 270, 400, 600, 900, 1350, 2200)
_CHUNK = 512  # spheres at once, to bound the memory


@dataclass(frozen=True, kw_only=True)
class AngularGrid:
    """Scattering angles for spheres in groups of like size: so many for each that integrals are exact.

    Attributes
    ----------
    terms
        Terms of the largest sphere of each group, G of them.
    starts
        Where the angles of each group begin in the arrays, G + 1 of them.
    mu, weight
        Cosines and Gauss weights over (-1, 1) of all groups, shape (A,).
    """

    terms: tuple[int, ...]
    starts: tuple[int, ...]
    mu: NDArray[np.float64]
    weight: NDArray[np.float64]


def angular_grid(*, largest_size_parameter: float) -> AngularGrid:
    """Angles for spheres up to a size parameter.

    Parameters
    ----------
    largest_size_parameter
        Circumference of the largest sphere over the wavelength, above 0.

    Notes
    -----
    The matrix of a sphere of T terms is a polynomial of degree 2T: so is its expansion, and 2T + 1 nodes integrate
    their product exactly.
    """
    most = int(sphere_terms(np.array([largest_size_parameter]))[0])
    terms = (*(limit for limit in _GROUP_TERMS if limit < most), most)
    rules = [_gauss_legendre(2 * limit + 1) for limit in terms]
    mu, weight = (np.concatenate(part) for part in zip(*rules, strict=True))
    starts = np.cumsum([0, *(rule[0].size for rule in rules)])
    return AngularGrid(terms=terms, starts=tuple(int(start) for start in starts), mu=mu, weight=weight)


def sphere_sums(
    grid: AngularGrid, *, size_parameter: NDArray[np.float64], weight: NDArray[np.float64], index: complex
) -> tuple[float, NDArray[np.float64]]:
    """Extinction, and scattering matrix at the angles of the grid, summed over spheres.

    Parameters
    ----------
    grid
        Angles for spheres as large as these.
    size_parameter
        Shape (N,), increasing.
    weight
        Weight of each sphere, shape (N,): its number times its geometrical cross-section.
    index
        n + ik, k >= 0.

    Returns
    -------
    extinction : float
        Sum of the extinction.
    matrix : ndarray, shape (4, A)
        F11, F22 + F33, F22 - F33 and F12; the mean of F11 over the sphere, groups added, is the sum of the scattering.

    References
    ----------
    Bohren & Huffman, Absorption and Scattering of Light by Small Particles (1983), eq. (4.77).
    """
    extinction, matrix = 0.0, np.zeros((4, grid.mu.size))
    bounds = [0, *np.searchsorted(sphere_terms(size_parameter), grid.terms, side="right")]
    for group, (first, stop) in enumerate(pairwise(bounds)):
        angles = slice(*grid.starts[group : group + 2])
        for start in range(first, stop, _CHUNK):
            chunk = slice(start, min(start + _CHUNK, stop))
            part = _chunk_sums(size_parameter[chunk], weight[chunk], index, grid.mu[angles])
            extinction += part[0]
            matrix[:, angles] += part[1]
    return extinction, matrix


def extinction_sum(*, size_parameter: NDArray[np.float64], weight: NDArray[np.float64], index: complex) -> float:
    """Sum over spheres of their extinction alone; arguments as in `sphere_sums`."""
    total = 0.0
    for start in range(0, size_parameter.size, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        a, b = sphere_coefficients(size_parameter=size_parameter[chunk], n=index.real, k=index.imag)
        total += float(weight[chunk] @ efficiencies(size_parameter=size_parameter[chunk], a=a, b=b).extinction)
    return total


def expand(grid: AngularGrid, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients a1, a2, a3, b1 of a matrix as `sphere_sums` has it, the groups added, shape (L, 4).

    Parameters
    ----------
    grid
        From `angular_grid`.
    matrix
        Elements at the angles of the grid, shape (4, A).

    Notes
    -----
    As in `model.atmosphere.transfer.phase.expansion_coefficients`; L is twice the terms of the largest sphere, plus 1.

    References
    ----------
    de Rooij & van der Stap, Astron. Astrophys. 131 (1984) 237, eqs. (117)-(122).
    """
    total = np.zeros((2 * grid.terms[-1] + 1, 4))
    for terms, (start, stop) in zip(grid.terms, pairwise(grid.starts), strict=True):
        weighted = matrix[:, start:stop] * grid.weight[start:stop]
        for degree, row in enumerate(matrix_functions(degree_max=2 * terms, mu=grid.mu[start:stop])):
            total[degree] += np.einsum("fa,fa->f", weighted, row)
    total *= np.arange(total.shape[0])[:, np.newaxis] + 0.5
    plain, plus, minus, mixed = total.T
    return np.stack([plain, (plus + minus) / 2.0, (plus - minus) / 2.0, mixed], axis=-1)


def _chunk_sums(
    size_parameter: NDArray[np.float64], weight: NDArray[np.float64], index: complex, mu: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Extinction and matrix of some spheres at some angles, as in `sphere_sums`."""
    a, b = sphere_coefficients(size_parameter=size_parameter, n=index.real, k=index.imag)
    extinction = float(weight @ efficiencies(size_parameter=size_parameter, a=a, b=b).extinction)
    plus, minus = amplitude_sums(a, b, mu)
    # The mean over the sphere of 4/x^2 F11 times the geometrical cross-section is that of scattering.
    share = 2.0 * weight / size_parameter**2
    sum_part = share @ (plus.real**2 + plus.imag**2)
    difference_part = share @ (minus.real**2 + minus.imag**2)
    mixed = share @ (plus.real * minus.real + plus.imag * minus.imag)
    return extinction, np.stack([(sum_part + difference_part) / 2.0, sum_part, difference_part, -mixed])


@cache
def _gauss_legendre(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on (-1, 1), by Newton's method: for thousands of nodes far faster than by eigenvalues."""
    mu = np.cos(np.pi * (np.arange(count, 0, -1) - 0.25) / (count + 0.5))
    slope = np.ones_like(mu)
    for _ in range(4):  # from an error of 1/count^2 of the spacing; each step squares it
        value, before = mu.copy(), np.ones_like(mu)
        for degree in range(1, count):
            value, before = ((2 * degree + 1) * mu * value - degree * before) / (degree + 1), value
        slope = count * (before - mu * value) / (1.0 - mu**2)
        mu = mu - value / slope
    return mu, 2.0 / ((1.0 - mu**2) * slope**2)
