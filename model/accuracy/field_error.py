"""What the number of tiles costs, from lines of sight between them: how far they are off the tiles' polynomial."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre

FloatArray = NDArray[np.float64]

# Places between the tiles, over the width and over the height of a region's part of the field: on no line of symmetry.
PLACES = np.array([[0.18, 0.33], [0.71, 0.12], [0.42, 0.64], [0.88, 0.55], [0.27, 0.87], [0.60, 0.39]])
# Errors over what the places say, of the mean and of the covariance: of fifty random fields with 3 x 3 to 5 x 5 tiles
# one mean and one covariance in fifty had more.
_OF_MEAN, _OF_COV = 0.5, 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldError:
    """Estimated error of the moments over a field.

    Attributes
    ----------
    mean
        Of each component, shape (3,).
    cov
        Of the covariance, diagonal, shape (3, 3).
    """

    mean: FloatArray
    cov: FloatArray


def field_error(values: FloatArray, between: FloatArray) -> FieldError:
    """Return the estimated error of mean and covariance over a field by n x n Gauss-Legendre tiles.

    Parameters
    ----------
    values
        Of the tiles, row by row, shape (n * n, 3), n 2 or more.
    between
        At `PLACES`, shape (P, 3).

    Notes
    -----
    What the polynomial through the tiles misses has some rms d at the places, the field a deviation s. The covariance
    lacks d^2, and has as much as s d too much or too little for what it takes for lower degrees.

    References
    ----------
    Definition.
    """
    per_side = round(len(values) ** 0.5)
    basis = _legendre(per_side)
    coefficients = np.einsum("ai,bj,ijc->abc", basis, basis, values.reshape(per_side, per_side, 3))
    missed = np.sqrt(np.mean((between - _read(coefficients)) ** 2, axis=0))
    coefficients[0, 0] = 0.0
    deviation = np.sqrt(np.sum(coefficients**2, axis=(0, 1)))
    return FieldError(mean=_OF_MEAN * missed, cov=np.diag(_OF_COV * missed * deviation + 2.0 * missed**2))


def _legendre(per_side: int) -> FloatArray:
    """Return weights that give coefficients of orthonormal polynomials from values at the nodes, (degree, node)."""
    node, weight = gauss_legendre(per_side)
    return np.asarray(_polynomials(node, per_side).T * weight)


def _read(coefficients: FloatArray) -> FloatArray:
    """Return a polynomial (n, n, 3), first over the height, at the places, shape (P, 3)."""
    across, upward = (_polynomials(place, len(coefficients)) for place in PLACES.T)
    return np.asarray(np.einsum("pa,pb,abc->pc", upward, across, coefficients))


def _polynomials(place: FloatArray, count: int) -> FloatArray:
    """Return the first so many orthonormal polynomials of 0 to 1 at places, shape (P, count)."""
    plain = np.polynomial.legendre.legvander(2.0 * place - 1.0, count - 1)
    return np.asarray(plain * np.sqrt(2.0 * np.arange(count) + 1.0))
