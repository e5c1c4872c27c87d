"""Mean and variance of dark frames against exposure, and which dark belongs to which flat."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.rounding_error import least_noise_dn2, mean_rounding_error_dn, variance_rounding_error_dn2
from calibration.sensor.scatter_fit import ScatterFit, fit_with_scatter

FloatArray = NDArray[np.float64]

# Variance of a rounding error, uniform over one count.
QUANTISATION_VAR_DN2 = 1.0 / 12.0
# Below this temporal variance rounding is not dithered, and the variance seen says little of the noise before it.
QUANTISATION_LIMIT_DN2 = 0.24
# A noise that is not resolved has a variance between that of rounding alone and the limit, evenly likely.
_UNRESOLVED_VARIANCE_DN2 = 0.5 * (QUANTISATION_VAR_DN2 + QUANTISATION_LIMIT_DN2)
_UNRESOLVED_VARIANCE_ERROR_DN2 = (QUANTISATION_LIMIT_DN2 - QUANTISATION_VAR_DN2) / np.sqrt(12.0)
_EXPOSURE_TOLERANCE = 1e-3
# Exposures from which on a bend of the mean is looked for, and the chance that there is none where one is found.
_BEND_EXPOSURES, _FALSE_BEND = 6, 1e-4
_MOST_TERMS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkSignal:
    """Dark signal against exposure.

    Attributes
    ----------
    mean_fit : ScatterFit
        Mean [DN]: value at no exposure, then slope [DN/s] where it can be had.
    variance_fit : ScatterFit or None
        Temporal variance, rounding included [DN^2]: value at no exposure, then slope [DN^2/s], where the dark current
        changed slope against the mean [DN]; None where `quantisation_limited`.
    has_slope : bool
        There are two exposures or more, all known, and one dark current describes them.
    is_curved : bool
        The mean is no straight line of the exposure: the dark current changed while the frames were taken.
    means_dn, variances_dn2 : (n,) arrays
        Each level's.
    variance_covariance_dn4 : (n, n) array
        Covariance of the errors of the variances, scatter included.
    quantisation_limited : bool
        The noise is too small against one count to be measured. The variances are then the middle of what they
        may be, and their covariance says so.
    """

    mean_fit: ScatterFit
    variance_fit: ScatterFit | None
    has_slope: bool
    is_curved: bool
    means_dn: FloatArray
    variances_dn2: FloatArray
    variance_covariance_dn4: FloatArray
    quantisation_limited: bool

    def mean_at(self, exposure_s: FloatArray) -> FloatArray:
        """Return the fitted mean at an exposure [DN]."""
        return np.asarray(np.polynomial.polynomial.polyval(exposure_s, self.mean_fit.parameters), dtype=np.float64)

    def variance_at(self, exposure_s: FloatArray) -> FloatArray | None:
        """Return the fitted temporal variance at an exposure [DN^2], None where there is no fit."""
        if self.variance_fit is None:
            return None
        along = self.mean_at(exposure_s) - self.mean_fit.parameters[0] if self.is_curved else exposure_s
        return np.asarray(np.polynomial.polynomial.polyval(along, self.variance_fit.parameters), dtype=np.float64)


def fit_dark_signal(darks: Sequence[LevelStatistics]) -> DarkSignal:
    """Return the straight lines through mean and variance of dark levels.

    Parameters
    ----------
    darks : sequence of LevelStatistics
        At least one.

    Notes
    -----
    With one exposure, or unknown ones, the lines have no slope, and what dark current does within that
    exposure counts as black level and read noise.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6.5 and 7.1.
    """
    exposures = [dark.exposure_s for dark in darks]
    known = [exposure for exposure in exposures if exposure is not None]
    has_slope = len(known) == len(exposures) and len(set(known)) > 1
    design = np.column_stack([np.ones(len(darks)), known]) if has_slope else np.ones((len(darks), 1))
    means = np.array([dark.mean_dn for dark in darks])
    mean_fit = fit_with_scatter(
        design, means, sampling_covariance=np.diag(mean_sampling_variance(darks)), scatter_shape=np.ones(len(darks))
    )
    variances = np.array([dark.temporal_variance_dn2 for dark in darks])
    limited = bool(np.median(variances) < QUANTISATION_LIMIT_DN2)
    bent = None if limited or not has_slope else _bent_fit(mean_fit, design, darks, means)
    if bent is not None:
        # However a dark current changes, its electrons add to the variance what they add to the mean.
        mean_fit = bent
        along = np.polynomial.polynomial.polyval(design[:, 1], bent.parameters) - bent.parameters[0]
        design = np.column_stack([design[:, 0], along])
    rounding_dn2 = QUANTISATION_VAR_DN2 if limited else float(np.max(_mean_rounding_variance(darks)))
    mean_fit = _with_rounding(mean_fit, rounding_dn2, exposure_range_s=float(np.ptp(known)) if has_slope else 0.0)
    variance_fit = None if limited else _fit_variance(darks, design, variances)
    return DarkSignal(
        mean_fit=mean_fit,
        variance_fit=variance_fit,
        has_slope=has_slope and bent is None,
        is_curved=bent is not None,
        means_dn=means,
        variances_dn2=variances if variance_fit else np.full(len(darks), _UNRESOLVED_VARIANCE_DN2),
        variance_covariance_dn4=(
            np.full((len(darks), len(darks)), _UNRESOLVED_VARIANCE_ERROR_DN2**2)
            if variance_fit is None
            else np.diag(_smoothed_variance_error(darks, design @ variance_fit.parameters) + variance_fit.scatter**2)
            + _shared_variance_error_dn2(darks) ** 2
        ),
        quantisation_limited=limited,
    )


def _bent_fit(
    line: ScatterFit, design: FloatArray, darks: Sequence[LevelStatistics], means: FloatArray
) -> ScatterFit | None:
    """Return the polynomial of lowest degree through the means whose next term is not seen, None where a line will do.

    How a dark current changes is not known: one term more may be there, and moves the mean at no exposure.
    """
    exposures = design[:, 1]
    chosen, is_bent = line, False
    for degree in range(2, min(_MOST_TERMS, len(np.unique(exposures)) - _BEND_EXPOSURES + 2) + 1):
        fit = _polynomial(exposures, degree, darks, means)
        last = fit.parameters[-1] / np.sqrt(fit.covariance[-1, -1])
        if abs(last) < -stdtrit(len(darks) - degree - 1, 0.5 * _FALSE_BEND):
            break
        before, chosen, is_bent = chosen, fit, True
    else:
        fit = before if is_bent else chosen
    if not is_bent:
        return None
    covariance = chosen.covariance.copy()
    covariance[0, 0] += (fit.parameters[0] - chosen.parameters[0]) ** 2
    return replace(chosen, covariance=covariance)


def _polynomial(exposures: FloatArray, degree: int, darks: Sequence[LevelStatistics], means: FloatArray) -> ScatterFit:
    scale = float(exposures.max())
    fit = fit_with_scatter(
        (exposures[:, None] / scale) ** np.arange(degree + 1),
        means,
        sampling_covariance=np.diag(mean_sampling_variance(darks)),
        scatter_shape=np.ones(len(darks)),
    )
    units = scale ** -np.arange(degree + 1.0)
    return replace(
        fit,
        parameters=fit.parameters * units,
        covariance=fit.covariance * np.outer(units, units),
        response=fit.response * units[:, None],
    )


def _with_rounding(fit: ScatterFit, variance_dn2: float, *, exposure_range_s: float) -> ScatterFit:
    """Return the curve through means that noise hardly dithers, with what rounding may have done to all of them alike.

    The mean at no exposure is off by a rounding error, the slope by two of them over the range of exposures.
    """
    extra = np.zeros_like(fit.covariance)
    extra[0, 0] = variance_dn2
    if exposure_range_s > 0.0:
        extra[1, 1] = 2.0 * variance_dn2 / exposure_range_s**2
    return replace(fit, covariance=fit.covariance + extra)


def mean_sampling_variance(darks: Sequence[LevelStatistics]) -> FloatArray:
    """Return the variance of each level's mean: noise of its pixels, wander of whole frames, and rounding.

    Dark current may dither the rounding of long exposures alone: the mean of the short ones is then off.

    Parameters
    ----------
    darks
        Statistics of each level; the result is theirs, in order [DN^2].
    """
    noise = np.array([dark.temporal_variance_dn2 / dark.n_pixels for dark in darks])
    freedom = np.array([dark.n_frames - 1 for dark in darks])
    between = np.array([np.var(dark.frame_means_dn, ddof=1) for dark in darks])
    wander = max(0.0, float(freedom @ (between - noise) / freedom.sum()))
    floor = QUANTISATION_VAR_DN2 / np.array([dark.n_pixels for dark in darks])
    variance: FloatArray = (np.maximum(noise, floor) + wander) / (freedom + 1) + _mean_rounding_variance(darks)
    return variance


def _mean_rounding_variance(darks: Sequence[LevelStatistics]) -> FloatArray:
    temporal = np.array([dark.temporal_variance_dn2 for dark in darks])
    spatial = np.array([max(dark.ordinary.variance_dn2, 0.0) for dark in darks])
    return np.square(mean_rounding_error_dn(least_noise_dn2(temporal, spatial) + spatial))


def _fit_variance(darks: Sequence[LevelStatistics], design: FloatArray, variances: FloatArray) -> ScatterFit:
    model = variances
    for _ in range(2):
        fit = fit_with_scatter(
            design,
            variances,
            sampling_covariance=np.diag(_smoothed_variance_error(darks, model)),
            scatter_shape=np.ones(len(darks)),
        )
        model = design @ fit.parameters
    shared = np.zeros_like(fit.covariance)
    shared[0, 0] = _shared_variance_error_dn2(darks) ** 2
    return replace(fit, covariance=fit.covariance + shared)


def _shared_variance_error_dn2(darks: Sequence[LevelStatistics]) -> float:
    """Return the error that all dark variances may share: noise cut off at 0, and rounding that is hardly dithered.

    A normal law that is cut off at z standard deviations below its mean, with p beyond, has a variance that is smaller
    by z phi(z) + p - z^2 p of itself.
    """
    variance = float(np.median([dark.temporal_variance_dn2 for dark in darks]))
    spatial = float(np.median([max(dark.ordinary.variance_dn2, 0.0) for dark in darks]))
    zeros = max(dark.samples.zero_fraction for dark in darks)
    cut = 0.0
    if zeros > 0.0:
        z = -float(ndtri(zeros))
        cut = z * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + zeros - z**2 * zeros
    noise_dn2 = least_noise_dn2(np.array(variance), np.array(spatial))
    rounding = float(variance_rounding_error_dn2(noise_dn2, np.array(spatial)))
    return float(np.hypot(cut * variance, rounding))


def _smoothed_variance_error(darks: Sequence[LevelStatistics], model_dn2: FloatArray) -> FloatArray:
    """Return the sampling variance of each temporal variance, relative as measured, absolute by the model.

    A point that is low by chance has a small error by its own measure; weighted by it, a fit is too low.
    """
    relative = np.array([dark.temporal_std_error_dn2 / dark.temporal_variance_dn2 for dark in darks])
    smoothed: FloatArray = np.square(relative * model_dn2)
    return smoothed


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkMatch:
    """Which darks stand for the dark part of which flat.

    Attributes
    ----------
    weights : (n_flat, n_dark) array
        Each row sums to 1: the mix of dark levels that belongs to a flat.
    covered : (n_flat,) array of bool
        The flat's exposure lies within those of the darks.
    """

    weights: FloatArray
    covered: NDArray[np.bool_]


def match_darks(flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics]) -> DarkMatch:
    """Return the dark levels of the same exposure, interpolated between neighbours where there are none.

    Parameters
    ----------
    flats, darks : sequences of LevelStatistics
        At least one dark.

    Notes
    -----
    Outside of the darks' exposures the nearest one is taken; where an exposure is not known, all of them.
    """
    frames = np.array([float(dark.n_frames) for dark in darks])
    times = np.array([np.nan if dark.exposure_s is None else dark.exposure_s for dark in darks])
    wanted = np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])
    if np.isnan(times).any() or np.isnan(wanted).any():
        weights = np.tile(frames / frames.sum(), (len(flats), 1))
        return DarkMatch(weights=weights, covered=np.zeros(len(flats), dtype=bool))
    distinct = np.unique(times)
    shares = np.where(times == distinct[:, None], frames, 0.0)
    shares /= shares.sum(axis=1, keepdims=True)
    mix = np.column_stack([np.interp(wanted, distinct, corner) for corner in np.eye(len(distinct))])
    covered = (wanted >= distinct[0] * (1.0 - _EXPOSURE_TOLERANCE)) & (
        wanted <= distinct[-1] * (1.0 + _EXPOSURE_TOLERANCE)
    )
    return DarkMatch(weights=mix @ shares, covered=covered)
