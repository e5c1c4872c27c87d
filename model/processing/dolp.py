"""Moments of DoLP to a tolerance, and the public names of its distribution.

Everything is a deviation from p0 = |mean of (S1, S2)| / mean of S0, so that digits do not cancel at high
signal-to-noise ratio: with Q = sqrt(S1^2 + S2^2) and q(z) = |mean of (S1, S2) given S0|,

    E[P | z] - p0 = (q - p0 S0) / S0 + (E[Q | z] - q) / S0,        var P = E var(Q | z) / S0^2 + var E[P | z].

DoLP divides by S0. If S0 can come close to zero, the density of DoLP falls so slowly that the mean diverges
logarithmically and the variance like the inverse of a cut-off. If their computed dependence on the cut-off is below the
tolerance, the moments exist in practice.

Stokes parameters are on the last axis; all leading axes broadcast. DoLP is the naive one, sqrt(S1^2 + S2^2) / S0 of
the noisy Stokes parameters: biased upward and above 1 with some probability.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair
from model.numerics import gauss_hermite, ndtr
from model.processing.dolp_law import (
    DolpFrame,
    cdf,
    distribution_tails,
    dolp_frame,
    pdf,
    probability_above,
    quantile,
)
from model.stokes import checked_stokes, require_positive_intensity

FloatArray = NDArray[np.float64]

__all__ = [
    "DolpMoments",
    "cdf",
    "distribution_tails",
    "first_order",
    "moments",
    "pdf",
    "probability_above",
    "quantile",
    "second_order",
]


@dataclass(frozen=True, kw_only=True)
class DolpMoments:
    """Mean and standard deviation of DoLP, each field of the broadcast leading shape.

    Parameters
    ----------
    mean, std
        Moments; nan if they do not exist at the tolerance.
    snr
        mean / std. Unpolarized light has 1.913 with S0 known: a value below 2 is no evidence of polarization.
    method
        "first order", "second order", "quadrature" or "none".
    mean_error, std_error
        Estimated absolute errors.
    exists
        Whether the moments exist at the tolerance.
    reason
        Reason if they do not exist.
    """

    mean: FloatArray
    std: FloatArray
    snr: FloatArray
    method: NDArray[np.str_]
    mean_error: FloatArray
    std_error: FloatArray
    exists: NDArray[np.bool_]
    reason: NDArray[np.str_]


_FIRST, _SECOND, _EXACT, _NONE = "first order", "second order", "quadrature", "none"

# Share of the tolerance allowed for an estimated error, which may be low by a factor of two.
_MARGIN = 0.25
_REFINEMENTS = 2


def moments(
    stokes_mean: ArrayLike, stokes_cov: ArrayLike, *, tolerance: float = 1e-9, existing_to: float | None = None
) -> DolpMoments:
    """Return mean, standard deviation and signal-to-noise ratio of DoLP to a stated relative tolerance.

    Parameters
    ----------
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), in the square of that unit, positive semi-definite; singular is allowed.
    tolerance
        Allowed relative error of mean and standard deviation, > 0. The cheapest sufficient method is used: expansion to
        first order, to second order, or quadrature (error about 1e-13).
    existing_to
        Tolerance at which moments must exist, if smaller than `tolerance`; None for the same.

    Returns
    -------
    DolpMoments
        With method, estimated errors, and the reason for missing moments.

    Raises
    ------
    ValueError
        If the arguments are not a mean and a covariance, S0 > 0 has no probability, or the tolerance is not positive.

    Notes
    -----
    Moments exist at the tolerance if another treatment of S0 below 1 % of its mean changes them by less. Otherwise
    quantiles exist (`quantile`). All moments are given S0 > 0.

    Differs from [MK14]: eq. (24) is DoLP at the mean, not the mean of DoLP, and eq. (25) its first-order variance;
    both fail where S1 and S2 are few standard deviations from zero, whatever the signal-to-noise ratio of S0.

    References
    ----------
    [MK14] eq. (24)-(29).
    """
    if not tolerance > 0.0:
        raise ValueError(f"tolerance = {tolerance}; allowed is above 0")
    frame, shape = dolp_frame(stokes_mean, stokes_cov)
    numbers, method = _expanded(frame, stokes_mean, stokes_cov, shape, tolerance)
    doubt_of_mean, doubt_of_square, dark = _ambiguity(frame)
    existing_to = tolerance if existing_to is None else min(existing_to, tolerance)
    pending = np.flatnonzero((method == _NONE) & (frame.mean_0 > 0.0) & (dark <= existing_to))
    for refinement in range(_REFINEMENTS + 1):
        numbers[:, pending], method[pending] = _exact_moments(frame[pending], refinement=refinement), _EXACT
        mean, std, mean_error, std_error = numbers[:, pending]
        pending = pending[~((mean_error <= tolerance * mean) & (std_error <= tolerance * std))]
    mean, std, mean_error, std_error = numbers
    with np.errstate(invalid="ignore", divide="ignore"):
        doubt_of_std = np.where(doubt_of_square > 0.0, doubt_of_square / (2.0 * std), 0.0)
        defined = (doubt_of_mean <= existing_to * mean) & (doubt_of_std <= existing_to * std)
        exists = defined & (dark <= existing_to) & (frame.mean_0 > 0.0)
        snr = mean / std

    def shaped(values: FloatArray) -> FloatArray:
        return np.where(exists, values, np.nan).reshape(shape)[()]

    return DolpMoments(
        mean=shaped(mean),
        std=shaped(std),
        snr=shaped(snr),
        method=np.where(exists, method, _NONE).reshape(shape)[()],
        mean_error=shaped(mean_error + doubt_of_mean),
        std_error=shaped(std_error + doubt_of_std),
        exists=exists.reshape(shape)[()],
        reason=_reasons(frame, exists, existing_to).reshape(shape)[()],
    )


@dataclass(frozen=True, kw_only=True)
class Expansion:
    """Mean and variance of DoLP from an expansion, each of shape (...)."""

    mean: FloatArray
    variance: FloatArray


# Largest negative share of its terms for a variance that cancels to zero, as for a common factor.
_ROUNDING = 1e-12


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
        Mean P and variance a' Sigma a, a = (-P, cos 2 psi, sin 2 psi) / S0. For P = 0 the direction of S1 is used, and
        neither moment is meaningful.

    Raises
    ------
    ValueError
        If shapes do not fit, a value of S0 is not positive, or a variance comes out negative.

    Notes
    -----
    Accurate for Q of many standard deviations; the relative error of the mean is about (sigma_Q / Q)^2 / 2.

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
    # Weakly polarized counts share their fluctuation to rounding, which is relative to that of S0.
    if np.any(total < -_ROUNDING * np.trace(cov, axis1=-2, axis2=-1)):
        raise ValueError("stokes_cov gives a negative variance of DoLP: it is not positive semi-definite")
    variance = np.maximum(total, 0.0) / mean[..., 0] ** 2
    return Expansion(mean=np.broadcast_to(p, variance.shape)[()], variance=variance)


# Least distance of an expansion from the kink at S1 = S2 = 0, and from S0 = 0.
_LEAST_SNR = 4.0


def _expanded(
    frame: DolpFrame, stokes_mean: ArrayLike, stokes_cov: ArrayLike, shape: tuple[int, ...], tolerance: float
) -> tuple[FloatArray, NDArray[np.str_]]:
    """Return mean, deviation and their errors, (4, M), by the expansions that meet the tolerance, and the methods."""
    numbers, method = np.full((4, len(frame)), np.nan), np.full(len(frame), _NONE, dtype="<U12")
    index = np.flatnonzero(_least_snr(frame) > _LEAST_SNR)
    mean, cov = checked_pair(stokes_mean, stokes_cov)
    mean = np.broadcast_to(mean, (*shape, 3)).reshape(-1, 3)[index]
    cov = np.broadcast_to(cov, (*shape, 3, 3)).reshape(-1, 3, 3)[index]
    first, second = first_order(mean, cov), second_order(mean, cov)
    first_std, second_std = _root(first.variance), _root(second.variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The relative size of terms beyond second order.
        changes = np.abs(second.mean / first.mean - 1.0), np.abs(second_std / first_std - 1.0)
        far = 1.0 / _least_snr(frame[index]) ** 2
        rest = _NEXT_ORDER * np.maximum(np.maximum(*changes), far) ** 2
        errors = rest * first.mean, rest * first_std
        of_first = np.abs(second.mean - first.mean) + errors[0], np.abs(second_std - first_std) + errors[1]
    for name, found in (
        (_SECOND, np.array([second.mean, second_std, *errors])),
        (_FIRST, np.array([first.mean, first_std, *of_first])),
    ):
        good = np.all(found[2:] <= _MARGIN * tolerance * found[:2], axis=0)
        numbers[:, index[good]], method[index[good]] = found[:, good], name
    return numbers, method


# Factor on the square of the largest relative correction, for the terms beyond second order.
_NEXT_ORDER = 4.0


def _least_snr(frame: DolpFrame) -> FloatArray:
    """Return the smaller distance, in standard deviations, to S1 = S2 = 0 and to S0 = 0."""
    bright = np.maximum(frame.mean_0, frame.sigma_0)
    common = np.hypot(frame.excess_1, frame.excess_2) / bright
    spread = np.sqrt(common**2 + frame.radius_1**2 + frame.radius_2**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        polarized = np.where(frame.polarized > 0.0, frame.polarized / spread, 0.0)
    return np.asarray(np.minimum(polarized, frame.snr_0))


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
        A negative variance shows that the expansion fails. Infinite or nan for P = 0.

    Raises
    ------
    ValueError
        If shapes do not fit or a value of S0 is not positive.

    Notes
    -----
    Do not use for Q below three standard deviations.

    References
    ----------
    Definition (Taylor expansion to fourth order in the deviations).
    """
    mean, cov = _checked(stokes_mean, stokes_cov)
    cos, sin, p = _direction(mean)
    # Covariance relative to S0, in axes along S0, along the polarization (e) and across it (t).
    v = cov / (mean[..., 0] ** 2)[..., None, None]
    v00, v01, v02, v11, v12, v22 = (v[..., i, j] for i in range(3) for j in range(i, 3))
    v0e, v0t = cos * v01 + sin * v02, cos * v02 - sin * v01
    vee = cos**2 * v11 + 2.0 * cos * sin * v12 + sin**2 * v22
    vet = cos * sin * (v22 - v11) + (cos**2 - sin**2) * v12
    vtt = sin**2 * v11 - 2.0 * cos * sin * v12 + cos**2 * v22
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # tr(H V H V) with the second derivatives 2P (00), -1 (0e), 1/P (tt) of sqrt((P + e)^2 + t^2) / (1 + d0).
        diagonal = (2.0 * p * v00 - v0e) ** 2 + v0e**2 + (vtt / p) ** 2
        mixed = -(2.0 * p * v0e - vee) * v00 + (2.0 * p * v0t - vet) * v0t / p - v0t * vet / p
        # Gradient times third derivatives, g_i T_jkl V_ij V_kl.
        a0, ae, at = v0e - p * v00, vee - p * v0e, vet - p * v0t
        third = a0 * (4.0 * v0e - 6.0 * p * v00 - vtt / p)
        third = third + ae * (2.0 * v00 - vtt / p**2) - 2.0 * at * (v0t / p + vet / p**2)
        first_variance = p**2 * v00 - 2.0 * p * v0e + vee
        variance = first_variance + 0.5 * (diagonal + 2.0 * mixed) + third
        return Expansion(mean=np.asarray(p + p * v00 - v0e + vtt / (2.0 * p)), variance=np.asarray(variance))


