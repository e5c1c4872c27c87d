"""Noise parameters of a sensor from dark and flat levels, with their joint covariance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Bound, Estimate, JointCovariance, number_with_error
from calibration.results import CalibrationError, Flag, RefusedFramesError, by_consequence, refused
from calibration.sensor.curves import (
    QUANTISATION_LIMIT_DN2,
    QUANTISATION_VAR_DN2,
    RANGE_OF_SATURATION,
    DarkMatch,
    DarkSignal,
    LightStability,
    PhotonTransfer,
    StatedExposures,
    fit_dark_signal,
    implausible_unit,
    impossible_exposures,
    is_absurd,
    match_darks,
    response_slope,
    sample_ceiling_dn,
    unusual_dark_current,
)
from calibration.sensor.emva1288 import EmvaFigure, emva1288_figures
from calibration.sensor.findings import curve_flags, frame_flags, parameter_flags
from calibration.sensor.judging import JudgedCurve, LevelInfluence, is_lamp_sweep, judged_curve, sound_darks
from calibration.sensor.levels import LevelStatistics, least_noise_dn2, small_scale_freedom, spatial_rounding_error_dn2
from calibration.sensor.pattern import FixedPattern, left_out_flags, pattern_flags

# Joint covariance of the calibrated quantities, carried from the statistics of the levels

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


# Results of the levels in DN, with their joint covariance: what noise parameters are made from


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Results of the levels, in DN."""

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
    """Return the levels with the most frames; of those the flat nearest to the middle, and its own dark."""
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
    """Return what the levels gave in DN, with its covariance. What does not exist is 0, as is its covariance."""
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


# Noise parameters in electrons, with their joint covariance, from what was measured in DN


