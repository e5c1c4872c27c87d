"""Decay of the degrees of a field, by its tiles."""

from math import isqrt

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre

FloatArray = NDArray[np.float64]


def decay(values: FloatArray) -> float | None:
    """Return by how much each degree of a field over tiles is below the one before; None for tiles too few to tell.

    Parameters
    ----------
    values
        Of the tiles, row by row, shape (n * n, 3).

    Notes
    -----
    Of the last three degrees, for odd and even ones may fall apart; of three tiles a side of the two there are.
    """
    per_side = isqrt(len(values))
    sizes = [float(np.sqrt(np.trace(part))) for part in _by_degree(_coefficients(values))]
    steps = min(per_side - 2, 2)
    if steps < 1 or sizes[-1 - steps] == 0.0:
        return None
    return float((sizes[-1] / sizes[-1 - steps]) ** (1.0 / steps))


def _coefficients(values: FloatArray) -> FloatArray:
    """Return those of the polynomial through the tiles, first over the height, shape (n, n, 3)."""
    per_side = isqrt(len(values))
    basis = _legendre(per_side)
    return np.asarray(np.einsum("ai,bj,ijc->abc", basis, basis, values.reshape(per_side, per_side, 3)))


def _by_degree(coefficients: FloatArray) -> list[FloatArray]:
    """Return the part of each degree from 1 on in the covariance, each (3, 3)."""
    degree = np.maximum(*np.indices(coefficients.shape[:2]))
    return [coefficients[degree == k].T @ coefficients[degree == k] for k in range(1, len(coefficients))]


def _legendre(per_side: int) -> FloatArray:
    """Return weights that give coefficients of orthonormal polynomials from values at the nodes, (degree, node)."""
    node, weight = gauss_legendre(per_side)
    plain = np.polynomial.legendre.legvander(2.0 * node - 1.0, per_side - 1)
    return np.asarray((plain * np.sqrt(2.0 * np.arange(per_side) + 1.0)).T * weight)
