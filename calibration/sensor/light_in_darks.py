"""Light in dark frames: whether the fixed pattern shows it, and what a calibration may then say of its dark current."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Bound, Estimate, JointCovariance, number_with_error
from calibration.flag_order import by_consequence
from calibration.flags import Flag
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2
from calibration.sensor.fixed_pattern import FixedPattern
from calibration.sensor.noise import NoiseCalibration
from calibration.sensor.pattern_checks import pattern_flags

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
    """Light in a dark stack by the pattern of the response to light in it.

    Attributes
    ----------
    light : Estimate
        Light that would make as much of the pattern [DN].
    covariance : Estimate
        Of what pixels differ by in the dark and in their response, over the signal: of the unit of a squared PRNU.
    is_seen : bool
        It is no chance, and not what pixels with unlike gains make of dark current.
    excludes_light : bool
        There is no sign of any, and light that makes all of the dark signal would be seen.
    """

    light: Estimate
    covariance: Estimate
    is_seen: bool
    excludes_light: bool


def dark_light(pattern: FixedPattern, *, black_level_dn: float) -> DarkLight | None:
    """Return the light in a dark stack, None where the response has no pattern to know it by.

    Parameters
    ----------
    pattern : FixedPattern
        Of a dark and a flat stack.
    black_level_dn : float
        Dark mean at no exposure [DN].

    Notes
    -----
    Dark current has its own pattern from pixel to pixel, light has that of the response (PRNU), and so has dark current
    where each pixel has a gain of its own. With r the relative response, d the dark mean less its local mean,
    cov(d, r) = light var(r) - noise / signal, where the noise of the dark mean enters r by the dark that was taken off.

    Which share of the response is gain the noise of the pixels tells: the variance of photons goes with the gain's
    square, and with the light. Where that share of the dark signal is all that is seen, there is no sign of light.
    """
    dark, response = (_local(one) for one in (pattern.dark.mean_dn, _response(pattern)))
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


def _response(pattern: FixedPattern) -> SingleArray:
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