def _root(variance: FloatArray) -> FloatArray:
    """Return the square root; nan without a warning if an expansion has failed."""
    return np.sqrt(np.where(variance >= 0.0, variance, np.nan))


# Cut-offs between this share of the mean of S0 and the mean count as equally good.
_CUT_OFF = 0.01


def _ambiguity(frame: DolpFrame) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the change of mean and mean square of DoLP with the cut-off near S0 = 0, and Pr(S0 < 0)."""
    sigma = np.where(frame.sigma_0 > 0.0, frame.sigma_0, 1.0)
    snr = np.where(frame.sigma_0 > 0.0, frame.mean_0 / sigma, np.inf)
    at_zero = np.exp(-0.5 * np.minimum(snr**2, 1500.0)) / (sigma * np.sqrt(2.0 * np.pi))
    # (S1, S2) given S0 = 0 is the excess over a common factor, in units of sigma_0.
    square = (frame.excess_1**2 + frame.excess_2**2) / sigma**2 + frame.radius_1**2 + frame.radius_2**2
    bright = np.maximum(frame.mean_0, 1e-300)
    known = frame.sigma_0 == 0.0
    of_mean = np.where(known, 0.0, -at_zero * np.sqrt(square) * np.log(_CUT_OFF))
    of_square = np.where(known, 0.0, at_zero * square / (_CUT_OFF * bright))
    return of_mean, of_square, np.where(known, 0.0, ndtr(-snr))


# Lower end of S0 as a share of its mean: moments that depend on smaller values do not exist.
_LEAST_INTENSITY = 0.01
_INTENSITY_STEP = 0.1
_NODE_CLASSES = (1, 40, 80, 160, 512, 1024, 2048)


def _exact_moments(frame: DolpFrame, *, refinement: int) -> FloatArray:
    """Return mean and standard deviation of DoLP by quadrature, with their estimated errors, shape (4, M)."""
    centre, width = _outer_map(frame)
    low, high = _outer_ends(centre, width)
    needed = 2.0**refinement * (high - low) / _INTENSITY_STEP + 1.0
    needed[frame.sigma_0 == 0.0] = 1.0
    found = np.zeros((4, len(frame)))
    previous = 0.0
    for count in _NODE_CLASSES:
        chosen = np.flatnonzero((needed > previous) & ((needed <= count) | (count == _NODE_CLASSES[-1])))
        for part in _chunks(chosen, max(1, 16384 // count)):
            rule = _outer_rule(frame[part], centre[part], width[part], count)
            found[:, part] = _with_outer_rule(frame[part], *rule)
        previous = count
    return found


# Covered standard deviations of S0; the probability beyond is 2e-21.
_REACH = 9.5


def _outer_map(frame: DolpFrame) -> tuple[FloatArray, FloatArray]:
    """Return centre and scale of z = centre + scale sinh(tau): where (S1, S2) given S0 passes close to zero."""
    slope_squared = frame.slope_1**2 + frame.slope_2**2
    moving = slope_squared > 0.0
    safe = np.where(moving, slope_squared, 1.0)
    nearest = -(frame.mean_1 * frame.slope_1 + frame.mean_2 * frame.slope_2) / safe
    miss = (frame.mean_1 * frame.slope_2 - frame.mean_2 * frame.slope_1) / np.sqrt(safe)
    scale = np.hypot(miss, frame.radius_2) / np.sqrt(safe)
    passes = moving & (np.abs(nearest) < _REACH) & (scale < 3.0)
    return np.where(passes, nearest, 0.0), np.where(passes, np.clip(scale, 1e-8, 3.0), 3.0)


def _outer_ends(centre: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.arcsinh((-_REACH - centre) / width), np.arcsinh((_REACH - centre) / width)


def _outer_rule(frame: DolpFrame, centre: FloatArray, width: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes z and weights, shape (M, count), for the mean over a standard normal z with S0 > 0."""
    if count == 1:
        return np.zeros((len(frame), 1)), np.ones((len(frame), 1))
    low, high = _outer_ends(centre, width)
    tau = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, count)
    z = centre[:, None] + width[:, None] * np.sinh(tau)
    weights = np.exp(-0.5 * z**2) * np.cosh(tau)
    return z, np.where(z > -(1.0 - _LEAST_INTENSITY) * frame.snr_0[:, None], weights, 0.0)


