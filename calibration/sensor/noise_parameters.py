"""Noise parameters in electrons, with their joint covariance, from what was measured in DN."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Bound, Estimate, JointCovariance, number_with_error
from calibration.flags import Flag
from calibration.sensor import propagation as rows
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2, QUANTISATION_VAR_DN2
from calibration.sensor.measured_levels import Measured

FloatArray = NDArray[np.float64]

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
    no_prnu, no_dsnu = _unseen(measured, rows.FLAT_SPATIAL, "prnu"), _unseen(measured, rows.DARK_SPATIAL, "dsnu")
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
    gain, errors = float(measured.values[rows.GAIN]), np.sqrt(np.diag(measured.covariance))
    largest_dn2 = np.maximum(measured.values, 0.0) + _RESOLVED_SIGMA * errors
    dark_dn2 = max(QUANTISATION_LIMIT_DN2, largest_dn2[rows.DARK_VARIANCE] if has_read_noise else 0.0)
    return {
        "read_noise_e": Bound(bound="<", value=float(np.sqrt(dark_dn2)) / gain),
        "prnu": Bound(bound="<", value=float(np.sqrt(largest_dn2[rows.FLAT_SPATIAL])) / measured.signal_dn),
        "dsnu_e": Bound(bound="<", value=float(np.sqrt(largest_dn2[rows.DARK_SPATIAL])) / gain),
    }


def _gradient(derivatives: dict[int, float]) -> FloatArray:
    gradient = np.zeros(rows.N_MEASURED)
    gradient[list(derivatives)] = list(derivatives.values())
    return gradient


def _gain(measured: Measured) -> _Parameter:
    return _Parameter(
        name="gain_dn_per_e",
        value=float(measured.values[rows.GAIN]),
        gradient=_gradient({rows.GAIN: 1.0}),
        n=measured.n_gain,
    )


def _read_noise(measured: Measured) -> _Parameter:
    gain, variance = measured.values[rows.GAIN], measured.values[rows.DARK_VARIANCE] - QUANTISATION_VAR_DN2
    value = float(np.sqrt(variance) / gain)
    return _Parameter(
        name="read_noise_e",
        value=value,
        gradient=_gradient({rows.GAIN: -value / gain, rows.DARK_VARIANCE: 0.5 * value / variance}),
        n=measured.n_dark,
    )


def _dark_current(measured: Measured) -> _Parameter:
    gain = measured.values[rows.GAIN]
    value = float(measured.values[rows.DARK_SLOPE] / gain)
    return _Parameter(
        name="dark_current_e_per_s",
        value=value,
        gradient=_gradient({rows.GAIN: -value / gain, rows.DARK_SLOPE: 1.0 / gain}),
        n=measured.n_dark,
    )


def _black_level(measured: Measured) -> _Parameter:
    return _Parameter(
        name="black_level_dn",
        value=float(measured.values[rows.BLACK_LEVEL]),
        gradient=_gradient({rows.BLACK_LEVEL: 1.0}),
        n=measured.n_dark,
    )


def _prnu(measured: Measured) -> _Parameter:
    variance, slope = measured.values[rows.FLAT_SPATIAL], measured.values[rows.RESPONSE_SLOPE]
    value = float(np.sqrt(variance) / slope) / measured.signal_dn
    return _Parameter(
        name="prnu",
        value=value,
        gradient=_gradient({rows.FLAT_SPATIAL: 0.5 * value / variance, rows.RESPONSE_SLOPE: -value / slope}),
        n=measured.n_flat_pattern,
    )


def _dsnu(measured: Measured) -> _Parameter:
    gain, variance = measured.values[rows.GAIN], measured.values[rows.DARK_SPATIAL]
    value = float(np.sqrt(variance) / gain)
    return _Parameter(
        name="dsnu_e",
        value=value,
        gradient=_gradient({rows.GAIN: -value / gain, rows.DARK_SPATIAL: 0.5 * value / variance}),
        n=measured.n_dark_pattern,
    )


def _unseen(measured: Measured, row: int, name: str) -> Flag | None:
    """Return a flag if a fixed pattern is lost in noise."""
    variance, error = float(measured.values[row]), float(np.sqrt(measured.covariance[row, row]))
    if variance > _RESOLVED_SIGMA * error:
        return None
    bound_dn = np.sqrt(max(variance, 0.0) + _RESOLVED_SIGMA * error)
    size = (
        f"{bound_dn / measured.signal_dn:.2%}" if name == "prnu" else f"{bound_dn / measured.values[rows.GAIN]:.3g} e-"
    )
    return Flag(
        name=f"{name}_not_resolved",
        message=f"the variance from pixel to pixel is "
        f"{number_with_error(variance, error)} DN^2 once temporal noise is taken "
        f"off, not more than {_RESOLVED_SIGMA:.0f} standard errors above 0: the {name.upper()} is below {size}; take "
        f"a stack of 16 frames or more at one level to measure it",
    )


def _unseen_read_noise(measured: Measured) -> Flag | None:
    """Return a flag if the read noise is lost in what dark current adds, or in rounding."""
    variance = float(measured.values[rows.DARK_VARIANCE])
    error = float(np.sqrt(measured.covariance[rows.DARK_VARIANCE, rows.DARK_VARIANCE]))
    if variance - QUANTISATION_VAR_DN2 > _RESOLVED_SIGMA * error and variance > QUANTISATION_LIMIT_DN2:
        return None
    bound_e = np.sqrt(max(variance, QUANTISATION_LIMIT_DN2) + _RESOLVED_SIGMA * error) / measured.values[rows.GAIN]
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
        float(measured.values[rows.DARK_SLOPE]),
        float(np.sqrt(measured.covariance[rows.DARK_SLOPE, rows.DARK_SLOPE])),
    )
    if abs(slope) > _RESOLVED_SIGMA * error:
        return None
    bound_e_per_s = (max(slope, 0.0) + _RESOLVED_SIGMA * error) / measured.values[rows.GAIN]
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
