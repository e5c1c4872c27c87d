"""A property of spheres at many wavelengths, from few at which it is computed."""

import numpy as np
from numpy.typing import NDArray


def chebyshev_wavelengths_m(*, shortest_m: float, longest_m: float, count: int) -> NDArray[np.float64]:
    """Wavelengths at which to compute what is smooth over a band, increasing [m].

    Parameters
    ----------
    shortest_m, longest_m
        Ends of the band [m].
    count
        How many, 1 or more.

    Raises
    ------
    ValueError
        The band or the count is empty.

    References
    ----------
    definition: zeros of the Chebyshev polynomial
    """
    if not 0.0 < shortest_m < longest_m:
        raise ValueError(f"shortest_m = {shortest_m!r} m must be above 0 and below longest_m = {longest_m!r} m")
    if count < 1:
        raise ValueError(f"count = {count!r}, allowed is 1 or more")
    zeros = np.cos(np.pi * (2.0 * np.arange(count, 0, -1) - 1.0) / (2.0 * count))
    return np.asarray((shortest_m + longest_m) / 2.0 + (longest_m - shortest_m) / 2.0 * zeros)


def lagrange_basis(*, nodes_m: NDArray[np.float64], wavelength_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Polynomials in 1/wavelength that are 1 at one node and 0 at the others, shape (nodes, N).

    Parameters
    ----------
    nodes_m
        Distinct wavelengths [m].
    wavelength_m
        Where to read the polynomials [m], shape (N,).
    """
    node, target = 1e-6 / nodes_m, 1e-6 / wavelength_m
    basis = np.ones((node.size, target.size))
    for i in range(node.size):
        for other in np.delete(node, i):
            basis[i] *= (target - other) / (node[i] - other)
    return basis
