"""Mean and variance of DoLP by expansion around the mean Stokes parameters, first and second order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair
from model.stokes import checked_stokes, require_positive_intensity

FloatArray = NDArray[np.float64]

# A variance that cancels to zero, as for a common factor, is negative by no more than this share of its terms.
_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class Expansion:
    """Mean and variance of DoLP from an expansion, each of shape (...).

    Parameters
    ----------
    mean
        Mean of DoLP.
    variance
        Its variance. The second-order one is negative where the expansion has broken down.
    """

    mean: FloatArray
    variance: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Local:
    """Covariance relative to S0, in axes along S0, along the polarization (e) and across it (t)."""

    p: FloatArray
    v00: FloatArray
    v0e: FloatArray
    v0t: FloatArray
    vee: FloatArray
    vet: FloatArray
    vtt: FloatArray


def first_order(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> Expansion:
    """Return DoLP at the mean and its first-order variance: fast, for pictures.

    Parameters
    ----------
    stokes_mean
        Shape (..., 3), S0 > 0.
    stokes_cov
        Shape (..., 3, 3), in the square of the unit of `stokes_mean`. Not checked to be a covariance, for speed.

    Returns
    -------
    Expansion
        Mean P and variance a' Sigma a, a = (-P, cos 2 psi, sin 2 psi) / S0. Where P = 0 the direction has no
        meaning: that of S1 is taken, and neither moment is of use there.

    Raises
    ------
    ValueError
        If shapes do not fit, a value of S0 is not positive, or a variance comes out negative.

    Notes
    -----
    Good where Q is many standard deviations; the relative error of the mean is about (sigma_Q / Q)^2 / 2.

    Differs from [MK14]: eq. (25) as printed lacks the squares on a2 and a3, and the ordered pairs.

    References
    ----------
    [MK14] eq. (24)-(28).
    """
    mean, cov = _checked(stokes_mean, stokes_cov)
    cos, sin, p = _direction(mean)
    own = p**2 * cov[..., 0, 0] + cos**2 * cov[..., 1, 1] + sin**2 * cov[..., 2, 2]
    shared = cos * sin * cov[..., 1, 2] - p * (cos * cov[..., 0, 1] + sin * cov[..., 0, 2])
    total = own + 2.0 * shared
    # Counts that are hardly polarized share all their fluctuation but for rounding, which is a share of that of S0.
    if np.any(total < -_ROUNDING * np.trace(cov, axis1=-2, axis2=-1)):
        raise ValueError("stokes_cov gives a negative variance of DoLP: it is not positive semi-definite")
    variance = np.maximum(total, 0.0) / mean[..., 0] ** 2
    return Expansion(mean=np.broadcast_to(p, variance.shape)[()], variance=variance)


def second_order(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> Expansion:
    """Return mean and variance of DoLP with all terms of second order in the covariance.

    Parameters
    ----------
    stokes_mean
        Shape (..., 3), S0 > 0 and (S1, S2) not zero.
    stokes_cov
        Shape (..., 3, 3), in the square of the unit of `stokes_mean`.

    Returns
    -------
    Expansion
        The variance may be negative: then the expansion has broken down. Infinite or not a number where P = 0.

    Raises
    ------
    ValueError
        If shapes do not fit or a value of S0 is not positive.

    Notes
    -----
    Never to be used where Q is below three standard deviations.

    References
    ----------
    Definition (Taylor expansion to fourth order in the deviations).
    """
    mean, cov = _checked(stokes_mean, stokes_cov)
    local = _local(mean, cov)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return Expansion(mean=_second_mean(local), variance=_first_variance(local) + _variance_excess(local))


def _checked(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> tuple[FloatArray, FloatArray]:
    mean, cov = checked_pair(stokes_mean, stokes_cov)
    require_positive_intensity(checked_stokes(mean))
    return mean, cov


def _direction(mean: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cosine and sine of the doubled polarization angle and DoLP; the direction of S1 where DoLP is 0."""
    length = np.hypot(mean[..., 1], mean[..., 2])
    none = length == 0.0
    safe = np.where(none, 1.0, length)
    return np.where(none, 1.0, mean[..., 1] / safe), mean[..., 2] / safe, length / mean[..., 0]


def _local(mean: FloatArray, cov: FloatArray) -> _Local:
    cos, sin, p = _direction(mean)
    v = cov / (mean[..., 0] ** 2)[..., None, None]
    v01, v02, v11, v12, v22 = v[..., 0, 1], v[..., 0, 2], v[..., 1, 1], v[..., 1, 2], v[..., 2, 2]
    return _Local(
        p=p,
        v00=v[..., 0, 0],
        v0e=cos * v01 + sin * v02,
        v0t=cos * v02 - sin * v01,
        vee=cos**2 * v11 + 2.0 * cos * sin * v12 + sin**2 * v22,
        vet=cos * sin * (v22 - v11) + (cos**2 - sin**2) * v12,
        vtt=sin**2 * v11 - 2.0 * cos * sin * v12 + cos**2 * v22,
    )


def _first_variance(v: _Local) -> FloatArray:
    return np.asarray(v.p**2 * v.v00 - 2.0 * v.p * v.v0e + v.vee)


def _second_mean(v: _Local) -> FloatArray:
    return np.asarray(v.p + v.p * v.v00 - v.v0e + v.vtt / (2.0 * v.p))


def _variance_excess(v: _Local) -> FloatArray:
    """Return tr(H V H V) / 2 + g_i T_jkl V_ij V_kl with the derivatives of sqrt((P + e)^2 + t^2) / (1 + d0)."""
    p = v.p
    a0, ae, at = v.v0e - p * v.v00, v.vee - p * v.v0e, v.vet - p * v.v0t
    third = a0 * (4.0 * v.v0e - 6.0 * p * v.v00 - v.vtt / p)
    third = third + ae * (2.0 * v.v00 - v.vtt / p**2) - 2.0 * at * (v.v0t / p + v.vet / p**2)
    return np.asarray(0.5 * _hessian_square(v) + third)


def _hessian_square(v: _Local) -> FloatArray:
    """Return tr(H V H V), H having the entries 2P (00), -1 (0e) and 1/P (tt)."""
    p = v.p
    b00, b0e, b0t = 2.0 * p * v.v00 - v.v0e, 2.0 * p * v.v0e - v.vee, 2.0 * p * v.v0t - v.vet
    be0, bee, bet = -v.v00, -v.v0e, -v.v0t
    bt0, bte, btt = v.v0t / p, v.vet / p, v.vtt / p
    diagonal = b00**2 + bee**2 + btt**2
    return np.asarray(diagonal + 2.0 * (b0e * be0 + b0t * bt0 + bet * bte))
