"""Stokes parameters from intensities behind a polarizer: design of the angles, and the inversion.

Channels (one per polarizer angle) stand on the FIRST axis here, as frames come from a camera: (N, H, W) gives
Stokes images (3, H, W). Moments keep their components last.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments, propagate_linear
from model.stokes import analyzer_row

FloatArray = NDArray[np.float64]

MODIFIED_PICKERING_RAD = (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4)

# Beyond this the error of an angle's calibration outgrows every noise.
_CONDITION_LIMIT = 1e6
# The best possible is sqrt 2; beyond this, angles are worth another look.
_CONDITION_FLAG = 5.0
# Relative size of a singular value that is rounding of sine and cosine.
_RANK_TOLERANCE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Design:
    """A set of polarizer angles with its system matrix and the inverse in use.

    Parameters
    ----------
    angles_rad
        Angles of the axis, shape (N,) [rad]; empty if the system matrix was measured without them.
    system
        System matrix M, shape (N, 3): intensities = M Stokes.
    inverse
        W, shape (3, N), with W M = 1: the pseudo-inverse, or the weighted inverse if variances were given.
    null_basis
        Orthonormal basis of the intensities that no light gives, shape (N, N - 3).
    condition
        Condition number of M in the 2-norm; sqrt 2 at best.
    ewv
        Equally weighted variance: sum of the variances of the three Stokes parameters, for unit variance in
        every channel or for the variances given.
    warnings
        What is allowed but poor, in words.

    References
    ----------
    [MK14] eq. (15), (23).
    """

    angles_rad: FloatArray
    system: FloatArray
    inverse: FloatArray
    null_basis: FloatArray
    condition: float
    ewv: float
    warnings: tuple[str, ...]

    @property
    def redundancy(self) -> int:
        """Number of channels beyond three: degrees of freedom of the residual."""
        return int(self.null_basis.shape[1])


def equispaced_rad(frames: int, *, start_rad: float = 0.0) -> FloatArray:
    """Return angles that are equally spaced over 180 deg, shape (frames,) [rad].

    Parameters
    ----------
    frames
        Number of frames, at least 3.
    start_rad
        First angle [rad].

    Raises
    ------
    ValueError
        If there are fewer than three frames.

    Notes
    -----
    Condition number sqrt 2 and equally weighted variance 20 / N for unit noise, whatever N and the start.

    References
    ----------
    J. S. Tyo, Appl. Opt. 41 (2002) 619, doi:10.1364/AO.41.000619.
    """
    if frames < 3:
        raise ValueError(f"frames = {frames}; allowed is 3 or more")
    return start_rad + np.pi * np.arange(frames) / frames


def design(
    angles_rad: ArrayLike,
    extinction_ratio: float = np.inf,
    *,
    tau_parallel: float = 1.0,
    variances: ArrayLike | None = None,
) -> Design:
    """Return the system matrix of a set of polarizer angles and its least-squares inverse.

    Parameters
    ----------
    angles_rad
        Angles of the transmission axis, shape (N,), N >= 3 [rad]. Angles equal modulo pi are repeats and
        are allowed as long as three differ.
    extinction_ratio
        tau_parallel / tau_perpendicular, above 1; infinite for an ideal polarizer.
    tau_parallel
        Power transmittance along the axis, in (0, 1].
    variances
        Variances of the channels for the weighted inverse, shape (N,), > 0, any common unit;
        None for equal ones.

    Returns
    -------
    Design
        With condition number and equally weighted variance.

    Raises
    ------
    ValueError
        If fewer than three angles differ modulo 180 deg, the condition number exceeds 1e6, or an argument is
        outside its range.

    References
    ----------
    [MK14] eq. (14), (15), (23); weighted inverse: definition.
    """
    angles = np.asarray(angles_rad, dtype=np.float64)
    if angles.ndim != 1 or angles.size < 3 or not np.all(np.isfinite(angles)):
        raise ValueError(f"angles_rad has shape {angles.shape}; allowed are three or more finite angles")
    if not extinction_ratio > 1.0:
        raise ValueError(f"extinction_ratio = {extinction_ratio}; allowed is above 1 (infinite if ideal)")
    rows = analyzer_row(angles, tau_parallel, tau_parallel / extinction_ratio)
    return _inverted(rows, angles, variances)


def design_from_system(system: ArrayLike) -> Design:
    """Return the least-squares inverse of a measured system matrix; it has no angles.

    Parameters
    ----------
    system
        M, shape (N, 3), N >= 3: intensities = M Stokes.

    Raises
    ------
    ValueError
        If the matrix has rank below 3 or a condition number above 1e6.

    References
    ----------
    [MK14] eq. (23).
    """
    rows = np.asarray(system, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3 or rows.shape[0] < 3 or not np.all(np.isfinite(rows)):
        raise ValueError(f"system has shape {rows.shape}; allowed is (N, 3) with N >= 3 and finite values")
    return _inverted(rows, np.empty(0), None)


def reconstruct(plan: Design, channels: ArrayLike) -> FloatArray:
    """Return the Stokes parameters W I of intensities I.

    Parameters
    ----------
    plan
        Angles and inverse.
    channels
        Intensities with black level and dark signal taken off, shape (N, ...): an offset d left in every
        channel adds 2 d to S0 and lowers DoLP.

    Returns
    -------
    ndarray
        Shape (3, ...), float64 (float32 if the channels are).

    Raises
    ------
    ValueError
        If the first axis is not N long.

    References
    ----------
    [MK14] eq. (21).
    """
    intensities = checked_channels(plan, channels)
    flat = intensities.reshape(intensities.shape[0], -1)
    stokes = plan.inverse.astype(intensities.dtype) @ flat
    return np.asarray(stokes.reshape(3, *intensities.shape[1:]))


def stokes_moments(plan: Design, channel_moments: Moments) -> Moments:
    """Return the moments of the Stokes parameters from those of the channels.

    Parameters
    ----------
    plan
        Angles and inverse.
    channel_moments
        Moments of the N channels (last axis), dark signal taken off.

    Returns
    -------
    Moments
        Mean W I and covariance W Sigma_I W', shapes (..., 3) and (..., 3, 3).

    References
    ----------
    [MK14] eq. (21), (22).
    """
    return propagate_linear(channel_moments, plan.inverse)


def checked_channels(plan: Design, channels: ArrayLike) -> FloatArray:
    """Return intensities as floating point with the angles of a design on the first axis.

    Parameters
    ----------
    plan
        Angles.
    channels
        Intensities, shape (N, ...).

    Returns
    -------
    ndarray
        float64, or float32 if given so.

    Raises
    ------
    ValueError
        If the first axis is not N long.
    """
    array = np.asarray(channels)
    if array.ndim == 0 or array.shape[0] != plan.system.shape[0]:
        raise ValueError(
            f"channels has shape {array.shape}; the first axis must hold the {plan.system.shape[0]} angles"
        )
    return array if array.dtype == np.float32 else array.astype(np.float64)


def _inverted(rows: FloatArray, angles: FloatArray, variances: ArrayLike | None) -> Design:
    singular = np.linalg.svd(rows, compute_uv=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf
    _require_condition(condition, angles)
    weights = _inverse_deviations(variances, rows.shape[0])
    q, r = np.linalg.qr(weights[:, None] * rows, mode="complete")
    inverse = np.linalg.solve(r[:3], q[:, :3].T) * weights
    null_basis = np.linalg.qr(rows, mode="complete")[0][:, 3:]
    return Design(
        angles_rad=angles,
        system=rows,
        inverse=inverse,
        null_basis=null_basis,
        condition=condition,
        ewv=float(np.sum((inverse / weights) ** 2)),
        warnings=_condition_warnings(condition, angles),
    )


def _inverse_deviations(variances: ArrayLike | None, channels: int) -> FloatArray:
    if variances is None:
        return np.ones(channels)
    values = np.asarray(variances, dtype=np.float64)
    if values.shape != (channels,) or np.any(~(values > 0.0)) or not np.all(np.isfinite(values)):
        raise ValueError(f"variances = {variances}; allowed are {channels} finite values above 0")
    return np.asarray(1.0 / np.sqrt(values))


def _require_condition(condition: float, angles: FloatArray) -> None:
    if condition * _RANK_TOLERANCE > 1.0:
        raise ValueError(f"rank is below 3{_named(angles)}; three angles that differ modulo 180 deg are needed")
    if condition > _CONDITION_LIMIT:
        raise ValueError(
            f"condition number is {condition:.3g}{_named(angles)}; allowed is at most {_CONDITION_LIMIT:g}: "
            "spread the angles over 180 deg"
        )


def _condition_warnings(condition: float, angles: FloatArray) -> tuple[str, ...]:
    if condition <= _CONDITION_FLAG:
        return ()
    advice = "noise and angle errors grow: spread the angles over 180 deg"
    return (f"condition number is {condition:.3g}{_named(angles)}, above {_CONDITION_FLAG:g}; {advice}",)


def _named(angles: FloatArray) -> str:
    if angles.size == 0:
        return " of the measured system matrix"
    reduced = ", ".join(f"{angle:.6g}" for angle in np.rad2deg(np.mod(angles, np.pi)))
    return f" for angles (modulo 180 deg) {reduced} deg"
