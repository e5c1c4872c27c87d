"""Generalised least squares for Stokes parameters, with variances from the fit and a test of the residual.

Channels stand on the first axis, as in `model.processing.reconstruction`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincc

from model.processing.reconstruction import Design, checked_channels, reconstruct

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class WeightedReconstruction:
    """Stokes parameters by generalised least squares, with their own test.

    Parameters
    ----------
    stokes
        Shape (3, ...), in the unit of the channels.
    variances
        Channel variances from the fit, shape (N, ...).
    chi_square
        Residual in units of its variance, shape (...): chi-square with `degrees_of_freedom` if angles,
        transmittances and registration are right and nothing drifts; zero where there is no redundancy.
    degrees_of_freedom
        N - 3.
    """

    stokes: FloatArray
    variances: FloatArray
    chi_square: FloatArray
    degrees_of_freedom: int

    @property
    def p_value(self) -> FloatArray:
        """Chance of a residual at least this large if the design is right; 1 without redundancy."""
        if self.degrees_of_freedom == 0:
            return np.ones_like(self.chi_square)
        return np.asarray(gammaincc(0.5 * self.degrees_of_freedom, 0.5 * self.chi_square))


def reconstruct_weighted(
    plan: Design, channels: ArrayLike, *, gain_dn_per_e: float, floor_var_dn2: float, iterations: int = 2
) -> WeightedReconstruction:
    """Return Stokes parameters by generalised least squares with variances from the fit.

    Parameters
    ----------
    plan
        Angles. Its inverse gives the first fit.
    channels
        Counts with black level and dark signal taken off, shape (N, ...) [DN].
    gain_dn_per_e
        Counts per electron, > 0; 1 for channels in electrons.
    floor_var_dn2
        Variance without light: read noise, dark shot noise, quantisation [DN^2], >= 0.
    iterations
        How often variances are taken from the fit; two are enough.

    Returns
    -------
    WeightedReconstruction
        With the residual chi-square.

    Raises
    ------
    ValueError
        If the first axis is not N long, or gain or floor are out of range.

    Notes
    -----
    Variances come from the fitted light, not from raw counts: those are biased by about an electron and give
    a channel without counts infinite weight. Where fit and floor are both zero, the variance of one electron
    is taken. With N = 3 the result is M^-1 I, whatever the variances.

    References
    ----------
    Definition; Aitken's generalised least squares written as a correction of W I by the residual.
    """
    if not (gain_dn_per_e > 0.0 and floor_var_dn2 >= 0.0):
        raise ValueError(
            f"gain_dn_per_e = {gain_dn_per_e} and floor_var_dn2 = {floor_var_dn2}; "
            "allowed is gain > 0 DN/e- and floor >= 0 DN^2"
        )
    intensities = checked_channels(plan, channels).astype(np.float64)
    stokes = reconstruct(plan, intensities)
    for _ in range(iterations):
        variances = _fitted_variances(plan, stokes, gain_dn_per_e, floor_var_dn2)
        stokes, chi_square = weighted_fit(plan, intensities, variances)
    return WeightedReconstruction(
        stokes=stokes, variances=variances, chi_square=chi_square, degrees_of_freedom=plan.redundancy
    )


def weighted_fit(plan: Design, channels: ArrayLike, variances: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return Stokes parameters and residual chi-square for variances that may differ between pixels.

    Parameters
    ----------
    plan
        Angles.
    channels
        Intensities, shape (N, ...).
    variances
        Their variances, broadcast against `channels`, > 0.

    Returns
    -------
    stokes
        Shape (3, ...).
    chi_square
        Shape (...); chi-square with N - 3 degrees of freedom, zero if N = 3.

    Raises
    ------
    ValueError
        If the first axis is not N long or a variance is not positive.

    Notes
    -----
    With null basis K (K' M = 0), residual r = K' I and its covariance R = K' V K, the estimate is
    W (I - V K R^-1 r) and chi-square r' R^-1 r. M' V^-1 M is never formed.

    References
    ----------
    Definition.
    """
    intensities = checked_channels(plan, channels).astype(np.float64)
    spread = np.broadcast_to(np.asarray(variances, dtype=np.float64), intensities.shape)
    if np.any(~(spread > 0.0)):
        raise ValueError(f"variances has a value of {np.min(spread):.3g}; allowed is above 0")
    residual = np.tensordot(plan.null_basis.T, intensities, axes=1)
    solved = _solve_residual(plan.null_basis, spread, residual)
    corrected = intensities - spread * np.tensordot(plan.null_basis, solved, axes=1)
    return reconstruct(plan, corrected), np.sum(residual * solved, axis=0)


def _fitted_variances(plan: Design, stokes: FloatArray, gain: float, floor: float) -> FloatArray:
    light = np.tensordot(plan.system, stokes, axes=1)
    variances = gain * np.maximum(light, 0.0) + floor
    return np.where(variances > 0.0, variances, gain**2)


def _solve_residual(null_basis: FloatArray, variances: FloatArray, residual: FloatArray) -> FloatArray:
    if null_basis.shape[1] == 0:
        return residual
    if null_basis.shape[1] == 1:
        return residual / np.tensordot(null_basis[:, 0] ** 2, variances, axes=1)
    spread = np.einsum("nk,n...,nl->...kl", null_basis, variances, null_basis, optimize=True)
    solved = np.linalg.solve(spread, np.moveaxis(residual, 0, -1)[..., None])[..., 0]
    return np.moveaxis(solved, -1, 0)
