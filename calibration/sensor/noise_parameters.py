"""Noise parameters in electrons, with their joint covariance, from what was measured in DN."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Bound, Estimate, JointCovariance
from calibration.flags import Flag
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2, QUANTISATION_VAR_DN2, DarkMatch, DarkSignal
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.photon_transfer import RANGE_OF_SATURATION, PhotonTransfer
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

FloatArray = NDArray[np.float64]

# A fixed pattern whose variance is not this many errors above 0 is not seen.
_RESOLVED_SIGMA = 3.0
# A dark current that matters in few uses [e-/s].
_SMALL_E_PER_S = 3.0


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


def noise_parameters(
    measured: Measured, *, has_read_noise: bool, has_dark_current: bool, longest_dark_s: float | None = None
) -> NoiseParameters:
    """Return the parameters in electrons.

    Parameters
    ----------
    measured : Measured
        What the levels gave.
    has_read_noise, has_dark_current : bool
        True where the dark levels allow these two.
    longest_dark_s : float or None
        Longest exposure of a dark level, where it is known [s].
    """
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
        name="gain_dn_per_e", value=float(measured.values[GAIN]), gradient=_gradient({GAIN: 1.0}), n=measured.n_gain
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
    size = f"{bound_dn / measured.signal_dn:.2%}" if name == "prnu" else f"{bound_dn / measured.values[GAIN]:.2g} e-"
    return Flag(
        name=f"{name}_not_resolved",
        message=f"the variance from pixel to pixel is {variance:.3g} +- {error:.3g} DN^2 once temporal noise is taken "
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
        message=f"the dark variance at no exposure is {variance:.3g} +- {error:.3g} DN^2, which is not more than its "
        f"error and rounding explain: the read noise is below {bound_e:.3g} e-; take dark frames at exposures so "
        f"short that dark current adds little",
    )


def _small_dark_current(measured: Measured, longest_s: float | None) -> Flag | None:
    """Return a flag if the dark current given is not different from none."""
    slope, error = float(measured.values[DARK_SLOPE]), float(np.sqrt(measured.covariance[DARK_SLOPE, DARK_SLOPE]))
    if abs(slope) > _RESOLVED_SIGMA * error:
        return None
    bound_e_per_s = (max(slope, 0.0) + _RESOLVED_SIGMA * error) / measured.values[GAIN]
    return Flag(
        name="dark_current_not_resolved",
        message=f"the dark mean grows by {slope:.3g} +- {error:.3g} DN/s, not more than {_RESOLVED_SIGMA:.0f} standard "
        f"errors from 0: the dark current is below {bound_e_per_s:.3g} e-/s; {_longer(bound_e_per_s, longest_s)}",
    )


def _longer(bound_e_per_s: float, longest_s: float | None) -> str:
    """Return how long dark exposures would show a dark current as cameras have it."""
    if not longest_s:
        return "longer dark exposures measure it"
    wanted_s = float(np.clip(longest_s * bound_e_per_s / _SMALL_E_PER_S, 2.0 * longest_s, max(60.0, 2.0 * longest_s)))
    return f"dark frames of {float(f'{wanted_s:.1g}'):g} s would show more than {_SMALL_E_PER_S:g} e-/s"
