"""Checks by the redundancy of more than three polarizer angles: pair sums, and linear response."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.reconstruction import Design, reconstruct

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LinearResponse:
    """Slope of the residual of a fit against the square of the light.

    Attributes
    ----------
    curvature
        Share of the counts that a quadratic term of the response makes at the mean light; below 0 for a response that
        compresses.
    std_error
        Of it, from how the residual scatters.
    """

    curvature: float
    std_error: float


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


def linear_response(plan: Design, channels: ArrayLike) -> LinearResponse | None:
    """Return the quadratic term of the sensor's response that the residuals of many lights show.

    Parameters
    ----------
    plan
        Angles, N >= 4.
    channels
        Mean intensities of many lights, shape (N, P), such as blocks of pixels.

    Returns
    -------
    LinearResponse or None
        None where polarization is too alike, or the same everywhere, to tell.

    Notes
    -----
    Were the counts I + b I^2, the residual of the fit at 0, 45, 90, 135 deg would be b Q^2 cos(4 psi) / 2, of one sign
    where light is polarized along a channel and of the other between two. Residuals are fitted by that, and by shares
    of S0, S1 and S2 beside, which is what unequal transmittance and wrong angles make. The standard error takes the
    scatter of the residuals as it is (White 1980, doi:10.2307/1912934).
    """
    intensities = np.asarray(channels, dtype=np.float64)
    if plan.redundancy == 0 or intensities.shape[1] < 8 * (1 + 3 * plan.redundancy):
        return None
    stokes = reconstruct(plan, intensities)
    fitted = np.tensordot(plan.system, stokes, axes=1)
    known = (plan.null_basis.T @ fitted**2).ravel()
    others = np.kron(np.eye(plan.redundancy), stokes.T)
    residual = (plan.null_basis.T @ intensities).ravel()
    basis = np.linalg.qr(others)[0]
    along = known - basis @ (basis.T @ known)
    # Squares of what light without polarization leaves there by rounding are below this.
    if not along @ along > 1e-12 * np.sum(fitted**4):
        return None
    slope = float(along @ residual / (along @ along))
    left = residual - basis @ (basis.T @ residual) - slope * along
    light = float(intensities.mean())
    return LinearResponse(
        curvature=slope * light, std_error=light * float(np.sqrt(np.sum((along * left) ** 2)) / (along @ along))
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


def block_means(pictures: ArrayLike, usable: ArrayLike, *, side: int) -> NDArray[np.float64]:
    """Return the mean of each block all of whose pixels are usable.

    Parameters
    ----------
    pictures
        Shape (N, H, W).
    usable
        Shape (H, W), bool.
    side
        Of a block [pixel], >= 1; rows and columns that do not fill a block are left out.

    Returns
    -------
    array of float64, shape (N, B)
        B blocks, row by row; none where none is usable.
    """
    images, good = np.asarray(pictures, dtype=np.float64), np.asarray(usable, dtype=np.bool_)
    rows, columns = good.shape[0] // side, good.shape[1] // side
    cut = images[:, : rows * side, : columns * side].reshape(-1, rows, side, columns, side)
    whole = good[: rows * side, : columns * side].reshape(rows, side, columns, side).all(axis=(1, 3))
    return np.asarray(cut.mean(axis=(2, 4))[:, whole])
