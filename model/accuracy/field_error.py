"""What the number of tiles costs, from lines of sight between them: how far they are off the tiles' polynomial."""

from dataclasses import dataclass
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre

FloatArray = NDArray[np.float64]

# Places between the tiles, over the width and over the height of a region's part of the field: on no line of symmetry.
PLACES = np.array([[0.18, 0.33], [0.71, 0.12], [0.42, 0.64], [0.88, 0.55], [0.27, 0.87], [0.60, 0.39]])
# Errors over what the places say, of the mean, and of the covariance over a smooth field and over any other: of the
# fields of 240 random scenes, 3 x 3 to 8 x 8 tiles, one in thirty had more where the error was above 1e-4.
_OF_MEAN, _OF_SMOOTH, _OF_COV = 0.5, 3.0, 0.75
# Of a smooth field a degree has at most this share of the one before, and what is missed no more than the next one.
_FALLING = 0.5
_TINY = 1e-300
# Of the largest component of an error what any may have at other places of the field.
_ELSEWHERE = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldError:
    """Estimated error of the moments over a field.

    Attributes
    ----------
    mean
        Of each component, shape (3,).
    cov
        Of the covariance, positive semi-definite, shape (3, 3).
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
    Let the polynomial through the tiles miss r, and let x be that part of the field which r can be mistaken for: of a
    field whose degrees fall regularly, also to those missed, the last degree and half of the one before; of any other
    all of it. The covariance lacks r r', and has as much as x r' + r x' too much or too little. The latter is at most
    a x x' + r r' / a, least where both are of one size; so the correlation of the components is kept.

    References
    ----------
    Definition.
    """
    coefficients = _coefficients(values)
    missed = between - _read(coefficients)
    lacking = missed.T @ missed / len(missed)
    mistaken, share = _mistaken_for(coefficients, float(np.trace(lacking)))
    balance = np.sqrt(np.trace(lacking) / max(float(np.trace(mistaken)), _TINY))
    mixed = share * (balance * mistaken + (lacking / balance if balance > 0.0 else 0.0))
    return FieldError(mean=_OF_MEAN * np.sqrt(np.diag(lacking)), cov=mixed + 2.0 * lacking)


def grown(cov: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return a covariance whose deviations have grown by the sizes of an error along each of its principal axes.

    Parameters
    ----------
    cov
        Positive semi-definite, shape (3, 3).
    sizes
        Of the error's components, each 0 or more and one above, shape (3,).

    References
    ----------
    Definition: axes and deviations in units of the sizes, each deviation by 1.
    """
    unit = np.maximum(sizes, _ELSEWHERE * np.max(sizes))
    values, vectors = np.linalg.eigh(cov / np.outer(unit, unit))
    roots = np.sqrt(np.maximum(values, 0.0)) + 1.0
    return np.asarray((vectors * roots**2) @ vectors.T * np.outer(unit, unit))


def decay(values: FloatArray) -> float | None:
    """Return by how much each degree of a field over tiles is below the one before; None for tiles too few to tell.

    Parameters
    ----------
    values
        Of the tiles, row by row, shape (n * n, 3).

    Notes
    -----
    Of the last three degrees, for odd and even ones may fall apart; of three tiles a side of the two there are.

    References
    ----------
    Definition.
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


def _mistaken_for(coefficients: FloatArray, lacking: float) -> tuple[FloatArray, float]:
    """Return the covariance of what may be mistaken for what is missed, shape (3, 3), and a share of it."""
    by_degree = _by_degree(coefficients)
    last, before = by_degree[-1], by_degree[-2] if len(by_degree) > 1 else np.zeros((3, 3))
    sizes = np.sqrt([np.trace(before), np.trace(last), lacking])
    if sizes[1] <= _FALLING * sizes[0] and sizes[2] * sizes[0] <= sizes[1] ** 2:
        return last + _FALLING**2 * before, _OF_SMOOTH
    return np.sum(by_degree, axis=0), _OF_COV


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
