"""Checks by the redundancy of more than three polarizer angles: pair sums, and the residual of the fit."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.reconstruction import Design

FloatArray = NDArray[np.float64]


def pair_sum_excess(plan: Design, channels: ArrayLike, cov: ArrayLike) -> tuple[float, float]:
    """Return by how much channels fail to fit one Stokes vector, as a share of the light.

    Parameters
    ----------
    plan
        Angles, N >= 4 of which at least three differ.
    channels
        Mean intensities of some light, shape (N,), dark level taken off.
    cov
        Covariance of that mean, shape (N, N).

    Returns
    -------
    excess, std_error : float
        Twice the largest residual over the mean of the channels: at 0, 45, 90, 135 deg and an ideal polarizer it is the
        difference of I0 + I90 and I45 + I135 over their mean. And the largest standard error of such a residual.

    Raises
    ------
    ValueError
        The mean of the channels is not above 0.
    """
    intensities = np.asarray(channels, dtype=np.float64)
    mean = float(intensities.mean())
    if not mean > 0.0:
        raise ValueError(f"the mean of the channels is {mean:.3g}; allowed is above 0")
    onto = plan.null_basis @ plan.null_basis.T
    variances = np.einsum("ij,jk,ik->i", onto, np.asarray(cov, dtype=np.float64), onto)
    return (
        float(2.0 * np.max(np.abs(onto @ intensities)) / mean),
        float(2.0 * np.sqrt(np.max(np.maximum(variances, 0.0))) / mean),
    )


def residual_chi_square(plan: Design, mean: ArrayLike, cov: ArrayLike) -> tuple[float, int]:
    """Return chi-square of what the fit of one Stokes vector leaves of mean channels, and its degrees of freedom.

    Parameters
    ----------
    plan
        Angles, N.
    mean, cov
        Mean channels and the covariance of that mean, shapes (N,) and (N, N).

    Raises
    ------
    ValueError
        The covariance leaves a residual without any variance.

    Notes
    -----
    It is the residual of generalised least squares with the whole covariance, for which no Stokes parameters are
    needed: K'I in its covariance K' cov K, with K the directions that no Stokes vector has. Zero with N = 3.
    """
    residual = plan.null_basis.T @ np.asarray(mean, dtype=np.float64)
    if residual.size == 0:
        return 0.0, 0
    spread = plan.null_basis.T @ np.asarray(cov, dtype=np.float64) @ plan.null_basis
    if not np.all(np.linalg.eigvalsh(spread) > 0.0):
        raise ValueError("cov gives a residual no variance; every direction without a Stokes vector needs one")
    return float(residual @ np.linalg.solve(spread, residual)), residual.size
