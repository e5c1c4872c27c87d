"""Influence of single dark levels: which stand off what the others say of mean and temporal variance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.curve_model import CurveModel
from calibration.sensor.dark_signal import mean_sampling_variance
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.outlying_points import PointInfluence, point_influence
from calibration.sensor.rounding_error import least_noise_dn2, variance_rounding_error_dn2

FloatArray = NDArray[np.float64]

# Chances that a sound set has a dark named on one axis; with those of the flats below 1 %.
_FALSE_MEAN, _FALSE_VARIANCE = 5e-4, 5e-4
_LEAST_LEVELS = 5
# Terms against exposure; how large each may be at least, in errors of a level, and over the one before it.
_MOST_TERMS, _LEAST_TERM, _NEXT_TERM = 6, 10.0, 0.5
_LEAST_VARIANCE_DN2, _LEAST_RELATIVE = 1e-9, 1e-6


@dataclass(frozen=True, kw_only=True)
class DarkInfluence:
    """One dark level: its mean and its temporal variance against exposure [DN, DN^2]."""

    mean_off_dn: float
    mean_std_error_dn: float
    variance_off_dn2: float
    variance_std_error_dn2: float
    outlying: bool


def dark_influence(darks: Sequence[LevelStatistics]) -> tuple[DarkInfluence, ...] | None:
    """Return each dark level beside the others; None with fewer than five.

    Parameters
    ----------
    darks : sequence of LevelStatistics
        Dark levels.

    Notes
    -----
    Means follow a polynomial of the exposure. Variances follow one too, or a straight line of the mean: however a dark
    current changes, its electrons add to the variance what they add to the mean.
    """
    if len(darks) < _LEAST_LEVELS:
        return None
    exposures = np.array([np.nan if dark.exposure_s is None else dark.exposure_s for dark in darks])
    by_mean = _by_mean(darks, exposures)
    by_variance = None if by_mean is None else _by_variance(darks, exposures, by_mean)
    if by_mean is None or by_variance is None:
        return None
    return tuple(
        DarkInfluence(
            mean_off_dn=float(by_mean.deviation[index]),
            mean_std_error_dn=float(by_mean.std_error[index]),
            variance_off_dn2=float(by_variance.deviation[index]),
            variance_std_error_dn2=float(by_variance.std_error[index]),
            outlying=bool(by_mean.outlying[index] or by_variance.outlying[index]),
        )
        for index in range(len(darks))
    )


def _by_mean(darks: Sequence[LevelStatistics], exposures: FloatArray) -> PointInfluence | None:
    means = np.array([dark.mean_dn for dark in darks])
    # Pixels that jump are left out of the mean of one level and not of the next.
    left_out_dn = np.array([np.mean(dark.frame_means_dn) for dark in darks]) - means
    own = mean_sampling_variance(darks) + np.square(left_out_dn)
    models = _models(exposures, means, own)
    return point_influence(models, means, own, abscissa=exposures, p_false=_FALSE_MEAN)


def _by_variance(
    darks: Sequence[LevelStatistics], exposures: FloatArray, by_mean: PointInfluence
) -> PointInfluence | None:
    temporal = np.array([dark.temporal_variance_dn2 for dark in darks])
    spatial = np.array([max(dark.ordinary.variance_dn2, 0.0) for dark in darks])
    seen = np.maximum(temporal, _LEAST_VARIANCE_DN2)
    relative = np.array([dark.temporal_std_error_dn2 for dark in darks]) / seen
    own = np.square(np.maximum(relative, _LEAST_RELATIVE) * np.maximum(_line_of_all(exposures, temporal), seen.min()))
    own += np.square(variance_rounding_error_dn2(least_noise_dn2(temporal, spatial), spatial))
    models = _models(exposures, temporal, own)
    means = by_mean.values - np.where(by_mean.outlying, by_mean.deviation, 0.0)
    if len(models) > 1 and np.ptp(means) > 0.0:
        along = (means - means.min()) / np.ptp(means)
        models.append(_curve(np.column_stack([np.ones(len(means)), along]), _sizes(exposures, temporal, own)))
    return point_influence(models, temporal, own, abscissa=exposures, p_false=_FALSE_VARIANCE)


def _line_of_all(exposures: FloatArray, values: FloatArray) -> FloatArray:
    """Return the rising line of Theil and Sen at each exposure, which up to a quarter of wrong darks leave alone.

    A variance that is low by chance claims a small error by its own measure; by what is usual for all, one of a long
    exposure would do so too, where dark current makes most of the noise.

    References
    ----------
    Sen, J. Am. Stat. Assoc. 63, 1379 (1968), doi:10.1080/01621459.1968.10480934.
    """
    first, second = np.triu_indices(len(exposures), k=1)
    span = exposures[second] - exposures[first]
    apart = np.abs(span) > 0.0
    rising = np.zeros_like(values)
    if apart.any() and not np.isnan(exposures).any():
        slopes = (values[second] - values[first])[apart] / span[apart]
        rising = max(float(np.median(slopes)), 0.0) * exposures
    line: FloatArray = float(np.median(values - rising)) + rising
    return line


def _sizes(exposures: FloatArray, values: FloatArray, variance: FloatArray) -> FloatArray:
    """Return how large each term of a curve may be: as large as what dark current adds, and smaller from term to term.

    A dark current that grows with the sensor's temperature bends the means by many times their errors.
    """
    least = _LEAST_TERM * float(np.sqrt(np.median(variance)))
    first = max(float(np.ptp(_line_of_all(exposures, values))), least)
    sizes: FloatArray = np.maximum(first * _NEXT_TERM ** np.arange(-1.0, _MOST_TERMS - 1.0), least)
    sizes[0] = np.inf
    return sizes


def _curve(design: FloatArray, sizes: FloatArray) -> CurveModel:
    return CurveModel(design=design, scatter_shape=np.ones(len(design)), term_sizes=sizes[: design.shape[1]])


def _models(exposures: FloatArray, values: FloatArray, variance: FloatArray) -> list[CurveModel]:
    """Return the curves that darks may follow against their exposure."""
    if np.isnan(exposures).any() or np.ptp(exposures) == 0.0:
        return [CurveModel(design=np.ones((len(exposures), 1)), scatter_shape=np.ones(len(exposures)))]
    n_exposures = len(np.unique(exposures))
    n_terms = max(min(_MOST_TERMS, n_exposures // 2), min(4, n_exposures))
    # Chebyshev's polynomials: the size of each is how far it takes the curve, whatever the others do.
    scaled = 2.0 * (exposures - exposures.min()) / np.ptp(exposures) - 1.0
    powers, sizes = np.polynomial.chebyshev.chebvander(scaled, n_terms - 1), _sizes(exposures, values, variance)
    # A sensor that warms up scatters the more the longer it exposes.
    growing = CurveModel(
        design=powers[:, :2],
        scatter_shape=np.maximum(exposures / exposures.max(), 1e-3),
        term_sizes=sizes[:2],
        is_usual=False,
    )
    return [*(_curve(powers[:, :terms], sizes) for terms in range(1, n_terms + 1)), growing]
