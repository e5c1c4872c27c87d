"""Joint covariance of the calibrated quantities, carried from the statistics of the levels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.dark_signal import QUANTISATION_VAR_DN2, DarkMatch, DarkSignal
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.pattern_parts import small_scale_freedom
from calibration.sensor.photon_transfer import PhotonTransfer
from calibration.sensor.rounding_error import least_noise_dn2, spatial_rounding_error_dn2

FloatArray = NDArray[np.float64]

# Rows of the covariance that `measured_covariance` returns.
GAIN, DARK_VARIANCE, FLAT_SPATIAL, DARK_SPATIAL, BLACK_LEVEL, DARK_SLOPE = range(6)
# One more that is measured, independent of these: the slope of the response where the fixed pattern is taken.
RESPONSE_SLOPE = 6
N_MEASURED = 7


@dataclass(frozen=True, kw_only=True)
class SpatialLevels:
    """Which levels the fixed pattern is taken from: indices into flats and darks."""

    flat: int
    dark: int


def measured_covariance(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    *,
    transfer: PhotonTransfer,
    dark: DarkSignal,
    match: DarkMatch,
    spatial: SpatialLevels,
) -> FloatArray:
    """Return the (6, 6) covariance of what is measured in DN, before division by the gain.

    In this order: gain [DN/e-], dark temporal variance at no exposure [DN^2], spatial variance of the flat level
    less that of its darks, what is smooth taken off [DN^2], spatial variance of the dark level [DN^2], black level
    [DN], slope of the dark mean [DN/s]; zeros for what does not exist.

    Parameters
    ----------
    flats, darks, transfer, dark, match, spatial
        As in `calibration.sensor.measured_levels.measure`.

    Notes
    -----
    To first order in the errors. Each is linear in temporal and spatial variances and means of the levels. A
    level's mean is taken as independent of its variances, which holds for noise without skewness, and the
    error of a flat's mean is neglected: against that of its variance it is the square root of the gain over
    the signal. The black level is that of the population from which this sensor's pixels are drawn, so the
    fixed pattern's own sampling is in it.
    """
    response = _response(transfer, dark, match, spatial)
    statistics = _statistics_covariance(flats, darks, transfer, dark)
    covariance = np.zeros((6, 6))
    covariance[:4, :4] = response @ statistics @ response.T
    scattered = transfer.gain_response * transfer.points.signal_dn[transfer.used]
    covariance[GAIN, GAIN] += float(scattered @ scattered) * transfer.fit.scatter**2
    covariance[GAIN, GAIN] += (transfer.relative_gain_error_of_change * transfer.gain_dn_per_e) ** 2
    covariance[GAIN, GAIN] += transfer.gain_error_of_linearity_dn_per_e**2 + transfer.gain_error_of_black_dn_per_e**2
    # The fixed pattern with light is what is left within blocks, which have fewer degrees of freedom.
    covariance[FLAT_SPATIAL, FLAT_SPATIAL] /= small_scale_freedom(flats[spatial.flat].shape)
    size = 2 if dark.has_slope else 1
    covariance[4 : 4 + size, 4 : 4 + size] = dark.mean_fit.covariance[:size, :size]
    level = darks[spatial.dark]
    if dark.quantisation_limited:
        covariance[DARK_SPATIAL, DARK_SPATIAL] += QUANTISATION_VAR_DN2**2
    if dark.is_curved and dark.variance_fit is not None:
        # The variance at no exposure is that at the mean of no exposure.
        covariance[DARK_VARIANCE, DARK_VARIANCE] += (
            dark.variance_fit.parameters[1] ** 2 * dark.mean_fit.covariance[0, 0]
        )
    covariance[BLACK_LEVEL, BLACK_LEVEL] += max(level.spatial_variance_dn2, 0.0) / level.n_pixels
    return covariance


def _response(transfer: PhotonTransfer, dark: DarkSignal, match: DarkMatch, spatial: SpatialLevels) -> FloatArray:
    """Return derivatives by flat and dark temporal variances, then flat and dark spatial variances."""
    n_flat, n_dark = match.weights.shape
    gain = np.zeros(n_flat)
    gain[transfer.used] = transfer.gain_response
    response = np.zeros((4, 2 * (n_flat + n_dark)))
    temporal, pattern = response[:, : n_flat + n_dark], response[:, n_flat + n_dark :]
    temporal[GAIN, :n_flat] = gain
    temporal[GAIN, n_flat:] = -gain @ match.weights
    if dark.variance_fit is not None:
        temporal[DARK_VARIANCE, n_flat:] = dark.variance_fit.response[0]
    pattern[FLAT_SPATIAL, spatial.flat] = 1.0
    pattern[FLAT_SPATIAL, n_flat:] = -match.weights[spatial.flat]
    pattern[DARK_SPATIAL, n_flat + spatial.dark] = 1.0
    return response


def _statistics_covariance(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    transfer: PhotonTransfer,
    dark: DarkSignal,
) -> FloatArray:
    """Return the covariance of all levels' temporal variances, then spatial ones: flats before darks."""
    levels = (*flats, *darks)
    n_flat, n = len(flats), len(levels)
    temporal = np.zeros((n, n))
    temporal[:n_flat, :n_flat] = np.diag(np.square(transfer.points.flat_std_error_dn2))
    temporal[n_flat:, n_flat:] = dark.variance_covariance_dn4
    spatial = np.diag(np.square([level.ordinary.std_error_dn2 for level in levels]) + _rounding_dn4(levels))
    cross = np.diag([level.ordinary.temporal_cov_dn4 for level in levels])
    return np.block([[temporal, cross], [cross, spatial]])


def _rounding_dn4(levels: Sequence[LevelStatistics]) -> FloatArray:
    """Return what noise that hardly dithers leaves of rounding in spatial variances, squared [DN^4]."""
    temporal = np.array([level.temporal_variance_dn2 for level in levels])
    pattern = np.array([max(level.ordinary.variance_dn2, 0.0) for level in levels])
    return np.square(spatial_rounding_error_dn2(least_noise_dn2(temporal, pattern), pattern))
