"""The distribution of the RX statistic of a target seen against a background: the weights of a quadratic form."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair, require_covariance

FloatArray = NDArray[np.float64]

CONDITION_LIMIT = 1e12
_CONDITION_WARNING = 1e8
_ALIKE = 0.5  # largest entry of the whitened difference of covariances for which the difference is decomposed
_NO_SPREAD = 1e-30  # weight relative to the largest: below it a component is a constant


@dataclass(frozen=True, kw_only=True)
class DetectionDistribution:
    """D = constant + sum_j weights_j (z_j + offsets_j)^2, z standard normal, and the condition of the background.

    `weights` and `offsets` have shape (..., n), `constant` and `condition` the leading shape.
    """

    weights: FloatArray
    offsets: FloatArray
    constant: FloatArray
    condition: FloatArray


def detection_distribution(
    target_mean: ArrayLike, target_cov: ArrayLike, background_mean: ArrayLike, background_cov: ArrayLike
) -> DetectionDistribution:
    """Return the distribution of D = (x - m_b)' S_b^-1 (x - m_b) for x ~ N(m_t, S_t).

    Parameters
    ----------
    target_mean, background_mean
        Stokes vectors or channel values, shape (..., n), all of one unit.
    target_cov
        S_t, shape (..., n, n), that unit squared; may be singular or zero.
    background_cov
        S_b, shape (..., n, n); condition number at most 1e12.

    Returns
    -------
    DetectionDistribution
        Leading axes of the arguments broadcast.

    Raises
    ------
    ValueError
        If shapes do not fit, a covariance is none, or that of the background is singular to 1e-12.

    Notes
    -----
    Where the two covariances are alike, their difference is decomposed, so that a target equal to its background
    has weights of exactly 1; elsewhere singular values of a factor are taken, which keeps small weights accurate.

    References
    ----------
    [MK14] eq. (30); definition.
    """
    mean_t, cov_t = checked_pair(target_mean, target_cov)
    mean_b, cov_b = checked_pair(background_mean, background_cov)
    if mean_t.shape[-1] != mean_b.shape[-1]:
        raise ValueError(
            f"target_mean has {mean_t.shape[-1]} components and background_mean {mean_b.shape[-1]}; "
            "allowed is the same number"
        )
    require_covariance(cov_t, name="target_cov")
    condition = background_condition(cov_b)
    scale = np.sqrt(np.diagonal(cov_b, axis1=-2, axis2=-1))
    area = scale[..., :, None] * scale[..., None, :]
    root = np.linalg.cholesky(cov_b / area)
    shift = np.linalg.solve(root, ((mean_t - mean_b) / scale)[..., None])
    weights, axes = _principal_axes(root, cov_t / area, (cov_t - cov_b) / area)
    along = np.sum(axes * shift, axis=-2)
    return _distribution(weights, along, condition)


def background_condition(background_cov: FloatArray) -> FloatArray:
    """Return the condition number of each covariance.

    Parameters
    ----------
    background_cov
        Shape (..., N, N), any unit squared.

    Raises
    ------
    ValueError
        If one is no covariance, or singular to 1e-12: D would then be rounding error.
    """
    require_covariance(background_cov, name="background_cov")
    values = np.linalg.eigvalsh(background_cov)
    smallest, largest = values[..., 0], values[..., -1]
    bad = ~(smallest * CONDITION_LIMIT > largest)
    if np.any(bad):
        raise ValueError(
            f"background_cov is singular to double precision: its eigenvalues span {np.min(smallest[bad]):.3g} to "
            f"{np.max(largest[bad]):.3g}; allowed is a condition number of at most {CONDITION_LIMIT:g}. Leave out "
            "channels that are combinations of others, or add the noise that they really have"
        )
    return np.asarray(largest / smallest, dtype=np.float64)


def condition_warnings(condition: FloatArray) -> tuple[str, ...]:
    """Return what is to be said of the condition of the background, nothing where it is harmless.

    Parameters
    ----------
    condition
        Condition numbers, any shape, 1 or more.
    """
    worst = float(np.max(condition, initial=1.0))
    if worst <= _CONDITION_WARNING:
        return ()
    moved = worst * np.finfo(float).eps
    said = (
        f"background_cov has condition number {worst:.2g}: rounding of the arguments alone may move P_D by {moved:.1g}"
    )
    return (said,)


def _principal_axes(root: FloatArray, cov: FloatArray, difference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights and axes (as columns) of root^-1 cov root^-T."""
    whitened = _whitened(root, difference)
    values, axes = np.linalg.eigh(whitened)
    alike = np.max(np.abs(whitened), axis=(-2, -1)) < _ALIKE
    if np.all(alike):
        return 1.0 + values, axes
    other_axes, singular, _ = np.linalg.svd(np.linalg.solve(root, _graded_factor(cov)))
    weights = np.where(alike[..., None], 1.0 + values, singular**2)
    return weights, np.where(alike[..., None, None], axes, other_axes)


def _whitened(root: FloatArray, matrix: FloatArray) -> FloatArray:
    half = np.linalg.solve(root, matrix)
    full = np.linalg.solve(root, np.swapaxes(half, -1, -2))
    return np.asarray(0.5 * (full + np.swapaxes(full, -1, -2)), dtype=np.float64)


def _graded_factor(cov: FloatArray) -> FloatArray:
    """Return F with F F' = cov, from the correlation matrix: rows of very different size keep their accuracy."""
    variance = np.diagonal(cov, axis1=-2, axis2=-1)
    deviation = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    values, vectors = np.linalg.eigh(cov / (deviation[..., :, None] * deviation[..., None, :]))
    root = np.sqrt(np.maximum(values, 0.0))
    return np.asarray(deviation[..., :, None] * vectors * root[..., None, :], dtype=np.float64)


def _distribution(weights: FloatArray, along: FloatArray, condition: FloatArray) -> DetectionDistribution:
    largest = np.max(weights, axis=-1, keepdims=True)
    spread = weights > np.maximum(_NO_SPREAD * largest, np.finfo(float).tiny)
    kept = np.where(spread, weights, 0.0)
    offsets = np.where(spread, along / np.sqrt(np.where(spread, weights, 1.0)), 0.0)
    constant = np.sum(np.where(spread, 0.0, along**2), axis=-1)
    full = np.broadcast_shapes(kept.shape, offsets.shape)
    return DetectionDistribution(
        weights=np.broadcast_to(kept, full),
        offsets=offsets,
        constant=constant,
        condition=np.broadcast_to(condition, full[:-1]),
    )