def _with_outer_rule(frame: DolpFrame, z: FloatArray, weights: FloatArray) -> FloatArray:
    """Return mean, standard deviation and their estimated errors, shape (4, M)."""
    p0 = (frame.polarized / frame.mean_0)[:, None]
    deviation, variance = _given_intensity(frame, z, weights, p0)
    mean, std = _combined(deviation, variance, weights)
    every_other = np.zeros_like(weights)
    every_other[:, ::2] = weights[:, ::2]
    coarse_mean, coarse_std = _combined(deviation, variance, every_other)
    rounding = 1e-15 * p0[:, 0]
    return np.stack(
        [
            p0[:, 0] + mean,
            std,
            np.abs(mean - coarse_mean) + 1e-14 * np.abs(mean) + rounding,
            np.abs(std - coarse_std) + 1e-13 * std,
        ]
    )


def _given_intensity(
    frame: DolpFrame, z: FloatArray, weights: FloatArray, p0: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return E[P | z] - p0 and var(P | z), shape (M, count)."""
    used = weights > 0.0
    s0 = np.where(used, frame.mean_0[:, None] + frame.sigma_0[:, None] * z, 1.0)
    first = frame.mean_1[:, None] + frame.slope_1[:, None] * z
    second = frame.mean_2[:, None] + frame.slope_2[:, None] * z
    length = np.hypot(first, second)
    row, column = np.nonzero(used)
    pulled, spread = np.zeros_like(z), np.zeros_like(z)
    pulled[row, column], spread[row, column] = rice_moments(
        first[row, column], second[row, column], frame.radius_1[row], frame.radius_2[row]
    )
    slide = _slide(frame, z, length, p0, s0)
    return (slide + pulled) / s0, spread / s0**2


# Standard deviations beyond which the kink at the origin does not affect the Hermite rule.
_SMOOTH = 10.0
_HERMITE_NODES = 12
_LOG_STEP = 0.28
_LOG_TIMES = np.arange(-26.0, 40.0, _LOG_STEP)


def rice_moments(
    mean_1: FloatArray, mean_2: FloatArray, sigma_1: FloatArray, sigma_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the excess of the mean length over the length of the mean, and the variance of the length.

    Far from the origin a product Gauss-Hermite rule is used, near it
    sqrt(E X^2) - E|X| = 1/(2 sqrt pi) int [M(t) - exp(-t E X^2)] t^(-3/2) dt, M(t) = E exp(-t X^2),
    with t = e^u and the trapezoidal rule in u: analytic for |Im u| < pi/2, it converges as exp(-pi^2 / step).

    Definition; S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46, doi:10.1002/j.1538-7305.1945.tb00453.x, for equal
    deviations.
    """
    excess, variance = np.zeros_like(mean_1), np.zeros_like(mean_1)
    length = np.hypot(mean_1, mean_2)
    far = length >= _SMOOTH * sigma_1
    for index in _chunks(np.flatnonzero(far & (sigma_1 > 0.0))):
        excess[index], variance[index] = _far(mean_1[index], mean_2[index], sigma_1[index], sigma_2[index])
    for index in _chunks(np.flatnonzero(~far)):
        excess[index], variance[index] = _near(mean_1[index], mean_2[index], sigma_1[index], sigma_2[index])
    return excess, variance


# Rows at once, for arrays within the cache.
_CHUNK = 128


def _chunks(index: NDArray[np.intp], size: int = _CHUNK) -> list[NDArray[np.intp]]:
    return [index[start : start + size] for start in range(0, index.size, size)]


def _far(
    mean_1: FloatArray, mean_2: FloatArray, sigma_1: FloatArray, sigma_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    nodes, weights = gauss_hermite(_HERMITE_NODES)
    grid_1, grid_2 = (axis.ravel() for axis in np.meshgrid(nodes, nodes))
    weight = np.outer(weights, weights).ravel()
    step_1, step_2 = np.multiply.outer(sigma_1, grid_1), np.multiply.outer(sigma_2, grid_2)
    length = np.hypot(mean_1, mean_2)[:, None]
    moved = np.hypot(mean_1[:, None] + step_1, mean_2[:, None] + step_2)
    change = step_1 * (2.0 * mean_1[:, None] + step_1) + step_2 * (2.0 * mean_2[:, None] + step_2)
    change /= moved + length
    excess = change @ weight
    return excess, ((change - excess[:, None]) ** 2) @ weight


def _near(
    mean_1: FloatArray, mean_2: FloatArray, sigma_1: FloatArray, sigma_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    square = mean_1**2 + mean_2**2 + sigma_1**2 + sigma_2**2
    root = np.sqrt(square)
    time = np.exp(_LOG_TIMES)
    growth, log_mean = np.zeros((square.size, time.size)), np.zeros((square.size, time.size))
    for mean, sigma in ((mean_1, sigma_1), (mean_2, sigma_2)):
        twice = np.multiply.outer(2.0 * sigma**2 / square, time)
        pull = np.multiply.outer(mean**2 / square, time) / (1.0 + twice)
        growth += 0.5 * _log1p_remainder(twice) + pull * twice
        log_mean -= 0.5 * np.log1p(twice) + pull
    # The exponent is growth - time = log_mean; the first form is precise at small times, the second at large ones.
    early = np.exp(-time) * np.expm1(np.minimum(growth, 1.0))
    rise = np.where(growth < 1.0, early, np.exp(log_mean) - np.exp(-time))
    loss = root * (rise @ np.exp(-0.5 * _LOG_TIMES)) * _LOG_STEP / (2.0 * np.sqrt(np.pi))
    excess = (sigma_1**2 + sigma_2**2) / (root + np.hypot(mean_1, mean_2)) - loss
    return excess, loss * (2.0 * root - loss)


def _log1p_remainder(x: FloatArray) -> FloatArray:
    """Return x - log(1 + x) for x >= 0, without cancellation at small x."""
    small = x < 0.03
    y = np.where(small, x, 0.0)
    series = np.zeros_like(y)
    for order in range(10, 1, -1):
        series = 1.0 / order - y * series
    series = y * y * series
    return np.where(small, series, x - np.log1p(x))


def _slide(frame: DolpFrame, z: FloatArray, length: FloatArray, p0: FloatArray, s0: FloatArray) -> FloatArray:
    """Return |mean of (S1, S2) given S0| - p0 S0 as a difference of squares, from the excess over a common factor."""
    excess = frame.mean_1 * frame.excess_1 + frame.mean_2 * frame.excess_2
    linear = -2.0 * z * (excess / np.where(frame.sigma_0 > 0.0, frame.mean_0, 1.0))[:, None]
    square = _slope_square(frame)[:, None] * z**2
    total = length + p0 * s0
    return np.where(total > 0.0, (linear + square) / np.where(total > 0.0, total, 1.0), 0.0)


def _slope_square(frame: DolpFrame) -> FloatArray:
    """Return |slope|^2 - p0^2 sigma_0^2, with slope = (sigma_0 mean - excess) / mean_0."""
    total = 0.0 * frame.mean_0
    for mean, slope, excess in (
        (frame.mean_1, frame.slope_1, frame.excess_1),
        (frame.mean_2, frame.slope_2, frame.excess_2),
    ):
        total = total - (excess / frame.mean_0) * (slope + frame.sigma_0 * mean / frame.mean_0)
    return total


def _combined(deviation: FloatArray, variance: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    share = weights / np.sum(weights, axis=1, keepdims=True)
    mean = np.sum(share * deviation, axis=1)
    spread = np.sum(share * (variance + (deviation - mean[:, None]) ** 2), axis=1)
    return mean, np.sqrt(spread)


def _reasons(frame: DolpFrame, exists: NDArray[np.bool_], tolerance: float) -> NDArray[np.str_]:
    reasons = np.full(exists.shape, "", dtype="<U128")
    for index in np.flatnonzero(~exists):
        reasons[index] = (
            f"S0 is not bounded away from 0 (SNR of S0 is {frame.snr_0[index]:.3g}): DoLP has no moments "
            f"to {tolerance:g}; quantiles exist"
        )
    return reasons
