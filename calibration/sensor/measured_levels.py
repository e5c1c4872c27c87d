"""Results of the levels in DN, with their joint covariance: what noise parameters are made from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.dark_signal import DarkMatch, DarkSignal
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.photon_transfer import PhotonTransfer
from calibration.sensor.propagation import (
    BLACK_LEVEL,
    DARK_SLOPE,
    DARK_SPATIAL,
    DARK_VARIANCE,
    FLAT_SPATIAL,
    GAIN,
    N_MEASURED,
    RESPONSE_SLOPE,
    SpatialLevels,
    measured_covariance,
)
from calibration.sensor.response_slope import response_slope
from calibration.sensor.transfer_points import RANGE_OF_SATURATION

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Results of the levels, in DN.

    Attributes
    ----------
    values : (7,) array
        In the order of `calibration.sensor.propagation`.
    covariance : (7, 7) array
        Of their errors.
    signal_dn : float
        Signal of the flat level that the fixed pattern is taken from [DN].
    n_gain, n_dark, n_flat_pattern, n_dark_pattern : int
        Frames behind the gain, the dark lines, and the fixed pattern with and without light.
    """

    values: FloatArray
    covariance: FloatArray
    signal_dn: float
    n_gain: int
    n_dark: int
    n_flat_pattern: int
    n_dark_pattern: int


def choose_spatial_levels(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    *,
    transfer: PhotonTransfer,
    match: DarkMatch,
) -> SpatialLevels:
    """Return the levels with the most frames; of those the flat nearest to the middle, and its own dark.

    Parameters
    ----------
    flats, darks
        Statistics of each level.
    transfer
        The curve, and which levels stand on it.
    match
        Which darks are of which flat.
    """
    signal = transfer.points.signal_dn
    middle_dn = float(signal[transfer.used].max()) / (2.0 * RANGE_OF_SATURATION)
    flat = max(
        np.flatnonzero(transfer.used).tolist(),
        key=lambda index: (flats[index].n_frames, -abs(signal[index] - middle_dn)),
    )
    dark = max(range(len(darks)), key=lambda index: (darks[index].n_frames, match.weights[flat, index]))
    return SpatialLevels(flat=flat, dark=dark)


def measure(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    *,
    transfer: PhotonTransfer,
    dark: DarkSignal,
    match: DarkMatch,
    spatial: SpatialLevels,
) -> Measured:
    """Return what the levels gave in DN, with its covariance. What does not exist is 0, as is its covariance.

    Parameters
    ----------
    flats, darks
        Statistics of each level.
    transfer
        The fitted curve.
    dark
        The fitted dark signal.
    match
        Which darks are of which flat.
    spatial
        Levels from which non-uniformity is taken.
    """
    dark_spatial = np.array([level.ordinary.variance_dn2 for level in darks])
    flat_weights = match.weights[spatial.flat]
    values, covariance = np.zeros(N_MEASURED), np.zeros((N_MEASURED, N_MEASURED))
    values[GAIN] = transfer.gain_dn_per_e
    values[DARK_VARIANCE] = 0.0 if dark.variance_fit is None else dark.variance_fit.parameters[0]
    # What is smooth across the picture is light and lens rather than the sensor.
    dark_small = np.array([level.ordinary.small_scale_variance_dn2 for level in darks])
    values[FLAT_SPATIAL] = flats[spatial.flat].ordinary.small_scale_variance_dn2 - flat_weights @ dark_small
    hidden_dn2 = _hidden_defects_dn2(flats[spatial.flat], darks, flat_weights)
    values[FLAT_SPATIAL] -= 0.5 * hidden_dn2
    values[DARK_SPATIAL] = dark_spatial[spatial.dark]
    values[BLACK_LEVEL] = dark.mean_fit.parameters[0]
    values[DARK_SLOPE] = dark.mean_fit.parameters[1] if dark.has_slope else 0.0
    covariance[:RESPONSE_SLOPE, :RESPONSE_SLOPE] = measured_covariance(
        flats, darks, transfer=transfer, dark=dark, match=match, spatial=spatial
    )
    covariance[FLAT_SPATIAL, FLAT_SPATIAL] += (0.5 * hidden_dn2) ** 2
    signal_dn = float(transfer.points.signal_dn[spatial.flat])
    slope = response_slope(transfer, signal_dn)
    values[RESPONSE_SLOPE], covariance[RESPONSE_SLOPE, RESPONSE_SLOPE] = slope.value, slope.std_error**2
    matched = np.greater(match.weights[transfer.used].sum(axis=0), 0.0)
    return Measured(
        values=values,
        covariance=covariance,
        signal_dn=signal_dn,
        n_gain=_frames(flats, transfer.used) + _frames(darks, matched),
        n_dark=_frames(darks, np.ones(len(darks), dtype=bool)),
        n_flat_pattern=flats[spatial.flat].n_frames + _frames(darks, np.greater(flat_weights, 0.0)),
        n_dark_pattern=darks[spatial.dark].n_frames,
    )


def _hidden_defects_dn2(flat: LevelStatistics, darks: Sequence[LevelStatistics], weights: FloatArray) -> float:
    """Return the variance that pixels which are defect in the dark have at most among the others in the light [DN^2].

    A hot pixel that stands out in the dark may lie within what pixels differ by with light; half of it is taken off,
    and half is the error.
    """
    all_dn2 = np.array([level.small_scale_variance_dn2 for level in darks])
    ordinary_dn2 = np.array([level.ordinary.small_scale_variance_dn2 for level in darks])
    left_out = np.array([float(level.ordinary.left_out) for level in darks])
    # The largest stand out in the light too, and are left out there.
    hidden = np.maximum(left_out - flat.ordinary.left_out, 0.0) / np.maximum(left_out, 1.0)
    return float(weights @ (hidden * np.maximum(all_dn2 - ordinary_dn2, 0.0)))


def _frames(levels: Sequence[LevelStatistics], chosen: NDArray[np.bool_]) -> int:
    return sum(level.n_frames for level, take in zip(levels, chosen, strict=True) if take)
