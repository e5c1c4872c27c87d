"""Degree of linear polarization of Gaussian Stokes parameters: moments to a stated tolerance, and its distribution.

Stokes parameters are on the last axis; all leading axes broadcast. DoLP is the naive one, sqrt(S1^2 + S2^2) / S0 of
the noisy Stokes parameters: biased upward and above 1 with some probability.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair
from model.processing.dolp_distribution.distribution import cdf, distribution_tails, pdf, probability_above
from model.processing.dolp_distribution.existence import Ambiguity, always_existing, ambiguity
from model.processing.dolp_distribution.frame import DolpFrame, dolp_frame
from model.processing.dolp_distribution.moment_expansion import Expansion, first_order, second_order
from model.processing.dolp_distribution.moment_quadrature import exact_moments
from model.processing.dolp_distribution.quantile import quantile

__all__ = [
    "DolpMoments",
    "always_existing",
    "cdf",
    "distribution_tails",
    "first_order",
    "moments",
    "pdf",
    "probability_above",
    "quantile",
    "second_order",
]

FloatArray = NDArray[np.float64]

FIRST, SECOND, EXACT, NONE = "first order", "second order", "quadrature", "none"

# An expansion is never trusted closer to the kink at S1 = S2 = 0, or to S0 = 0, than this.
_LEAST_SNR = 4.0
# What is left out beyond second order, over the square of the largest relative correction.
_NEXT_ORDER = 4.0
# Share of the tolerance that an estimated error may take, since it may be low by a factor of two.
_MARGIN = 0.25
_REFINEMENTS = 2


@dataclass(frozen=True, kw_only=True)
class DolpMoments:
    """Mean and standard deviation of DoLP, each field of the broadcast leading shape.

    Parameters
    ----------
    mean, std
        Moments; not a number where they do not exist at the tolerance.
    snr
        mean / std. Unpolarized light has 1.913 with S0 known: a value below 2 is no evidence of polarization.
    method
        "first order", "second order", "quadrature" or "none".
    mean_error, std_error
        Estimated absolute errors.
    exists
        Whether the moments exist at the tolerance.
    reason
        Why they do not; empty where they do.
    """

    mean: FloatArray
    std: FloatArray
    snr: FloatArray
    method: NDArray[np.str_]
    mean_error: FloatArray
    std_error: FloatArray
    exists: NDArray[np.bool_]
    reason: NDArray[np.str_]


@dataclass(kw_only=True)
class _Columns:
    """Results under construction, each of shape (M,)."""

    mean: FloatArray
    std: FloatArray
    mean_error: FloatArray
    std_error: FloatArray
    method: NDArray[np.str_]


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
        Relative error allowed of mean and standard deviation, > 0. The cheapest of three ways that meets it is
        taken: expansion to first order, to second order, or quadrature (error about 1e-13).
    existing_to
        Tolerance to which moments have to exist, where that is below the other; None for the same.

    Returns
    -------
    DolpMoments
        With the way taken, the errors estimated, and where there are no moments the reason.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, S0 > 0 has no probability, or the tolerance is not positive.

    Notes
    -----
    Moments exist at the tolerance if treating S0 below 1 % of its mean in another way changes them by less.
    Where they do not, `always_existing` and `quantile` say what can be said. In the condition S0 > 0 is meant.

    Differs from [MK14]: eq. (24) is DoLP at the mean, not the mean of DoLP, and eq. (25) its first-order variance;
    both fail where S1 and S2 are few standard deviations from zero, whatever the signal-to-noise ratio of S0.

    References
    ----------
    [MK14] eq. (24)-(29).
    """
    if not tolerance > 0.0:
        raise ValueError(f"tolerance = {tolerance}; allowed is above 0")
    frame, shape = dolp_frame(stokes_mean, stokes_cov)
    columns = _expanded(frame, stokes_mean, stokes_cov, shape, tolerance)
    doubt, existing_to = ambiguity(frame), tolerance if existing_to is None else min(existing_to, tolerance)
    pending = np.flatnonzero((columns.method == NONE) & (frame.mean_0 > 0.0) & (doubt.dark <= existing_to))
    for refinement in range(_REFINEMENTS + 1):
        _quadrature(columns, frame, pending, refinement)
        pending = pending[~_within(columns, pending, tolerance)]
    return _result(columns, frame, doubt, shape, existing_to)