# A fixed pattern whose variance is not this many errors above 0 is not seen.
_RESOLVED_SIGMA = 3.0
# A dark current that matters in few uses [e-/s].
_SMALL_E_PER_S = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseParameters:
    """Estimates by name, bounds of those that do not exist, the covariance of errors, and why some do not exist."""

    estimates: dict[str, Estimate]
    bounds: dict[str, Bound]
    covariance: JointCovariance
    flags: tuple[Flag, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Parameter:
    """A value, and its derivatives by what was measured."""

    name: str
    value: float
    gradient: FloatArray
    n: int


def noise_parameters(
    measured: Measured, *, has_read_noise: bool, has_dark_current: bool, longest_dark_s: float | None = None
) -> NoiseParameters:
    """Return the parameters in electrons."""
    parameters = [_gain(measured)]
    bounds = _bounds(measured, has_read_noise=has_read_noise)
    no_read_noise = _unseen_read_noise(measured) if has_read_noise else None
    if has_read_noise and no_read_noise is None:
        parameters.append(_read_noise(measured))
    if has_dark_current:
        parameters.append(_dark_current(measured))
    parameters.append(_black_level(measured))
    no_prnu, no_dsnu = _unseen(measured, FLAT_SPATIAL, "prnu"), _unseen(measured, DARK_SPATIAL, "dsnu")
    if no_prnu is None:
        parameters.append(_prnu(measured))
    if no_dsnu is None:
        parameters.append(_dsnu(measured))
    small = _small_dark_current(measured, longest_dark_s) if has_dark_current else None
    flags = (no_read_noise, no_prnu, no_dsnu, small)
    gradients = np.array([parameter.gradient for parameter in parameters])
    matrix = gradients @ measured.covariance @ gradients.T
    errors = np.sqrt(np.diag(matrix))
    return NoiseParameters(
        estimates={
            parameter.name: Estimate(value=parameter.value, std_error=float(error), n=parameter.n)
            for parameter, error in zip(parameters, errors, strict=True)
        },
        bounds={name: bound for name, bound in bounds.items() if name not in {one.name for one in parameters}},
        covariance=JointCovariance(names=tuple(parameter.name for parameter in parameters), matrix=matrix),
        flags=tuple(flag for flag in flags if flag is not None),
    )


def _bounds(measured: Measured, *, has_read_noise: bool) -> dict[str, Bound]:
    """Return how large read noise and fixed pattern can be at most."""
    gain, errors = float(measured.values[GAIN]), np.sqrt(np.diag(measured.covariance))
    largest_dn2 = np.maximum(measured.values, 0.0) + _RESOLVED_SIGMA * errors
    dark_dn2 = max(QUANTISATION_LIMIT_DN2, largest_dn2[DARK_VARIANCE] if has_read_noise else 0.0)
    return {
        "read_noise_e": Bound(bound="<", value=float(np.sqrt(dark_dn2)) / gain),
        "prnu": Bound(bound="<", value=float(np.sqrt(largest_dn2[FLAT_SPATIAL])) / measured.signal_dn),
        "dsnu_e": Bound(bound="<", value=float(np.sqrt(largest_dn2[DARK_SPATIAL])) / gain),
    }


def _gradient(derivatives: dict[int, float]) -> FloatArray:
    gradient = np.zeros(N_MEASURED)
    gradient[list(derivatives)] = list(derivatives.values())
    return gradient


def _gain(measured: Measured) -> _Parameter:
    return _Parameter(
        name="gain_dn_per_e",
        value=float(measured.values[GAIN]),
        gradient=_gradient({GAIN: 1.0}),
        n=measured.n_gain,
    )


def _read_noise(measured: Measured) -> _Parameter:
    gain, variance = measured.values[GAIN], measured.values[DARK_VARIANCE] - QUANTISATION_VAR_DN2
    value = float(np.sqrt(variance) / gain)
    return _Parameter(
        name="read_noise_e",
        value=value,
        gradient=_gradient({GAIN: -value / gain, DARK_VARIANCE: 0.5 * value / variance}),
        n=measured.n_dark,
    )


def _dark_current(measured: Measured) -> _Parameter:
    gain = measured.values[GAIN]
    value = float(measured.values[DARK_SLOPE] / gain)
    return _Parameter(
        name="dark_current_e_per_s",
        value=value,
        gradient=_gradient({GAIN: -value / gain, DARK_SLOPE: 1.0 / gain}),
        n=measured.n_dark,
    )


def _black_level(measured: Measured) -> _Parameter:
    return _Parameter(
        name="black_level_dn",
        value=float(measured.values[BLACK_LEVEL]),
        gradient=_gradient({BLACK_LEVEL: 1.0}),
        n=measured.n_dark,
    )


def _prnu(measured: Measured) -> _Parameter:
    variance, slope = measured.values[FLAT_SPATIAL], measured.values[RESPONSE_SLOPE]
    value = float(np.sqrt(variance) / slope) / measured.signal_dn
    return _Parameter(
        name="prnu",
        value=value,
        gradient=_gradient({FLAT_SPATIAL: 0.5 * value / variance, RESPONSE_SLOPE: -value / slope}),
        n=measured.n_flat_pattern,
    )


def _dsnu(measured: Measured) -> _Parameter:
    gain, variance = measured.values[GAIN], measured.values[DARK_SPATIAL]
    value = float(np.sqrt(variance) / gain)
    return _Parameter(
        name="dsnu_e",
        value=value,
        gradient=_gradient({GAIN: -value / gain, DARK_SPATIAL: 0.5 * value / variance}),
        n=measured.n_dark_pattern,
    )


def _unseen(measured: Measured, row: int, name: str) -> Flag | None:
    """Return a flag if a fixed pattern is lost in noise."""
    variance, error = float(measured.values[row]), float(np.sqrt(measured.covariance[row, row]))
    if variance > _RESOLVED_SIGMA * error:
        return None
    bound_dn = np.sqrt(max(variance, 0.0) + _RESOLVED_SIGMA * error)
    size = f"{bound_dn / measured.signal_dn:.2%}" if name == "prnu" else f"{bound_dn / measured.values[GAIN]:.3g} e-"
    return Flag(
        name=f"{name}_not_resolved",
        message=f"the variance from pixel to pixel is "
        f"{number_with_error(variance, error)} DN^2 once temporal noise is taken "
        f"off, not more than {_RESOLVED_SIGMA:.0f} standard errors above 0: the {name.upper()} is below {size}; take "
        f"a stack of 16 frames or more at one level to measure it",
    )


def _unseen_read_noise(measured: Measured) -> Flag | None:
    """Return a flag if the read noise is lost in what dark current adds, or in rounding."""
    variance = float(measured.values[DARK_VARIANCE])
    error = float(np.sqrt(measured.covariance[DARK_VARIANCE, DARK_VARIANCE]))
    if variance - QUANTISATION_VAR_DN2 > _RESOLVED_SIGMA * error and variance > QUANTISATION_LIMIT_DN2:
        return None
    bound_e = np.sqrt(max(variance, QUANTISATION_LIMIT_DN2) + _RESOLVED_SIGMA * error) / measured.values[GAIN]
    return Flag(
        name="read_noise_not_resolved",
        message=f"the dark variance at no exposure is "
        f"{number_with_error(variance, error)} DN^2, which is not more than its "
        f"error and rounding explain: the read noise is below {bound_e:.3g} e-; take dark frames at exposures so "
        f"short that dark current adds little",
    )


def _small_dark_current(measured: Measured, longest_s: float | None) -> Flag | None:
    """Return a flag if the dark current given is not different from none."""
    slope, error = (
        float(measured.values[DARK_SLOPE]),
        float(np.sqrt(measured.covariance[DARK_SLOPE, DARK_SLOPE])),
    )
    if abs(slope) > _RESOLVED_SIGMA * error:
        return None
    bound_e_per_s = (max(slope, 0.0) + _RESOLVED_SIGMA * error) / measured.values[GAIN]
    return Flag(
        name="dark_current_not_resolved",
        message=f"the dark mean grows by "
        f"{number_with_error(slope, error)} DN/s, not more than {_RESOLVED_SIGMA:.0f} standard "
        f"errors from 0: the dark current is below {bound_e_per_s:.3g} e-/s; {_longer(bound_e_per_s, longest_s)}",
    )


def _longer(bound_e_per_s: float, longest_s: float | None) -> str:
    """Return how long dark exposures would show a dark current as cameras have it."""
    if not longest_s:
        return "longer dark exposures measure it"
    wanted_s = float(np.clip(longest_s * bound_e_per_s / _SMALL_E_PER_S, 2.0 * longest_s, max(60.0, 2.0 * longest_s)))
    return f"dark frames of {float(f'{wanted_s:.1g}'):g} s would show more than {_SMALL_E_PER_S:g} e-/s"


# Performance of a sensor by its noise parameters: threshold, dynamic range, SNR, dark current by variance


@dataclass(frozen=True, kw_only=True)
class Performance:
    """Figures of merit; None is what the frames cannot give.

    Attributes
    ----------
    threshold_e : Estimate or None
        Absolute sensitivity threshold: electrons in a pixel at which the temporal SNR is 1.
    dynamic_range : Estimate or None
        Saturation over that threshold.
    snr_max : Estimate or None
        Temporal SNR of a pixel at saturation, square root of its electrons.
    dark_current_variance_e_per_s : Estimate or None
        Dark current by the growth of the dark variance [e-/s].
    dark_current_disagreement : float or None
        Dark current by the mean less that by the variance, over the standard error of the difference.
    quantum_efficiency : Estimate or None
        Electrons per photon, where the photons of the levels are stated. What these photons are uncertain by is not in
        its error.
    """

    threshold_e: Estimate | None
    dynamic_range: Estimate | None
    snr_max: Estimate | None
    dark_current_variance_e_per_s: Estimate | None
    dark_current_disagreement: float | None
    quantum_efficiency: Estimate | None


def performance(
    transfer: PhotonTransfer,
    dark: DarkSignal,
    *,
    gain: Estimate,
    read_noise_e: Estimate | None,
    saturation_e: Estimate | None,
) -> Performance:
    """Return the figures of merit of a sensor.

    Rounding counts as noise here: it is in what a pixel gives. In the dynamic range the gain cancels but for half an
    electron, so its error is that of saturation and of the dark noise in counts.

    EMVA Standard 1288, Release 4.0 Linear; the threshold here without its approximation.
    """
    threshold = None if read_noise_e is None else _threshold(gain, read_noise_e)
    by_variance = _dark_current_by_variance(dark, gain, n=0 if read_noise_e is None else read_noise_e.n)
    return Performance(
        threshold_e=threshold,
        dynamic_range=_dynamic_range(transfer, gain, saturation_e, threshold),
        snr_max=None if saturation_e is None else _root(saturation_e),
        dark_current_variance_e_per_s=by_variance,
        dark_current_disagreement=None if by_variance is None else _disagreement(dark, gain, by_variance),
        quantum_efficiency=_quantum_efficiency(transfer, gain),
    )


def temporal_noise_e(signal_e: FloatArray, *, read_noise_e: float, gain_dn_per_e: float) -> FloatArray:
    """Return the noise in time of a pixel, rounding included [e-]: electrons of the signal, read noise, 1/12 DN^2.

    Parameters
    ----------
    signal_e
        Mean signal, any shape, 0 or more [e-].
    read_noise_e
        0 or more [e-].
    gain_dn_per_e
        Above 0 [DN/e-].

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 2.
    """
    noise: FloatArray = np.sqrt(signal_e + read_noise_e**2 + QUANTISATION_VAR_DN2 / gain_dn_per_e**2)
    return noise


def total_noise_e(temporal_e: FloatArray, signal_e: FloatArray, *, prnu: float, dsnu_e: float) -> FloatArray:
    """Return the noise in time and from pixel to pixel together [e-]; signal in electrons.

    Parameters
    ----------
    temporal_e, signal_e
        Noise in time and mean signal, any shape, 0 or more [e-].
    prnu
        Relative deviation of the pixels' response, 0 or more.
    dsnu_e
        Deviation of their dark signal, 0 or more [e-].

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 4.
    """
    noise: FloatArray = np.sqrt(np.square(temporal_e) + dsnu_e**2 + np.square(prnu * signal_e))
    return noise


def _threshold(gain: Estimate, read_noise_e: Estimate) -> Estimate:
    variance_e2 = read_noise_e.value**2 + QUANTISATION_VAR_DN2 / gain.value**2
    root = float(np.sqrt(0.25 + variance_e2))
    # The read noise's error holds the gain's already.
    error = read_noise_e.value * read_noise_e.std_error / root
    return Estimate(value=0.5 + root, std_error=error, n=read_noise_e.n)


def _dynamic_range(
    transfer: PhotonTransfer, gain: Estimate, saturation_e: Estimate | None, threshold_e: Estimate | None
) -> Estimate | None:
    if saturation_e is None or threshold_e is None or transfer.saturation is None:
        return None
    value = saturation_e.value / threshold_e.value
    relative_gain = gain.std_error / gain.value
    of_saturation = transfer.saturation.std_error_dn / transfer.saturation.signal_dn
    of_threshold = np.sqrt(max((threshold_e.std_error / threshold_e.value) ** 2 - relative_gain**2, 0.0))
    return Estimate(
        value=value,
        std_error=value * float(np.hypot(of_saturation, of_threshold)),
        n=max(saturation_e.n, threshold_e.n),
    )


def _root(saturation_e: Estimate) -> Estimate:
    value = float(np.sqrt(saturation_e.value))
    return Estimate(value=value, std_error=0.5 * saturation_e.std_error / value, n=saturation_e.n)


def _dark_current_by_variance(dark: DarkSignal, gain: Estimate, *, n: int) -> Estimate | None:
    fit = dark.variance_fit
    if fit is None or not dark.has_slope or n == 0:
        return None
    value = float(fit.parameters[1]) / gain.value**2
    own = float(np.sqrt(fit.covariance[1, 1])) / gain.value**2
    return Estimate(value=value, std_error=float(np.hypot(own, 2.0 * value * gain.std_error / gain.value)), n=n)


def _disagreement(dark: DarkSignal, gain: Estimate, by_variance: Estimate) -> float:
    by_mean = float(dark.mean_fit.parameters[1]) / gain.value
    error = np.hypot(float(np.sqrt(dark.mean_fit.covariance[1, 1])) / gain.value, by_variance.std_error)
    return (by_mean - by_variance.value) / float(error)


def _quantum_efficiency(transfer: PhotonTransfer, gain: Estimate) -> Estimate | None:
    curve = transfer.linearity
    if curve is None or curve.dn_per_photon is None:
        return None
    value = float(curve.dn_per_photon / gain.value)
    relative = np.hypot(curve.dn_per_photon_std_error / curve.dn_per_photon, gain.std_error / gain.value)
    return Estimate(value=value, std_error=float(value * relative), n=gain.n)


# A sensor's noise parameters from dark and flat levels, each with what it is uncertain by

_STATED = StatedExposures()
_STANDARD_DARK_CURRENTS = ("dark_current_mean_e_per_s", "dark_current_variance_e_per_s")


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseCalibration:
    """A sensor's noise parameters; None is what the frames cannot give, and a flag then says why.

    Attributes
    ----------
    gain_dn_per_e : Estimate
        Counts per electron [DN/e-].
    read_noise_e : Estimate or None
        Temporal noise of a dark pixel at no exposure, rounding taken off [e-].
    dark_current_e_per_s : Estimate or None
        Growth of the dark mean [e-/s]; may be below 0 by its error.
    black_level_dn : Estimate
        Dark mean at no exposure [DN].
    saturation_e : Estimate or None
        Signal of largest temporal variance [e-].
    prnu : Estimate or None
        Standard deviation of the response from pixel to pixel, relative to its mean; without what is smooth on a
        sixteenth of the picture.
    dsnu_e : Estimate or None
        Standard deviation of the dark signal from pixel to pixel [e-].
    covariance : JointCovariance
        Of the errors of all that exist but the saturation.
    flags : tuple of Flag
        What is to be known of the frames. None of them refuses: a refused set has no calibration.
    bounds : dict
        How large or small the numbers that are None can be, by their names, where the frames say that.
    performance : Performance
        Threshold, dynamic range, SNR, dark current by variance, quantum efficiency.
    transfer : PhotonTransfer
        The photon-transfer curve.
    dark : DarkSignal
        The lines through the dark levels.
    flats, darks : tuple of LevelStatistics
        The levels: flats by ascending mean, darks as given.
    spatial : SpatialLevels
        Which of them the fixed pattern was taken from.
    emva1288 : dict
        The numbers of EMVA 1288 by its own unweighted fits, by the names of `calibration.sensor.emva1288.EMVA_SYMBOLS`.
    influence : tuple of LevelInfluence
        Each flat beside what all others say of it, in the order of `flats`.
    light_stability : LightStability
        Wander of the light from frame to frame, from the repeats within levels.
    """

    gain_dn_per_e: Estimate
    read_noise_e: Estimate | None
    dark_current_e_per_s: Estimate | None
    black_level_dn: Estimate
    saturation_e: Estimate | None
    prnu: Estimate | None
    dsnu_e: Estimate | None
    covariance: JointCovariance
    flags: tuple[Flag, ...]
    bounds: dict[str, Bound]
    performance: Performance
    transfer: PhotonTransfer
    dark: DarkSignal
    flats: tuple[LevelStatistics, ...]
    darks: tuple[LevelStatistics, ...]
    spatial: SpatialLevels
    emva1288: dict[str, EmvaFigure | None]
    influence: tuple[LevelInfluence, ...]
    light_stability: LightStability


def calibrate_noise(
    levels: Sequence[LevelStatistics], *, bit_depth: int, stated: StatedExposures = _STATED
) -> NoiseCalibration:
    """Return gain, read noise, dark current, black level, saturation, PRNU and DSNU of a sensor.

    Parameters
    ----------
    levels : sequence of LevelStatistics
        Dark and flat levels of one camera at one gain, in any order; at least one of each.
    bit_depth : int
        Bits per sample, 1 to 16; the largest sample is 2**bit_depth - 1.
    stated : StatedExposures
        Where the exposures are from, for advice on their unit.

    Raises
    ------
    RefusedFramesError
        The frames show something that makes any number from them wrong, there are no dark or no flat levels, they
        differ in size, or no flat can be used; what was found is in its flags.
    CalibrationError
        The bit depth is none.

    Notes
    -----
    Standard errors hold sampling and, where points scatter by more than that, their scatter. To first order:
    good to a few per cent of themselves when the relative errors are below 10 %.

    PRNU and DSNU are those of a population from which this sensor's pixels are drawn, taken from the levels
    with the most frames, of those the flat nearest to half of saturation. What is smooth across the picture is taken
    off the PRNU: uneven light and shading of a lens cannot be told from a sensor's own.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6 to 8. Different from it: the response of the sensor, weights,
    bend of the curve, several exposures for the read noise, standard errors. `NoiseCalibration.emva1288` has its own.
    """
    flats, all_darks = _sorted_levels(levels, bit_depth)
    flags = frame_flags(levels, bit_depth=bit_depth)
    flags += impossible_exposures(levels, stated=stated)
    _refuse_if_any(flags)
    darks, dark_flags = sound_darks(all_darks)
    dark, match = fit_dark_signal(darks), match_darks(flats, darks)
    ceiling_dn = sample_ceiling_dn(levels, bit_depth=bit_depth)
    curve = judged_curve(flats, darks, dark, match, ceiling_dn=ceiling_dn)
    wrong = [flat for flat, one in zip(flats, curve.levels, strict=True) if one.cause is not None]
    flags += (*dark_flags, *curve.flags, *curve_flags(levels, flats, curve.transfer, dark, match, wrong=wrong))
    _refuse_if_any(flags)
    found = _Levels(flats=flats, darks=darks, dark=dark, match=match, curve=curve, ceiling_dn=ceiling_dn, stated=stated)
    return _numbers(found, flags)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Levels:
    """Levels that nothing refuses, and the lines and the curve through them."""

    flats: Sequence[LevelStatistics]
    darks: Sequence[LevelStatistics]
    dark: DarkSignal
    match: DarkMatch
    curve: JudgedCurve
    ceiling_dn: int
    stated: StatedExposures


def _numbers(of: _Levels, flags: tuple[Flag, ...]) -> NoiseCalibration:
    """Return the numbers of levels, with what was said of them before and what their numbers say."""
    transfer = of.curve.transfer
    spatial = choose_spatial_levels(of.flats, of.darks, transfer=transfer, match=of.match)
    measured = measure(of.flats, of.darks, transfer=transfer, dark=of.dark, match=of.match, spatial=spatial)
    parameters, of_unit = _plausible_parameters(measured, of)
    best = parameters.estimates
    saturation_e = _saturation(of.flats, transfer)
    merit, standard = _merit(of, best, saturation_e, has_unit=not of_unit)
    flags += (*parameters.flags, *left_out_flags(of.darks[spatial.dark], of.flats[spatial.flat]), *of_unit)
    flags += parameter_flags(
        dark_current_e_per_s=best.get("dark_current_e_per_s"), quantum_efficiency=merit.quantum_efficiency
    )
    flags += unusual_dark_current(best.get("dark_current_e_per_s"), stated=of.stated)
    return NoiseCalibration(
        gain_dn_per_e=best["gain_dn_per_e"],
        read_noise_e=best.get("read_noise_e"),
        dark_current_e_per_s=best.get("dark_current_e_per_s"),
        black_level_dn=best["black_level_dn"],
        saturation_e=saturation_e,
        prnu=best.get("prnu"),
        dsnu_e=best.get("dsnu_e"),
        covariance=parameters.covariance,
        flags=by_consequence(flags),
        bounds=parameters.bounds | _saturation_bound(transfer),
        performance=merit,
        transfer=transfer,
        dark=of.dark,
        flats=tuple(of.flats),
        darks=tuple(of.darks),
        spatial=spatial,
        emva1288=standard,
        influence=of.curve.levels,
        light_stability=of.curve.stability,
    )


def _merit(
    of: _Levels, best: dict[str, Estimate], saturation_e: Estimate | None, *, has_unit: bool
) -> tuple[Performance, dict[str, EmvaFigure | None]]:
    """Return figures of merit and those of the standard; without a unit of the exposures no dark current."""
    merit = performance(
        of.curve.transfer,
        of.dark,
        gain=best["gain_dn_per_e"],
        read_noise_e=best.get("read_noise_e"),
        saturation_e=saturation_e,
    )
    standard = emva1288_figures(of.flats, of.darks, ceiling_dn=of.ceiling_dn)
    if has_unit:
        return merit, standard
    merit = replace(merit, dark_current_variance_e_per_s=None, dark_current_disagreement=None)
    return merit, standard | dict.fromkeys(_STANDARD_DARK_CURRENTS)


def _sorted_levels(
    levels: Sequence[LevelStatistics], bit_depth: int
) -> tuple[list[LevelStatistics], list[LevelStatistics]]:
    if bit_depth not in range(1, 17):
        raise CalibrationError(f"bit_depth is {bit_depth}; allowed is 1 to 16")
    flats = sorted((level for level in levels if level.kind == "flat"), key=lambda level: level.mean_dn)
    darks = [level for level in levels if level.kind == "dark"]
    if not flats or not darks:
        raise refused(
            "missing_levels",
            f"there are {len(flats)} flat and {len(darks)} dark levels of two frames or more; at least one of each is "
            f"needed, better ten exposures with two flats and two darks at each",
        )
    shapes = {level.shape for level in levels}
    if len(shapes) > 1:
        raise refused(
            "mixed_size", f"levels differ in size (rows, columns): {sorted(shapes)}; use one region throughout"
        )
    return flats, darks


def _plausible_parameters(measured: Measured, of: _Levels) -> tuple[NoiseParameters, tuple[Flag, ...]]:
    """Return the parameters, without a dark current that no camera has, and what is said of it."""
    has_read_noise = of.dark.variance_fit is not None
    longest_s = max((one.exposure_s for one in of.darks if one.exposure_s is not None), default=None)
    found = noise_parameters(
        measured, has_read_noise=has_read_noise, has_dark_current=of.dark.has_slope, longest_dark_s=longest_s
    )
    dark_current_e_per_s = found.estimates.get("dark_current_e_per_s")
    if not is_absurd(dark_current_e_per_s):
        return found, ()
    said = implausible_unit((*of.flats, *of.darks), dark_current_e_per_s, stated=of.stated) or (
        Flag(
            name="dark_current_not_resolved",
            message=f"dark exposures up to {longest_s or 0.0:.3g} s are too short for a dark current of any camera to "
            f"show: it is not known; take dark frames of 1 s or more",
        ),
    )
    return noise_parameters(measured, has_read_noise=has_read_noise, has_dark_current=False), said


def _saturation_bound(transfer: PhotonTransfer) -> dict[str, Bound]:
    """Return the brightest signal without saturation, where saturation was not reached."""
    if transfer.saturation is not None:
        return {}
    below = transfer.points.signal_dn[~transfer.points.saturated]
    return {"saturation_e": Bound(bound=">", value=float(below.max()) / transfer.gain_dn_per_e)} if below.size else {}


def _saturation(flats: Sequence[LevelStatistics], transfer: PhotonTransfer) -> Estimate | None:
    level = transfer.saturation
    if level is None:
        return None
    value = level.signal_dn / transfer.gain_dn_per_e
    relative_gain_error = float(np.sqrt(transfer.fit.covariance[0, 0])) / transfer.gain_dn_per_e
    return Estimate(
        value=value,
        std_error=float(np.hypot(level.std_error_dn / transfer.gain_dn_per_e, value * relative_gain_error)),
        n=flats[level.lower].n_frames + flats[level.upper].n_frames,
    )


def _refuse_if_any(flags: tuple[Flag, ...]) -> None:
    if any(flag.refuses for flag in flags):
        raise RefusedFramesError(flags)


# Reasons why a number of a calibration is not known, each with the one measurement that would tell

_STACKS = "take a stack of 16 frames or more at half of saturation, and as many dark frames"
_BY_FLAG = {
    "read_noise_e": ("quantisation_limited", "read_noise_not_resolved"),
    "dark_current_e_per_s": (
        "wrong_time_unit",
        "light_in_darks",
        "dark_current_or_light",
        "dark_current_changed",
        "dark_current_not_resolved",
        "single_dark_exposure",
    ),
}
_REASONS = {
    "quantisation_limited": "rounding to whole counts hides the noise of dark frames: raise the camera's gain",
    "read_noise_not_resolved": "dark current or rounding hides it: take dark frames at the shortest exposure",
    "wrong_time_unit": "exposures seem to be in another unit than stated: wrong_time_unit says how to correct it",
    "light_in_darks": "light reached the dark frames: cover the lens and take them again",
    "dark_current_or_light": "it may be light: cover the lens and take stacks of 16 flats and darks at one exposure",
    "dark_current_changed": "it changed while the dark frames were taken: let the camera warm up and take them again",
    "dark_current_not_resolved": "dark exposures are too short: take dark frames of 1 s or more",
    "single_dark_exposure": "dark frames have one exposure: take dark frames of 1 s or more beside them",
}


def not_known(calibration: NoiseCalibration) -> dict[str, str]:
    """Return why each number that is not known is not, by the number's name.

    Parameters
    ----------
    calibration : NoiseCalibration
        The calibration; names of ``performance`` and ``emva1288`` are among the keys.
    """
    best, merit = calibration, calibration.performance
    names = {flag.name for flag in best.flags}
    found = {
        name: _REASONS[flags[0] if not names.intersection(flags) else next(one for one in flags if one in names)]
        for name, flags in _BY_FLAG.items()
        if getattr(best, name) is None
    }
    if best.prnu is None:
        found["prnu"] = f"noise in time hides it: {_STACKS}"
    if best.dsnu_e is None:
        found["dsnu_e"] = f"noise in time, or rounding, hides it: {_STACKS}, longer if it stays so"
    if best.saturation_e is None:
        found["saturation_e"] = f"the sweep ends below it: {_brighter(best)}"
    if merit.quantum_efficiency is None:
        found["quantum_efficiency"] = _no_efficiency(best)
    if merit.threshold_e is None:
        found["threshold_e"] = found.get("read_noise_e", "the read noise is not known")
    if merit.dynamic_range is None:
        found["dynamic_range"] = found.get("saturation_e") or found.get("read_noise_e", "saturation is not known")
    if merit.snr_max is None:
        found["snr_max"] = found.get("saturation_e", "saturation is not known")
    if merit.dark_current_variance_e_per_s is None:
        found["dark_current_variance_e_per_s"] = found.get("read_noise_e") or found.get(
            "dark_current_e_per_s", "dark frames have one exposure: take longer ones beside them"
        )
    return found | _standard(best, found)


def _brighter(best: NoiseCalibration) -> str:
    """Return how flats become brighter in a sweep of this kind."""
    return (
        "go on with a brighter lamp until pixels are full"
        if is_lamp_sweep(best.flats)
        else "go on with longer exposures until pixels are full"
    )


def _no_efficiency(best: NoiseCalibration) -> str:
    if any(flat.photons is None for flat in best.flats):
        return "photons per pixel are not stated: measure the irradiance with a calibrated photodiode"
    return "fewer than 7 levels have a light that is known: take more levels of stated photons"


def _standard(best: NoiseCalibration, found: dict[str, str]) -> dict[str, str]:
    """Return the reasons of the standard's own numbers."""
    missing = [name for name, figure in best.emva1288.items() if figure is None]
    reasons = {}
    for name in missing:
        if name.startswith("linearity"):
            reasons[name] = (
                f"it is over 5 to 95 % of saturation, which was not reached: {_brighter(best)}"
                if best.saturation_e is None
                else "fewer than three levels of known light lie within 5 to 95 % of saturation: take more"
            )
        elif name.startswith(("dsnu", "prnu")):
            reasons[name] = f"its variance is not above 0 once noise in time is taken off: {_STACKS}"
        elif name.startswith("dark_current"):
            reasons[name] = found.get("dark_current_e_per_s", "dark frames have fewer than three exposures: take more")
        elif name.startswith(("saturation", "dynamic", "snr")) and best.saturation_e is None:
            reasons[name] = found["saturation_e"]
        else:
            reasons[name] = _no_efficiency(best)
    return {name: reason for name, reason in reasons.items() if name not in found}


# Three lines of a calibration to read first: what to trust, what is a bound or not known, what to do next

_NAMES = {
    "read_noise_e": "read noise",
    "dark_current_e_per_s": "dark current",
    "saturation_e": "saturation",
    "prnu": "PRNU",
    "dsnu_e": "DSNU",
}
_NEXT = {
    "light_or_gain_changed": "take all levels again with automatic gain off and a lamp that is warm",
    "wrong_time_unit": "correct the unit of the exposures, as wrong_time_unit says",
    "light_in_darks": "cover the lens and take the dark frames again",
    "dark_current_or_light": "cover the lens, and take stacks of 16 flats and darks at one exposure",
    "wrong_bit_depth": "state the camera's own bit depth",
    "correlated_noise": "save raw frames, without filters",
    "frames_go_together": "switch noise reduction off",
    "banded_light": "use a lamp on direct current",
    "another_gain": "take the named level again, at the gain of the others",
    "wrong_level": "take the named level again",
    "wrong_dark": "take the named dark level again, with the lens covered",
    "wrong_variance": "take the named level again",
    "wrong_light": "correct exposure or photons of the named level",
    "unclear_level": "take the named level again, and more beside it",
    "dark_current_changed": "let the camera warm up, and take the dark frames in mixed order",
    "quantisation_limited": "raise the camera's gain, or save more bits",
    "too_few_levels": "take ten levels or more between dark and 80 % of saturation",
    "scattered_photon_transfer": "take more levels",
    "unsteady_lamp": "let the lamp warm up",
    "lamp_flicker": "use a steadier lamp",
    "dark_exposure_missing": "take dark frames at the exposures of the flats",
    "dark_current_not_resolved": "take dark frames of 10 s",
    "single_dark_exposure": "take dark frames of 10 s",
    "dsnu_not_resolved": "take a stack of 16 dark frames or more",
    "prnu_not_resolved": "take a stack of 16 flats or more",
    "short_stack": "take stacks of 16 frames or more",
}


def first_lines(calibration: NoiseCalibration) -> tuple[str, str, str]:
    """Return three lines to read first.

    Parameters
    ----------
    calibration : NoiseCalibration
        The calibration, its flags in the order of what they do.
    """
    gain = calibration.gain_dn_per_e
    share = gain.std_error / gain.value
    trust = f"trust the gain to {share:.1%}" if share >= 1e-3 else f"trust the gain to {share:.2%}"
    named = [flag.level for flag in calibration.flags if flag.level is not None and flag.name != "unclear_level"]
    if named:
        trust += f"; {len(dict.fromkeys(named))} level{'s are' if len(set(named)) > 1 else ' is'} named as wrong"
    return f"{trust}.", f"{_unknown(calibration)}.", f"{_next(calibration)}."


def _unknown(calibration: NoiseCalibration) -> str:
    missing = {name: word for name, word in _NAMES.items() if getattr(calibration, name) is None}
    bounds = [word for name, word in missing.items() if name in calibration.bounds]
    unknown = [word for name, word in missing.items() if name not in calibration.bounds]
    found = []
    if bounds:
        found.append(f"{_listed(bounds)} {'is a bound' if len(bounds) == 1 else 'are bounds'}")
    if unknown:
        found.append(f"{_listed(unknown)} {'is' if len(unknown) == 1 else 'are'} not known")
    return "; ".join(found) or "all best numbers are known"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _next(calibration: NoiseCalibration) -> str:
    for flag in calibration.flags:
        if flag.name == "saturation_not_reached":
            more = "a brighter lamp" if is_lamp_sweep(calibration.flats) else "longer exposures"
            return f"next: go on with {more} until pixels are full"
        if flag.name in _NEXT:
            return f"next: {_NEXT[flag.name]}"
    return "nothing needs to be taken again"


# Light in dark frames: whether the fixed pattern shows it, and what a calibration may then say of its dark current

SingleArray = NDArray[np.float32]

# A dark current beyond this may be light; below, light and the dark current of pixels with unlike gains are as likely.
USUAL_DARK_E_PER_S = 1000.0
_WINDOW, _OUTLIER, _LEAST_PIXELS = 15, 5.0, 1000
# Variance of white noise that a local mean leaves.
_LOCAL_SHARE = 1.0 - 1.0 / _WINDOW**2
_SIGMA, _LEAST_SHARE = 5.0, 1e-4
_GAIN_SIGMA = 3.0
_OF_DARK_CURRENT = ("dark_current_not_resolved", "unusual_dark_current")
_DARK_CURRENT = "dark_current_e_per_s"


@dataclass(frozen=True, kw_only=True)
class DarkLight:
    """Light in a dark stack by the pattern of the response to light in it."""

    light: Estimate
    covariance: Estimate
    is_seen: bool
    excludes_light: bool


def dark_light(pattern: FixedPattern, *, black_level_dn: float) -> DarkLight | None:
    """Return the light in a dark stack, None where the response has no pattern to know it by.

    Dark current has its own pattern from pixel to pixel, light has that of the response (PRNU), and so has dark current
    where each pixel has a gain of its own. With r the relative response, d the dark mean less its local mean,
    cov(d, r) = light var(r) - noise / signal, where the noise of the dark mean enters r by the dark that was taken off.

    Which share of the response is gain the noise of the pixels tells: the variance of photons goes with the gain's
    square, and with the light. Where that share of the dark signal is all that is seen, there is no sign of light.
    """
    dark, response = (_local(one) for one in (pattern.dark.mean_dn, _response_light_in_darks(pattern)))
    noise_dn2 = float(np.mean(pattern.dark.temporal_variance_dn2)) / pattern.n_dark_frames
    flat_noise_dn2 = float(np.mean(pattern.flat.temporal_variance_dn2)) / pattern.n_flat_frames
    kept = (np.abs(dark) < _OUTLIER * _robust_std(dark)) & (np.abs(response) < _OUTLIER * _robust_std(response))
    is_rounded = float(np.median(pattern.dark.temporal_variance_dn2)) < QUANTISATION_LIMIT_DN2
    if is_rounded or np.count_nonzero(kept) < _LEAST_PIXELS:
        # What rounding hides of a pixel's own offset stays in the flat, and looks like response.
        return None
    d, r = dark[kept].astype(np.float64), response[kept].astype(np.float64)
    of_response = float(r.var()) - _LOCAL_SHARE * (noise_dn2 + flat_noise_dn2) / pattern.signal_dn**2
    if of_response <= 0.0:
        return None
    together = float(np.mean((d - d.mean()) * (r - r.mean()))) + _LOCAL_SHARE * noise_dn2 / pattern.signal_dn
    of_chance = float(np.sqrt(d.var() * r.var() / d.size))
    error_dn = of_chance / of_response
    light = Estimate(value=together / of_response, std_error=error_dn, n=pattern.n_dark_frames)
    dark_dn = max(float(pattern.dark.mean_dn[kept].mean()) - black_level_dn, 0.0)
    share = _gain_share(pattern, r, kept, of_response=of_response)
    is_of_gain = share.value > _GAIN_SIGMA * share.std_error and light.value - share.value * dark_dn < (
        _GAIN_SIGMA * float(np.hypot(error_dn, share.std_error * dark_dn))
    )
    is_there = light.value > _SIGMA * error_dn and light.value > _LEAST_SHARE * pattern.signal_dn
    return DarkLight(
        light=light,
        covariance=Estimate(value=together / pattern.signal_dn, std_error=of_chance / pattern.signal_dn, n=light.n),
        is_seen=is_there and not is_of_gain,
        excludes_light=light.value < _GAIN_SIGMA * error_dn and dark_dn - light.value > _SIGMA * error_dn,
    )


def _gain_share(
    pattern: FixedPattern, response: NDArray[np.float64], kept: NDArray[np.bool_], *, of_response: float
) -> Estimate:
    """Return the share of what pixels differ by in their response that is their gain.

    The variance of photons grows with the response by 1 where pixels catch more light, by 2 where their gain is higher.
    """
    variance = (pattern.flat.temporal_variance_dn2 - pattern.dark.temporal_variance_dn2)[kept].astype(np.float64)
    mean = float(variance.mean())
    slope = float(np.mean((variance / mean - 1.0) * (response - response.mean()))) / of_response
    error = float(np.sqrt(variance.var() * response.var() / response.size)) / abs(mean) / of_response
    return Estimate(value=slope - 1.0, std_error=error, n=pattern.n_flat_frames)


def _response_light_in_darks(pattern: FixedPattern) -> SingleArray:
    response: SingleArray = (pattern.flat.mean_dn - pattern.dark.mean_dn) / np.float32(pattern.signal_dn)
    return response


def _local(picture: SingleArray) -> SingleArray:
    """Return a picture less its local mean, without rows and columns."""
    local: SingleArray = picture - cv2.blur(picture, (_WINDOW, _WINDOW))
    local -= np.median(local, axis=0, keepdims=True)
    local -= np.median(local, axis=1, keepdims=True)
    return local


def _robust_std(picture: SingleArray) -> float:
    return 1.4826 * float(np.median(np.abs(picture)))


def with_pattern(calibration: NoiseCalibration, pattern: FixedPattern | None) -> NoiseCalibration:
    """Return a calibration with what its fixed pattern says, without a dark current where darks may have seen light.

    Parameters
    ----------
    calibration : NoiseCalibration
        From the levels alone.
    pattern : FixedPattern or None
        Of its two stacks, pixel by pixel; None where there is none.

    Notes
    -----
    A dark current within what cameras usually have is taken for one unless the pattern shows light in it; one that is
    larger is taken for one where light would have shown, and is otherwise a bound.
    """
    found = () if pattern is None else pattern_flags(pattern)
    # The pixel-by-pixel look at defects says more than that at their variance.
    named = {flag.name for flag in found}
    kept = tuple(flag for flag in calibration.flags if flag.name not in named)
    calibration = replace(calibration, flags=by_consequence((*kept, *found)))
    light = None if pattern is None else dark_light(pattern, black_level_dn=calibration.black_level_dn.value)
    if light is not None:
        calibration = _with_own_response(calibration, light.covariance)
    if light is not None and light.is_seen:
        return _with_light(calibration, light.light)
    current = calibration.dark_current_e_per_s
    if current is None or (light is not None and light.excludes_light):
        return calibration
    if current.value - _SIGMA * current.std_error < USUAL_DARK_E_PER_S:
        return calibration
    return _without_dark_current(calibration, _untestable_flag(current), bound=current)


def _share_of_flat(calibration: NoiseCalibration) -> float:
    """Return the dark signal within the flat of the fixed pattern over that of the dark stack, 1 where not known."""
    flat_s = calibration.flats[calibration.spatial.flat].exposure_s
    stack_s = calibration.darks[calibration.spatial.dark].exposure_s
    if flat_s is None or stack_s is None or not calibration.dark.has_slope:
        return 1.0
    of_flat, of_stack = calibration.dark.mean_at(np.array([flat_s, stack_s])) - calibration.black_level_dn.value
    return float(of_flat / of_stack) if of_stack > 0.0 and of_flat > 0.0 else 1.0


def _with_own_response(calibration: NoiseCalibration, covariance: Estimate) -> NoiseCalibration:
    """Return a calibration whose PRNU is of the light alone, where dark signal and response go together.

    The variance of a flat less that of its dark holds twice their covariance: with a gain of each pixel's own, dark
    current differs from pixel to pixel as the light does.
    """
    prnu = calibration.prnu
    if prnu is None or abs(covariance.value) < _GAIN_SIGMA * covariance.std_error:
        return calibration
    square = prnu.value**2 - 2.0 * _share_of_flat(calibration) * covariance.value
    if square <= 0.0:
        return calibration
    value = float(np.sqrt(square))
    names, matrix = calibration.covariance.names, calibration.covariance.matrix.copy()
    own = names.index("prnu")
    matrix[own] *= prnu.value / value
    matrix[:, own] *= prnu.value / value
    matrix[own, own] += (covariance.std_error / value) ** 2
    return replace(
        calibration,
        prnu=replace(prnu, value=value, std_error=float(np.sqrt(matrix[own, own]))),
        covariance=JointCovariance(names=names, matrix=matrix),
    )


def _with_light(calibration: NoiseCalibration, light: Estimate) -> NoiseCalibration:
    """Return a calibration whose dark current is uncertain by light, or a bound where that is more than usual."""
    current, dark = calibration.dark_current_e_per_s, calibration.darks[calibration.spatial.dark]
    flagged = replace(calibration, flags=by_consequence((*calibration.flags, _light_flag(light))))
    if current is None or not dark.exposure_s:
        return flagged
    rate_e_per_s = light.value / calibration.gain_dn_per_e.value / dark.exposure_s
    if rate_e_per_s >= USUAL_DARK_E_PER_S:
        return _without_dark_current(calibration, _light_flag(light), bound=current)
    names, wider = calibration.covariance.names, calibration.covariance.matrix.copy()
    own = names.index(_DARK_CURRENT)
    wider[own, own] += rate_e_per_s**2
    return replace(
        flagged,
        dark_current_e_per_s=replace(current, std_error=float(np.sqrt(wider[own, own]))),
        covariance=JointCovariance(names=names, matrix=wider),
    )


def _without_dark_current(calibration: NoiseCalibration, flag: Flag, *, bound: Estimate) -> NoiseCalibration:
    names, matrix = calibration.covariance.names, calibration.covariance.matrix
    kept = [index for index, name in enumerate(names) if name != _DARK_CURRENT]
    largest = max(bound.value, 0.0) + _GAIN_SIGMA * bound.std_error
    flags = tuple(one for one in calibration.flags if one.name not in _OF_DARK_CURRENT)
    unusual = next((one.message for one in calibration.flags if one.name == "unusual_dark_current"), None)
    if unusual is not None:
        flag = replace(flag, message=f"{flag.message}; without light, {unusual}")
    return replace(
        calibration,
        dark_current_e_per_s=None,
        bounds=calibration.bounds | {_DARK_CURRENT: Bound(bound="<", value=largest)},
        covariance=JointCovariance(names=tuple(names[index] for index in kept), matrix=matrix[np.ix_(kept, kept)]),
        flags=by_consequence((*flags, flag)),
    )


def _light_flag(light: Estimate) -> Flag:
    return Flag(
        name="light_in_darks",
        message=f"dark frames show the pattern that pixels have in the light, as "
        f"{number_with_error(light.value, light.std_error)} DN "
        f"of light would (more than {_SIGMA:.0f} standard errors): light got in, or "
        f"each pixel has a gain of its own; the dark current cannot be told from it: cover the lens, and take the dark "
        f"frames again",
    )


def _untestable_flag(current: Estimate) -> Flag:
    return Flag(
        name="dark_current_or_light",
        message=f"dark frames gain "
        f"{number_with_error(current.value, current.std_error)} e-/s, more than cameras usually do "
        f"({USUAL_DARK_E_PER_S:.0f} e-/s), and the fixed pattern is too little known to tell dark current from light: "
        f"cover the lens, and take stacks of 16 flats and 16 darks or more at one exposure",
    )
