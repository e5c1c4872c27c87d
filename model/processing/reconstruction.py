"""Stokes parameters from intensities behind a polarizer: design, inversion, ratios and redundancy.

A `Design` holds the polarizer angles, the system matrix and its inverse. Ratios (s1, s2, AoLP, counts over their mean)
have first-order moments. With more than three angles, pair sums and the residual of the fit are checks.

Channels (one per polarizer angle) stand on the FIRST axis here, as frames come from a camera: (N, H, W) gives
Stokes images (3, H, W). Moments keep their components last.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import Moments, propagate_first_order, propagate_linear
from model.stokes import analyzer_row, aolp_rad

FloatArray = NDArray[np.float64]

MODIFIED_PICKERING_RAD = (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4)


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


def design_from_system(system: ArrayLike) -> Design:
    """Return the least-squares inverse of a measured system matrix; it has no angles.

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
    intensities = _checked_channels(plan, channels)
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


def normalized_moments(stokes: Moments) -> Moments:
    """Return first-order moments of (S1/S0, S2/S0).

    Parameters
    ----------
    stokes
        Moments of Stokes vectors, shape (..., 3), S0 > 0.

    Raises
    ------
    ValueError
        S0 is not above 0.

    References
    ----------
    Definition; delta method.
    """
    s0, s1, s2 = _with_light(stokes)
    none = np.zeros_like(s0)
    rows = [-s1 / s0**2, 1.0 / s0, none, -s2 / s0**2, none, 1.0 / s0]
    jacobian = np.stack(rows, axis=-1).reshape(*s0.shape, 2, 3)
    return propagate_first_order(stokes, np.stack([s1 / s0, s2 / s0], axis=-1), jacobian)


def aolp_moments_rad(stokes: Moments) -> Moments:
    """Return first-order moments, one component, of the AoLP of Stokes vectors [rad].

    Parameters
    ----------
    stokes
        Moments of Stokes vectors, shape (..., 3), polarised.

    Returns
    -------
    Moments
        Mean in [0, pi). The deviation means something only where it is small against 1 rad; `aolp_is_defined` says
        from where on it means nothing at all.

    Raises
    ------
    ValueError
        S0 is not above 0, or S1 = S2 = 0: there is no angle.

    References
    ----------
    Definition; delta method.
    """
    _, s1, s2 = _with_light(stokes)
    squared = s1 * s1 + s2 * s2
    if np.any(squared == 0.0):
        raise ValueError("S1 and S2 are both 0: unpolarised light has no angle of polarization")
    rows = [np.zeros_like(squared), -s2 / (2.0 * squared), s1 / (2.0 * squared)]
    jacobian = np.stack(rows, axis=-1)[..., None, :]
    return propagate_first_order(stokes, aolp_rad(stokes.mean)[..., None], jacobian)


def channel_ratios(channels: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the counts of each channel over the mean of all channels, and their standard errors to first order.

    Parameters
    ----------
    channels
        Mean counts, shape (N,), dark level taken off, with their covariance.

    Raises
    ------
    ValueError
        The mean of all channels is not above 0.

    Notes
    -----
    N ratios of which N - 1 are free: their mean is 1.
    """
    whole = float(channels.mean.mean())
    if not whole > 0.0:
        raise ValueError(f"the mean of all channels is {whole:.3g}; a ratio needs it above 0")
    ratios = channels.mean / whole
    count = channels.mean.size
    jacobian = (np.eye(count) - ratios[:, None] / count) / whole
    variances = np.einsum("ij,jk,ik->i", jacobian, channels.cov, jacobian)
    # Of an error that is common to all channels only rounding is left, of either sign.
    return ratios, np.sqrt(np.maximum(variances, 0.0))


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


# Relative size of a singular value that is rounding of sine and cosine.
_RANK_TOLERANCE = 1e-12

# Beyond this the error of an angle's calibration outgrows every noise.
_CONDITION_LIMIT = 1e6


def _require_condition(condition: float, angles: FloatArray) -> None:
    if condition * _RANK_TOLERANCE > 1.0:
        raise ValueError(f"rank is below 3{_named(angles)}; three angles that differ modulo 180 deg are needed")
    if condition > _CONDITION_LIMIT:
        raise ValueError(
            f"condition number is {condition:.3g}{_named(angles)}; allowed is at most {_CONDITION_LIMIT:g}: "
            "spread the angles over 180 deg"
        )


def _named(angles: FloatArray) -> str:
    if angles.size == 0:
        return " of the measured system matrix"
    reduced = ", ".join(f"{angle:.6g}" for angle in np.rad2deg(np.mod(angles, np.pi)))
    return f" for angles (modulo 180 deg) {reduced} deg"


def _inverse_deviations(variances: ArrayLike | None, channels: int) -> FloatArray:
    if variances is None:
        return np.ones(channels)
    values = np.asarray(variances, dtype=np.float64)
    if values.shape != (channels,) or np.any(~(values > 0.0)) or not np.all(np.isfinite(values)):
        raise ValueError(f"variances = {variances}; allowed are {channels} finite values above 0")
    return np.asarray(1.0 / np.sqrt(values))


# The best possible is sqrt 2; beyond this, angles are worth another look.
_CONDITION_FLAG = 5.0


def _condition_warnings(condition: float, angles: FloatArray) -> tuple[str, ...]:
    if condition <= _CONDITION_FLAG:
        return ()
    advice = "noise and angle errors grow: spread the angles over 180 deg"
    return (f"condition number is {condition:.3g}{_named(angles)}, above {_CONDITION_FLAG:g}; {advice}",)


def _checked_channels(plan: Design, channels: ArrayLike) -> FloatArray:
    """Return intensities as floating point with the angles of a design on the first axis."""
    array = np.asarray(channels)
    if array.ndim == 0 or array.shape[0] != plan.system.shape[0]:
        raise ValueError(
            f"channels has shape {array.shape}; the first axis must hold the {plan.system.shape[0]} angles"
        )
    return array if array.dtype == np.float32 else array.astype(np.float64)


def _with_light(stokes: Moments) -> FloatArray:
    """Return the means by component, shape (3, ...)."""
    if not np.all(stokes.mean[..., 0] > 0.0):
        raise ValueError(f"S0 is {np.min(stokes.mean[..., 0]):g}; normalised Stokes parameters need S0 above 0")
    return np.moveaxis(stokes.mean, -1, 0)


# Quantile of the standard normal distribution to which a two-sided interval of 95 % reaches.
_TWO_SIDED_95 = 1.959964


def aolp_is_defined(std_rad: ArrayLike) -> NDArray[np.bool_]:
    """Return whether an AoLP means anything: whether its 95 % interval is shorter than the half turn of all angles.

    Parameters
    ----------
    std_rad
        First-order standard deviation of the angle, any shape [rad]; 1.96 times it to either side is the interval.

    Returns
    -------
    array of bool
        False from 0.80 rad (45.9 deg) on, and where the deviation is not a number. Outputs for people then say
        "undefined" in place of a number with its error.
    """
    return np.asarray(_TWO_SIDED_95 * np.asarray(std_rad, dtype=np.float64) < 0.5 * np.pi)