def _expanded(
    frame: DolpFrame, stokes_mean: ArrayLike, stokes_cov: ArrayLike, shape: tuple[int, ...], tolerance: float
) -> _Columns:
    """Return the results of the expansions where they meet the tolerance."""
    count = len(frame)
    columns = _Columns(
        mean=np.full(count, np.nan),
        std=np.full(count, np.nan),
        mean_error=np.full(count, np.nan),
        std_error=np.full(count, np.nan),
        method=np.full(count, NONE, dtype="<U12"),
    )
    index = np.flatnonzero(_least_snr(frame) > _LEAST_SNR)
    mean, cov = checked_pair(stokes_mean, stokes_cov)
    mean = np.broadcast_to(mean, (*shape, 3)).reshape(-1, 3)[index]
    cov = np.broadcast_to(cov, (*shape, 3, 3)).reshape(-1, 3, 3)[index]
    first, second = first_order(mean, cov), second_order(mean, cov)
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = _next_order(frame[index], first, second)
        second_errors = rest * first.mean, rest * _root(first.variance)
        mean_error = np.abs(second.mean - first.mean) + second_errors[0]
        std_error = np.abs(_root(second.variance) - _root(first.variance)) + second_errors[1]
    _accept(columns, index, second, *second_errors, SECOND, tolerance)
    _accept(columns, index, first, mean_error, std_error, FIRST, tolerance)
    return columns


def _least_snr(frame: DolpFrame) -> FloatArray:
    """Return the smaller distance, in standard deviations, to S1 = S2 = 0 and to S0 = 0."""
    bright = np.maximum(frame.mean_0, frame.sigma_0)
    common = np.hypot(frame.excess_1, frame.excess_2) / bright
    spread = np.sqrt(common**2 + frame.radius_1**2 + frame.radius_2**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        polarized = np.where(frame.polarized > 0.0, frame.polarized / spread, 0.0)
    return np.asarray(np.minimum(polarized, frame.snr_0))


def _next_order(frame: DolpFrame, first: Expansion, second: Expansion) -> FloatArray:
    """Return an estimate of the relative size of what second order leaves out; not a number if there is none."""
    mean_change = np.abs(second.mean / first.mean - 1.0)
    std_change = np.abs(_root(second.variance) / _root(first.variance) - 1.0)
    far = 1.0 / _least_snr(frame) ** 2
    return np.asarray(_NEXT_ORDER * np.maximum(np.maximum(mean_change, std_change), far) ** 2)


def _root(variance: FloatArray) -> FloatArray:
    """Return the square root; not a number, without a warning, where an expansion has broken down."""
    return np.sqrt(np.where(variance >= 0.0, variance, np.nan))


def _accept(
    columns: _Columns,
    index: NDArray[np.int64],
    found: Expansion,
    mean_error: FloatArray,
    std_error: FloatArray,
    method: str,
    tolerance: float,
) -> None:
    std = _root(found.variance)
    good = (mean_error <= _MARGIN * tolerance * found.mean) & (std_error <= _MARGIN * tolerance * std)
    chosen = index[good]
    columns.mean[chosen], columns.std[chosen] = found.mean[good], std[good]
    columns.mean_error[chosen], columns.std_error[chosen] = mean_error[good], std_error[good]
    columns.method[chosen] = method


def _quadrature(columns: _Columns, frame: DolpFrame, index: NDArray[np.int64], refinement: int) -> None:
    found = exact_moments(frame[index], refinement=refinement)
    columns.mean[index], columns.std[index] = found.mean, found.std
    columns.mean_error[index], columns.std_error[index] = found.mean_error, found.std_error
    columns.method[index] = EXACT


def _within(columns: _Columns, index: NDArray[np.int64], tolerance: float) -> NDArray[np.bool_]:
    mean_good = columns.mean_error[index] <= tolerance * columns.mean[index]
    return np.asarray(mean_good & (columns.std_error[index] <= tolerance * columns.std[index]))


def _result(
    columns: _Columns, frame: DolpFrame, doubt: Ambiguity, shape: tuple[int, ...], existing_to: float
) -> DolpMoments:
    with np.errstate(invalid="ignore", divide="ignore"):
        std_doubt = np.where(doubt.square > 0.0, doubt.square / (2.0 * columns.std), 0.0)
        defined = (doubt.mean <= existing_to * columns.mean) & (std_doubt <= existing_to * columns.std)
        exists = defined & (doubt.dark <= existing_to) & (frame.mean_0 > 0.0)
        snr = columns.mean / columns.std

    def shaped(values: FloatArray) -> FloatArray:
        return np.where(exists, values, np.nan).reshape(shape)[()]

    return DolpMoments(
        mean=shaped(columns.mean),
        std=shaped(columns.std),
        snr=shaped(snr),
        method=np.where(exists, columns.method, NONE).reshape(shape)[()],
        mean_error=shaped(columns.mean_error + doubt.mean),
        std_error=shaped(columns.std_error + std_doubt),
        exists=exists.reshape(shape)[()],
        reason=_reasons(frame, exists, existing_to).reshape(shape)[()],
    )


def _reasons(frame: DolpFrame, exists: NDArray[np.bool_], tolerance: float) -> NDArray[np.str_]:
    reasons = np.full(exists.shape, "", dtype="<U128")
    for index in np.flatnonzero(~exists):
        reasons[index] = (
            f"S0 is not bounded away from 0 (SNR of S0 is {frame.snr_0[index]:.3g}): DoLP has no moments "
            f"to {tolerance:g}; quantiles exist"
        )
    return reasons
