"""Mean and covariance of random vectors, and their transformation by linear and smooth maps."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Mean and covariance of one random vector or of many.

    Parameters
    ----------
    mean
        Mean, shape (..., n), finite.
    cov
        Covariance, shape (..., n, n), finite, symmetric and positive semi-definite up to rounding
        (1e-12 of the trace). A singular covariance is allowed. Leading axes broadcast with those of `mean`.

    Raises
    ------
    ValueError
        If shapes do not fit, a value is not finite, or `cov` is not a covariance.

    Notes
    -----
    `cov` is stored exactly symmetric. Eigenvalues that are negative by rounding are kept and set to zero in a factor
    (`covariance_factor`). Both arrays are read-only.
    """

    mean: FloatArray
    cov: FloatArray

    def __post_init__(self) -> None:
        mean, cov = checked_pair(self.mean, self.cov)
        require_covariance(cov, name="cov")
        object.__setattr__(self, "mean", _frozen(mean))
        object.__setattr__(self, "cov", _frozen(0.5 * (cov + np.swapaxes(cov, -1, -2))))


def propagate_linear(moments: Moments, matrix: ArrayLike) -> Moments:
    """Return the moments of A x from those of x.

    Parameters
    ----------
    moments
        Moments of x, n components.
    matrix
        A, shape (..., m, n).

    Returns
    -------
    Moments
        Mean A mu and covariance A Sigma A'; exact.

    References
    ----------
    [MK14] eq. (22); definition.
    """
    a = np.asarray(matrix, dtype=np.float64)
    cov = a @ moments.cov @ np.swapaxes(a, -1, -2)
    return Moments(mean=np.einsum("...ij,...j->...i", a, moments.mean), cov=cov)


def propagate_first_order(moments: Moments, value: ArrayLike, jacobian: ArrayLike) -> Moments:
    """Return the first-order moments of a smooth function f(x) from those of x.

    The error is of second order in the deviations of x and is not estimated.

    [MK14] eq. (24)-(25) for DoLP; definition.
    """
    # If the largest variation drops out of f, like a common factor from a ratio, rounding makes J Sigma J' asymmetric
    # and indefinite; a product with its own transpose is neither.
    spread = np.asarray(jacobian, dtype=np.float64) @ covariance_factor(moments.cov)
    cov = spread @ np.swapaxes(spread, -1, -2)
    return Moments(mean=np.asarray(value, dtype=np.float64), cov=cov)


def checked_pair(mean: ArrayLike, cov: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance as float64 arrays whose shapes fit each other."""
    mean_array = np.asarray(mean, dtype=np.float64)
    cov_array = np.asarray(cov, dtype=np.float64)
    if mean_array.ndim < 1 or cov_array.shape[-2:] != (mean_array.shape[-1],) * 2:
        raise ValueError(
            f"mean of shape {mean_array.shape} and cov of shape {cov_array.shape} do not fit; "
            "allowed are (..., n) and (..., n, n)"
        )
    try:
        np.broadcast_shapes(mean_array.shape[:-1], cov_array.shape[:-2])
    except ValueError as error:
        raise ValueError(
            f"leading axes {mean_array.shape[:-1]} of mean and {cov_array.shape[:-2]} of cov do not broadcast"
        ) from error
    for name, array in (("mean", mean_array), ("cov", cov_array)):
        if not np.all(np.isfinite(array)):
            raise ValueError(f"{name} has {np.sum(~np.isfinite(array))} values that are not finite")
    return mean_array, cov_array


def covariance_factor(cov: ArrayLike) -> FloatArray:
    """Return a matrix F with F F' = cov, for singular covariances too."""
    array = np.asarray(cov, dtype=np.float64)
    require_covariance(array, name="cov")
    values, vectors = np.linalg.eigh(array)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :], dtype=np.float64)


# Rounding of a covariance W D W' is some eps times its trace; more is an error.
_ROUNDING = 1e-12


def require_covariance(cov: FloatArray, *, name: str) -> None:
    """Raise unless every matrix is symmetric and positive semi-definite up to rounding."""
    if cov.size == 0:
        return
    scale = np.sum(np.abs(np.diagonal(cov, axis1=-2, axis2=-1)), axis=-1)
    asymmetry = np.max(np.abs(cov - np.swapaxes(cov, -1, -2)), axis=(-2, -1))
    if np.any(asymmetry > _ROUNDING * scale):
        raise ValueError(f"{name} is not symmetric: entries differ by up to {np.max(asymmetry):.3g}")
    scaled = _scaled(cov, scale)
    unclear = scaled[~_clearly_definite(scaled)]
    lowest = np.linalg.eigvalsh(unclear)[..., 0] if unclear.size else np.zeros(1)
    if np.any(lowest < -_ROUNDING):
        raise ValueError(
            f"{name} is not positive semi-definite: smallest eigenvalue over trace is "
            f"{np.min(lowest):.3g}; allowed is at least {-_ROUNDING:g}"
        )


def rectangular_std(low: float, high: float) -> float:
    """Return the standard deviation of a number that is uniform between two limits.

    Parameters
    ----------
    low, high
        The limits, low <= high, in any unit.

    References
    ----------
    JCGM 100:2008 (GUM), section 4.3.7.
    """
    return (high - low) / math.sqrt(12.0)


def _scaled(cov: FloatArray, scale: FloatArray) -> FloatArray:
    """Divide by the trace, to allow units near the ends of the double range."""
    safe: Any = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(cov / safe[..., None, None], dtype=np.float64)


def _clearly_definite(scaled: FloatArray) -> NDArray[np.bool_]:
    """Return whether all pivots of the elimination are positive, far above rounding; much faster than eigenvalues."""
    rest = scaled
    clear = np.ones(scaled.shape[:-2], dtype=bool)
    while rest.shape[-1] > 0:
        pivot = rest[..., 0, 0]
        clear &= pivot > 1e-10
        row = rest[..., 0, 1:]
        safe = np.where(clear, pivot, 1.0)
        rest = rest[..., 1:, 1:] - row[..., :, None] * row[..., None, :] / safe[..., None, None]
    return clear


def _frozen(array: FloatArray) -> FloatArray:
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy
