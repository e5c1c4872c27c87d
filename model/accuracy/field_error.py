"""What the number of tiles costs, from the decay of the field's expansion in Legendre polynomials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.quadrature import gauss_legendre

FloatArray = NDArray[np.float64]

# What the degrees beyond take from the covariance, over the square of the next: they also stand in for lower ones.
_BEYOND = 8.0
# Error of the mean over the size of the last degree, at least: the shadowing has a kink, and beyond it degrees fall
# slowly. Of fifty random fields with 3 x 3 and 4 x 4 tiles 95 % had no more.
_KINK = 0.03


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


def field_error(values: FloatArray) -> FieldError:
    """Return the estimated error of mean and covariance over a field by n x n Gauss-Legendre tiles.

    Parameters
    ----------
    values
        Of the tiles, row by row, shape (n * n, 3), n 2 or more.

    Notes
    -----
    The rule has the mean of a polynomial of degree 2 n - 1 and the covariance of one of degree n - 1. The degrees
    beyond are taken to go on falling as the last ones did.

    References
    ----------
    Definition.
    """
    per_side = round(len(values) ** 0.5)
    basis = _legendre(per_side)
    coefficients = np.einsum("ai,bj,ijc->abc", basis, basis, values.reshape(per_side, per_side, 3))
    degree = np.maximum(*np.indices((per_side, per_side)))
    sizes = np.stack([np.sqrt(np.sum(coefficients[degree == k] ** 2, axis=0)) for k in range(1, per_side)])
    last = coefficients[degree == per_side - 1]
    ratio = np.array([_ratio(size, abs(mean)) for size, mean in zip(sizes.T, coefficients[0, 0], strict=True)])
    rest = np.sqrt(_BEYOND * ratio**2 / np.maximum(1.0 - ratio**2, 0.05))
    return FieldError(
        mean=sizes[-1] * np.maximum(ratio ** (per_side + 1), _KINK),
        cov=np.outer(rest, rest) * (last.T @ last),
    )


def _ratio(sizes: FloatArray, mean: float) -> float:
    """Return by what one degree is smaller than the one before, at least a twentieth and at most 1."""
    if sizes.size == 1:
        return float(np.clip(np.sqrt(sizes[0] / mean), 0.05, 1.0)) if mean > 0.0 else 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = sizes[1:] / sizes[:-1]
    last = steps[-2:][np.isfinite(steps[-2:])]
    return float(np.clip(np.max(last, initial=0.05), 0.05, 1.0))


def _legendre(per_side: int) -> FloatArray:
    """Return weights that give coefficients of orthonormal polynomials from values at the nodes, (degree, node)."""
    node, weight = gauss_legendre(per_side)
    polynomials = np.polynomial.legendre.legvander(2.0 * node - 1.0, per_side - 1).T
    return np.asarray(polynomials * np.sqrt(2.0 * np.arange(per_side) + 1.0)[:, np.newaxis] * weight)
