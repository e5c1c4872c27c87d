"""Noise parameters of a sensor from dark and flat levels, with their joint covariance.

The way from levels to parameters has four steps:

1. Frames that make every number wrong are refused, and inconsistent dark levels are left out. 2. Curves are fitted in
DN: mean and variance of the darks against exposure, the photon-transfer curve of the flats. 3. Seven numbers in DN are
read off these curves and the fixed pattern, with their joint covariance from the sampling
   errors of the levels (`_measure`).
4. Gain, read noise, dark current, black level, PRNU and DSNU follow from them, and the covariance to first order
   (`_parameters`).

The fixed pattern pixel by pixel (`with_pattern`) shows whether light reached the dark frames: light in a dark stack has
the pattern of the pixels' response to light, dark current has a pattern of its own.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Bound, Estimate, JointCovariance, number_with_error
from calibration.results import CalibrationError, Flag, RefusedFramesError, by_consequence, refused
from calibration.sensor.curves import (
    QUANTISATION_LIMIT_DN2,
    RANGE_OF_SATURATION,
    DarkSignal,
    LightStability,
    PhotonTransfer,
    fit_dark_signal,
    match_darks,
    response_slope,
    sample_ceiling_dn,
    stated_dark_signal,
)
from calibration.sensor.emva1288 import EMVA_SYMBOLS, EmvaFigure, emva1288_figures
from calibration.sensor.findings import (
    StatedExposures,
    absurd_dark_current,
    curve_flags,
    frame_flags,
    gain_doubts,
    parameter_flags,
)
from calibration.sensor.judging import LevelInfluence, is_lamp_sweep, judged_curve, sound_darks
from calibration.sensor.levels import (
    LevelStatistics,
    column,
    pattern_variances,
    small_scale_freedom,
    some_pixels,
)
from calibration.sensor.pattern import FixedPattern, left_out_flags, pattern_flags
from model.counts import ROUNDING_VAR_DN2, hit_limit, least_variance, spread_error_rms

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
Mask = NDArray[np.bool_]

_ANYWHERE = StatedExposures()
_DARK_CURRENT = "dark_current_e_per_s"
_STANDARD_DARK_CURRENTS = ("dark_current_mean_e_per_s", "dark_current_variance_e_per_s")
# Rows of the seven numbers in DN; the last is independent of the others.
_GAIN, _DARK_VARIANCE, _FLAT_SPATIAL, _DARK_SPATIAL, _BLACK_LEVEL, _DARK_SLOPE, _RESPONSE_SLOPE = range(7)
# Significance of a resolved number, and of light in darks.
_RESOLVED_SIGMA, _LIGHT_SIGMA = 3.0, 5.0
# Dark current that rarely matters [e-/s].
_SMALL_E_PER_S = 3.0
# A larger dark current may be light; below, light and dark current of pixels with unequal gains are equally likely.
_USUAL_DARK_E_PER_S = 1000.0
# Side of the local mean subtracted from pictures [pixel], and the remaining variance of white noise.
_WINDOW = 15
_LOCAL_SHARE = 1.0 - 1.0 / _WINDOW**2
# Deviation beyond which pixels are left out; least number of pixels; light in darks over that of the flat.
_LEAST_PIXELS, _LEAST_LIGHT = 1000, 1e-4
_BLOCK_PIXELS = 1 << 18
# Flags that are meaningless without a dark current.
_OF_DARK_CURRENT = ("dark_current_not_resolved", "unusual_dark_current")


@dataclass(frozen=True, kw_only=True)
class Performance:
    """Figures of merit; None where the frames do not determine one."""

    threshold_e: Estimate | None = None  #: absolute sensitivity threshold: electrons at which the temporal SNR is 1
    dynamic_range: Estimate | None = None  #: saturation over that threshold
    snr_max: Estimate | None = None  #: temporal SNR of a pixel at saturation, square root of its electrons
    dark_current_variance_e_per_s: Estimate | None = None  #: dark current from the growth of the dark variance [e-/s]
    dark_current_disagreement: float | None = None  #: from mean less from variance, in standard errors
    #: electrons per stated photon; its error does not include that of the photons
    quantum_efficiency: Estimate | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseCalibration:
    """A sensor's noise parameters; None where the frames do not determine one, with a flag that explains it."""

    gain_dn_per_e: Estimate  #: conversion gain K of EMVA 1288 [DN/e-]
    read_noise_e: Estimate | None = None  #: temporal noise of a dark pixel at no exposure, rounding removed [e-]
    dark_current_e_per_s: Estimate | None = None  #: growth of the dark mean [e-/s]; may be below 0 by its error
    black_level_dn: Estimate  #: dark mean at no exposure [DN]
    saturation_e: Estimate | None = None  #: signal of largest temporal variance [e-]
    prnu: Estimate | None = None  #: relative standard deviation of the pixels' response, without smooth structure
    dsnu_e: Estimate | None = None  #: standard deviation of the dark signal from pixel to pixel [e-]
    covariance: JointCovariance  #: of the errors of all existing numbers except the saturation
    flags: tuple[Flag, ...]  #: none refuses, since a refused set has no calibration
    bounds: dict[str, Bound]  #: bounds of numbers that are None, where the frames give one
    performance: Performance
    transfer: PhotonTransfer
    dark: DarkSignal  #: lines through the dark levels
    flats: tuple[LevelStatistics, ...]  #: by ascending mean
    darks: tuple[LevelStatistics, ...]  #: the consistent ones; none if the black level was stated
    #: indices in `flats` and `darks` of the levels of the fixed pattern; None without darks
    spatial: tuple[int, int] | None = None
    emva1288: dict[str, EmvaFigure | None]  #: under the names of `calibration.sensor.emva1288.EMVA_SYMBOLS`
    influence: tuple[LevelInfluence, ...]  #: each flat compared with all others, in the order of `flats`
    light_stability: LightStability  #: stability of the light from frame to frame
    pattern: FixedPattern | None = None  #: the fixed pattern pixel by pixel, see `with_pattern`

    @property
    def stacks(self) -> tuple[LevelStatistics, LevelStatistics] | None:
        """Flat and dark level from which the fixed pattern is taken; None without darks."""
        return None if self.spatial is None else (self.flats[self.spatial[0]], self.darks[self.spatial[1]])


def calibrate_noise(
    levels: Sequence[LevelStatistics],
    *,
    bit_depth: int,
    stated: StatedExposures = _ANYWHERE,
    black_level_dn: Estimate | None = None,
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
    black_level_dn : Estimate or None
        Black level [DN] in place of dark levels, if there are none. The result has gain, linearity and
        saturation; read noise, dark current, PRNU and DSNU are None.

    Raises
    ------
    RefusedFramesError
        The frames have a fault that makes every number wrong, there are no dark or no flat levels, they differ in size,
        or no flat can be used; see its flags.
    CalibrationError
        The bit depth is not 1 to 16, or there are dark levels and a black level.

    Notes
    -----
    Standard errors include sampling and any extra scatter of the points. They are to first order: accurate to a few per
    cent for relative errors below 10 %.

    PRNU and DSNU are those of a population from which this sensor's pixels are drawn, from the levels with the most
    frames and the flat among them nearest to half of saturation. Smooth structure across the picture is subtracted from
    the PRNU: uneven light and shading of a lens cannot be distinguished from a sensor's own.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6 to 8. Different from it: the response of the sensor, weights,
    bend of the curve, several exposures for the read noise, standard errors. `NoiseCalibration.emva1288` has its own.
    """
    flats, all_darks = _sorted_levels(levels, bit_depth, black_level_dn)
    flags = frame_flags(levels, bit_depth=bit_depth, black_level_dn=black_level_dn, stated=stated)
    _refuse_if_any(flags)
    darks, dark_flags = sound_darks(all_darks)
    dark = fit_dark_signal(darks) if black_level_dn is None else stated_dark_signal(black_level_dn, flats)
    weights = match_darks(flats, darks)
    ceiling_dn = sample_ceiling_dn(levels, bit_depth=bit_depth)
    transfer, influence, stability, level_flags = judged_curve(flats, darks, dark, weights, ceiling_dn=ceiling_dn)
    wrong = [flat for flat, one in zip(flats, influence, strict=True) if one.cause is not None]
    flags += (*dark_flags, *level_flags, *curve_flags(levels, flats, darks, transfer, dark, wrong=wrong))
    _refuse_if_any(flags)

    saturation_e = _saturation(flats, transfer)
    if black_level_dn is not None:
        gain, covariance, bounds = _gain_of_flats(flats, transfer, black_level_dn)
        return NoiseCalibration(
            gain_dn_per_e=gain,
            black_level_dn=black_level_dn,
            saturation_e=saturation_e,
            covariance=covariance,
            flags=by_consequence(flags),
            bounds=bounds | _saturation_bound(transfer),
            performance=Performance(snr_max=None if saturation_e is None else _root(saturation_e)),
            transfer=transfer,
            dark=dark,
            flats=tuple(flats),
            darks=(),
            emva1288=dict.fromkeys(EMVA_SYMBOLS),
            influence=influence,
            light_stability=stability,
        )
    spatial = _choose_spatial_levels(flats, darks, transfer=transfer, weights=weights)
    measured = _measure(flats, darks, transfer=transfer, dark=dark, weights=weights, spatial=spatial)
    best, covariance, of_parameters = _parameters(measured, dark, darks)
    absurd = absurd_dark_current((*flats, *darks), best.get(_DARK_CURRENT), stated=stated)
    if absurd is not None:
        best, covariance, of_parameters = _parameters(measured, dark, darks, has_dark_current=False)
    merit = _performance(transfer, dark, best, saturation_e)
    standard = emva1288_figures(flats, darks, ceiling_dn=ceiling_dn)
    if absurd is not None:
        # The dark current needs the unit of the exposures.
        merit = replace(merit, dark_current_variance_e_per_s=None, dark_current_disagreement=None)
        standard |= dict.fromkeys(_STANDARD_DARK_CURRENTS)
    flags += (*of_parameters, *left_out_flags(darks[spatial[1]], flats[spatial[0]]))
    flags += () if absurd is None else (absurd,)
    flags += parameter_flags(
        dark_current_e_per_s=best.get(_DARK_CURRENT), quantum_efficiency=merit.quantum_efficiency, stated=stated
    )
    return NoiseCalibration(
        gain_dn_per_e=best["gain_dn_per_e"],
        read_noise_e=best.get("read_noise_e"),
        dark_current_e_per_s=best.get(_DARK_CURRENT),
        black_level_dn=best["black_level_dn"],
        saturation_e=saturation_e,
        prnu=best.get("prnu"),
        dsnu_e=best.get("dsnu_e"),
        covariance=covariance,
        flags=by_consequence(flags),
        bounds=_bounds(measured, best, has_read_noise=dark.variance_fit is not None) | _saturation_bound(transfer),
        performance=merit,
        transfer=transfer,
        dark=dark,
        flats=tuple(flats),
        darks=tuple(darks),
        spatial=spatial,
        emva1288=standard,
        influence=influence,
        light_stability=stability,
    )


def with_pattern(calibration: NoiseCalibration, pattern: FixedPattern | None) -> NoiseCalibration:
    """Return a calibration with its fixed pattern and its findings, without a dark current if darks may contain light.

    Parameters
    ----------
    calibration : NoiseCalibration
        From the levels alone.
    pattern : FixedPattern or None
        Of its two stacks, pixel by pixel; None where there is none.

    Notes
    -----
    A usual dark current is accepted unless the pattern shows light. A larger one is accepted if light would have shown,
    and is otherwise a bound.
    """
    if calibration.stacks is None:
        return calibration
    found = () if pattern is None else pattern_flags(pattern)
    # Single defects are more informative than their variance.
    names = {flag.name for flag in found}
    kept = tuple(flag for flag in calibration.flags if flag.name not in names)
    calibration = replace(calibration, pattern=pattern, flags=by_consequence((*kept, *found)))
    in_darks = None if pattern is None else _light_in_darks(pattern, black_level_dn=calibration.black_level_dn.value)
    excludes_light = False
    if in_darks is not None:
        light, covariance, is_seen, excludes_light = in_darks
        calibration = _with_own_response(calibration, covariance)
        if is_seen:
            return _with_light(calibration, light)
    current = calibration.dark_current_e_per_s
    if current is None or excludes_light:
        return calibration
    if current.value - _LIGHT_SIGMA * current.std_error < _USUAL_DARK_E_PER_S:
        return calibration
    message = (
        f"dark frames gain {number_with_error(current.value, current.std_error)} e-/s, more than cameras usually do "
        f"({_USUAL_DARK_E_PER_S:.0f} e-/s), and the fixed pattern is too uncertain to separate dark current from "
        "light: cover the lens, and take stacks of at least 16 flats and 16 darks at one exposure"
    )
    return _without_dark_current(calibration, Flag(name="dark_current_or_light", message=message), bound=current)


def not_known(calibration: NoiseCalibration) -> dict[str, str]:
    """Return the reason for each missing number, by name."""
    best, merit = calibration, calibration.performance
    if not best.darks:
        return _not_known_without_darks(best)
    names = {flag.name for flag in best.flags}
    found = {
        name: _REASONS[flags[0] if not names.intersection(flags) else next(one for one in flags if one in names)]
        for name, flags in _BY_FLAG.items()
        if getattr(best, name) is None
    }
    if best.prnu is None:
        found["prnu"] = f"temporal noise hides it: {_STACKS}"
    if best.dsnu_e is None:
        found["dsnu_e"] = f"temporal noise or rounding hides it: {_STACKS}, or use longer exposures"
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
            "dark_current_e_per_s", "dark frames have one exposure: take longer ones too"
        )
    return found | _standard(best, found)


def _not_known_without_darks(best: NoiseCalibration) -> dict[str, str]:
    known = {"gain_dn_per_e", "saturation_e", "snr_max", "dark_current_disagreement"}
    found = {name: _NO_DARKS for name in (*_NAMES, *vars(best.performance), *EMVA_SYMBOLS) if name not in known}
    if best.saturation_e is None:
        found |= dict.fromkeys(("saturation_e", "snr_max"), f"the sweep ends below it: {_brighter(best)}")
    return found


def first_lines(calibration: NoiseCalibration) -> tuple[str, str, str]:
    """Return three lines to read first.

    The first states the accuracy of the gain: its standard error, or the largest departure in a flag.
    """
    gain = calibration.gain_dn_per_e
    share = gain.std_error / gain.value
    flagged = {flag.name for flag in calibration.flags}
    levels = (*calibration.flats, *calibration.darks)
    doubts = gain_doubts(levels, calibration.transfer, black_level_dn=calibration.black_level_dn)
    off, words = max((doubts[name] for name in flagged & doubts.keys()), default=(0.0, ""))
    trust = f"Trust the gain to {max(share, off):.{1 if max(share, off) >= 1e-3 else 2}%}"
    # The first line must not be better than the flags.
    trust += f": {words}" if off > share else ""
    named = [flag.level for flag in calibration.flags if flag.level is not None and flag.name != "unclear_level"]
    if named:
        trust += f"; {len(set(named))} level{'s are' if len(set(named)) > 1 else ' is'} listed below as wrong"
    unknown, step = _unknown(calibration), _next(calibration)
    return f"{trust}.", f"{unknown[0].upper()}{unknown[1:]}.", f"{step[0].upper()}{step[1:]}."


def temporal_noise_e(signal_e: FloatArray, *, read_noise_e: float, gain_dn_per_e: float) -> FloatArray:
    """Return the temporal noise of a pixel, rounding included [e-]: electrons of the signal, read noise, 1/12 DN^2.

    EMVA Standard 1288, Release 4.0 Linear, section 2.
    """
    noise: FloatArray = np.sqrt(signal_e + read_noise_e**2 + ROUNDING_VAR_DN2 / gain_dn_per_e**2)
    return noise


def total_noise_e(temporal_e: FloatArray, signal_e: FloatArray, *, prnu: float, dsnu_e: float) -> FloatArray:
    """Return the temporal and spatial noise together [e-]; signal in electrons.

    EMVA Standard 1288, Release 4.0 Linear, section 4.
    """
    noise: FloatArray = np.sqrt(np.square(temporal_e) + dsnu_e**2 + np.square(prnu * signal_e))
    return noise


# Levels and the numbers in DN


def _sorted_levels(
    levels: Sequence[LevelStatistics], bit_depth: int, black_level_dn: Estimate | None
) -> tuple[list[LevelStatistics], list[LevelStatistics]]:
    if bit_depth not in range(1, 17):
        raise CalibrationError(f"bit_depth is {bit_depth}; allowed is 1 to 16")
    flats = sorted((level for level in levels if level.kind == "flat"), key=lambda level: level.mean_dn)
    darks = [level for level in levels if level.kind == "dark"]
    if darks and black_level_dn is not None:
        raise CalibrationError(
            f"there are {len(darks)} dark levels, which determine the black level; do not state "
            f"{black_level_dn.value:g} DN as well"
        )
    if not flats or (not darks and black_level_dn is None):
        raise refused(
            "missing_levels",
            f"there are {len(flats)} flat and {len(darks)} dark levels of at least two frames. One of each is needed, "
            "or flats and a black level (--black-level-dn). Take two flats and two darks at each of 10 exposures",
        )
    shapes = {level.shape for level in levels}
    if len(shapes) > 1:
        raise refused(
            "mixed_size", f"levels differ in size (rows, columns): {sorted(shapes)}; use one region throughout"
        )
    return flats, darks


def _refuse_if_any(flags: tuple[Flag, ...]) -> None:
    if any(flag.refuses for flag in flags):
        raise RefusedFramesError(flags)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Measured:
    """Seven numbers in DN; missing ones are 0 without covariance."""

    values: FloatArray
    covariance: FloatArray
    signal_dn: float  #: of the flat of the fixed pattern
    n_gain: int  #: frames behind the gain
    n_dark: int
    n_flat_pattern: int
    n_dark_pattern: int


def _choose_spatial_levels(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    *,
    transfer: PhotonTransfer,
    weights: FloatArray,
) -> tuple[int, int]:
    """Return the flat and the dark with the most frames: the flat nearest to the middle, and its own dark."""
    signal = transfer.points.signal_dn
    middle_dn = float(signal[transfer.used].max()) / (2.0 * RANGE_OF_SATURATION)
    flat = max(
        np.flatnonzero(transfer.used).tolist(),
        key=lambda index: (flats[index].n_frames, -abs(signal[index] - middle_dn)),
    )
    return flat, max(range(len(darks)), key=lambda index: (darks[index].n_frames, weights[flat, index]))


def _measure(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    *,
    transfer: PhotonTransfer,
    dark: DarkSignal,
    weights: FloatArray,
    spatial: tuple[int, int],
) -> _Measured:
    """Return the numbers in DN from the curves and the levels of the fixed pattern."""
    flat, stack, of_flat = flats[spatial[0]], darks[spatial[1]], weights[spatial[0]]
    signal_dn = float(transfer.points.signal_dn[spatial[0]])
    # Smooth patterns come from light and lens, not from the sensor.
    dark_small = np.array([level.ordinary.small_scale_variance_dn2 for level in darks])
    hidden_dn2 = _hidden_defects_dn2(flat, darks, of_flat)
    slope, slope_error = response_slope(transfer, signal_dn)
    values, covariance = np.zeros(7), np.zeros((7, 7))
    values[_GAIN] = transfer.gain_dn_per_e
    values[_DARK_VARIANCE] = 0.0 if dark.variance_fit is None else dark.variance_fit.parameters[0]
    values[_FLAT_SPATIAL] = flat.ordinary.small_scale_variance_dn2 - of_flat @ dark_small - 0.5 * hidden_dn2
    values[_DARK_SPATIAL] = stack.ordinary.variance_dn2
    values[_BLACK_LEVEL] = dark.mean_fit.parameters[0]
    values[_DARK_SLOPE] = dark.mean_fit.parameters[1] if dark.has_slope else 0.0
    values[_RESPONSE_SLOPE] = slope
    covariance[:_RESPONSE_SLOPE, :_RESPONSE_SLOPE] = _measured_covariance(
        flats, darks, transfer=transfer, dark=dark, weights=weights, spatial=spatial
    )
    covariance[_FLAT_SPATIAL, _FLAT_SPATIAL] += (0.5 * hidden_dn2) ** 2
    covariance[_RESPONSE_SLOPE, _RESPONSE_SLOPE] = slope_error**2
    matched = np.greater(weights[transfer.used].sum(axis=0), 0.0)
    return _Measured(
        values=values,
        covariance=covariance,
        signal_dn=signal_dn,
        n_gain=_frames(flats, transfer.used) + _frames(darks, matched),
        n_dark=sum(level.n_frames for level in darks),
        n_flat_pattern=flat.n_frames + _frames(darks, np.greater(of_flat, 0.0)),
        n_dark_pattern=stack.n_frames,
    )


def _hidden_defects_dn2(flat: LevelStatistics, darks: Sequence[LevelStatistics], weights: FloatArray) -> float:
    """Return the variance that pixels defective in the dark may add to the others in the light [DN^2].

    A hot pixel that stands out in the dark may not stand out in the light; half of its effect is subtracted, and half
    is the error.
    """
    all_dn2 = column(darks, "small_scale_variance_dn2")
    ordinary_dn2 = np.array([level.ordinary.small_scale_variance_dn2 for level in darks])
    left_out = np.array([float(level.ordinary.left_out) for level in darks])
    # The largest also stand out in the light and are left out there.
    hidden = np.maximum(left_out - flat.ordinary.left_out, 0.0) / np.maximum(left_out, 1.0)
    return float(weights @ (hidden * np.maximum(all_dn2 - ordinary_dn2, 0.0)))


def _frames(levels: Sequence[LevelStatistics], chosen: Mask) -> int:
    return sum(level.n_frames for level, take in zip(levels, chosen, strict=True) if take)


def _measured_covariance(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    *,
    transfer: PhotonTransfer,
    dark: DarkSignal,
    weights: FloatArray,
    spatial: tuple[int, int],
) -> FloatArray:
    """Return the (6, 6) covariance of the numbers in DN except the last; zeros for missing ones.

    To first order in the errors. Each number is linear in variances and means of the levels. A level's mean is taken as
    independent of its variances, which holds for noise without skewness. The error of a flat's mean is neglected; it is
    smaller than that of its variance by the square root of gain over signal. The black level is that of the population
    of pixels, so its error includes the sampling of the fixed pattern.
    """
    n_flat, n_dark = weights.shape
    # Derivatives with respect to flat and dark temporal variances, then flat and dark spatial variances.
    response = np.zeros((4, 2 * (n_flat + n_dark)))
    temporal, pattern = response[:, : n_flat + n_dark], response[:, n_flat + n_dark :]
    temporal[_GAIN, :n_flat][transfer.used] = transfer.gain_response
    temporal[_GAIN, n_flat:] = -temporal[_GAIN, :n_flat] @ weights
    if dark.variance_fit is not None:
        temporal[_DARK_VARIANCE, n_flat:] = dark.variance_fit.response[0]
    pattern[_FLAT_SPATIAL, spatial[0]] = 1.0
    pattern[_FLAT_SPATIAL, n_flat:] = -weights[spatial[0]]
    pattern[_DARK_SPATIAL, n_flat + spatial[1]] = 1.0
    covariance = np.zeros((6, 6))
    covariance[:4, :4] = response @ _statistics_covariance(flats, darks, transfer, dark) @ response.T
    covariance[_GAIN, _GAIN] += transfer.gain_variance_beyond_sampling
    # The fixed pattern with light is the variance within blocks, which have fewer degrees of freedom.
    covariance[_FLAT_SPATIAL, _FLAT_SPATIAL] /= small_scale_freedom(flats[spatial[0]].shape)
    size = 2 if dark.has_slope else 1
    covariance[4 : 4 + size, 4 : 4 + size] = dark.mean_fit.covariance[:size, :size]
    if dark.quantisation_limited:
        covariance[_DARK_SPATIAL, _DARK_SPATIAL] += ROUNDING_VAR_DN2**2
    if dark.is_curved and dark.variance_fit is not None:
        # The variance at zero exposure belongs to the mean at zero exposure.
        by_mean = dark.variance_fit.parameters[1] ** 2 * dark.mean_fit.covariance[0, 0]
        covariance[_DARK_VARIANCE, _DARK_VARIANCE] += by_mean
    stack = darks[spatial[1]]
    covariance[_BLACK_LEVEL, _BLACK_LEVEL] += max(stack.spatial_variance_dn2, 0.0) / stack.n_pixels
    return covariance


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
    # Small noise leaves a rounding error in spatial variances.
    noise, pattern = column(levels, "temporal_variance_dn2"), pattern_variances(levels)
    rounding_dn4 = np.square(spread_error_rms(least_variance(noise, pattern), pattern))
    spatial = np.diag(np.square([level.ordinary.std_error_dn2 for level in levels]) + rounding_dn4)
    cross = np.diag([level.ordinary.temporal_cov_dn4 for level in levels])
    return np.block([[temporal, cross], [cross, spatial]])


def _gain_of_flats(
    flats: Sequence[LevelStatistics], transfer: PhotonTransfer, black_level_dn: Estimate
) -> tuple[Estimate, JointCovariance, dict[str, Bound]]:
    """Return the gain of flats without darks, its covariance with the black level, and the bound of the PRNU."""
    points, used = transfer.points, transfer.used
    sampling = np.diag(np.square(points.flat_std_error_dn2[used])) + points.dark_covariance_dn4[np.ix_(used, used)]
    response = transfer.gain_response
    variance = float(response @ sampling @ response) + transfer.gain_variance_beyond_sampling
    shared, of_black = transfer.gain_by_black * black_level_dn.std_error**2, black_level_dn.std_error**2
    brightest = int(np.flatnonzero(used)[-1])
    pattern, signal_dn = flats[brightest].ordinary, float(points.signal_dn[brightest])
    largest_dn2 = max(pattern.small_scale_variance_dn2, 0.0) + _RESOLVED_SIGMA * pattern.std_error_dn2
    slope, slope_error = response_slope(transfer, signal_dn)
    least_dn = signal_dn * max(slope - _RESOLVED_SIGMA * slope_error, 0.5)
    return (
        Estimate(value=transfer.gain_dn_per_e, std_error=float(np.sqrt(variance)), n=_frames(flats, used)),
        JointCovariance(
            names=("gain_dn_per_e", "black_level_dn"), matrix=np.array([[variance, shared], [shared, of_black]])
        ),
        {"prnu": Bound(bound="<", value=float(np.sqrt(largest_dn2)) / least_dn)},
    )


# Parameters in electrons


def _parameters(
    measured: _Measured, dark: DarkSignal, darks: Sequence[LevelStatistics], *, has_dark_current: bool = True
) -> tuple[dict[str, Estimate], JointCovariance, tuple[Flag, ...]]:
    """Return the resolved parameters, the covariance of their errors, and flags for the others."""
    has_read_noise, has_dark_current = dark.variance_fit is not None, has_dark_current and dark.has_slope
    no_read_noise = _unresolved_read_noise(measured) if has_read_noise else None
    no_prnu = _unresolved_pattern(measured, _FLAT_SPATIAL, "prnu")
    no_dsnu = _unresolved_pattern(measured, _DARK_SPATIAL, "dsnu")
    gain, dark_variance, flat_spatial, dark_spatial, black_level, dark_slope, response = measured.values.tolist()
    # Name: value, derivatives with respect to the measured numbers, frames.
    found: dict[str, tuple[float, dict[int, float], int]] = {"gain_dn_per_e": (gain, {_GAIN: 1.0}, measured.n_gain)}
    if has_read_noise and no_read_noise is None:
        variance = dark_variance - ROUNDING_VAR_DN2
        noise = float(np.sqrt(variance)) / gain
        by = {_GAIN: -noise / gain, _DARK_VARIANCE: 0.5 * noise / variance}
        found["read_noise_e"] = noise, by, measured.n_dark
    if has_dark_current:
        current = dark_slope / gain
        found[_DARK_CURRENT] = current, {_GAIN: -current / gain, _DARK_SLOPE: 1.0 / gain}, measured.n_dark
    found["black_level_dn"] = black_level, {_BLACK_LEVEL: 1.0}, measured.n_dark
    if no_prnu is None:
        prnu = float(np.sqrt(flat_spatial)) / response / measured.signal_dn
        by = {_FLAT_SPATIAL: 0.5 * prnu / flat_spatial, _RESPONSE_SLOPE: -prnu / response}
        found["prnu"] = prnu, by, measured.n_flat_pattern
    if no_dsnu is None:
        dsnu = float(np.sqrt(dark_spatial)) / gain
        by = {_GAIN: -dsnu / gain, _DARK_SPATIAL: 0.5 * dsnu / dark_spatial}
        found["dsnu_e"] = dsnu, by, measured.n_dark_pattern
    gradients = np.zeros((len(found), len(measured.values)))
    for row, (_, by, _) in enumerate(found.values()):
        gradients[row, list(by)] = list(by.values())
    matrix = gradients @ measured.covariance @ gradients.T
    errors = np.sqrt(np.diag(matrix)).tolist()
    estimates = {
        name: Estimate(value=value, std_error=error, n=n)
        for (name, (value, _, n)), error in zip(found.items(), errors, strict=True)
    }
    small = _unresolved_dark_current(measured, darks) if has_dark_current else None
    flags = tuple(flag for flag in (no_read_noise, no_prnu, no_dsnu, small) if flag is not None)
    return estimates, JointCovariance(names=tuple(found), matrix=matrix), flags


def _bounds(measured: _Measured, best: Collection[str], *, has_read_noise: bool) -> dict[str, Bound]:
    """Return upper bounds of read noise and fixed pattern where these are not resolved."""
    gain, errors = float(measured.values[_GAIN]), np.sqrt(np.diag(measured.covariance))
    largest_dn2 = np.maximum(measured.values, 0.0) + _RESOLVED_SIGMA * errors
    dark_dn2 = max(QUANTISATION_LIMIT_DN2, largest_dn2[_DARK_VARIANCE] if has_read_noise else 0.0)
    bounds = {
        "read_noise_e": Bound(bound="<", value=float(np.sqrt(dark_dn2)) / gain),
        "prnu": Bound(bound="<", value=float(np.sqrt(largest_dn2[_FLAT_SPATIAL])) / measured.signal_dn),
        "dsnu_e": Bound(bound="<", value=float(np.sqrt(largest_dn2[_DARK_SPATIAL])) / gain),
    }
    return {name: bound for name, bound in bounds.items() if name not in best}


def _unresolved_pattern(measured: _Measured, row: int, name: str) -> Flag | None:
    """Return a flag if noise hides a fixed pattern."""
    variance, error = float(measured.values[row]), float(np.sqrt(measured.covariance[row, row]))
    if variance > _RESOLVED_SIGMA * error:
        return None
    bound_dn = np.sqrt(max(variance, 0.0) + _RESOLVED_SIGMA * error)
    size = f"{bound_dn / measured.signal_dn:.2%}" if name == "prnu" else f"{bound_dn / measured.values[_GAIN]:.3g} e-"
    return Flag(
        name=f"{name}_not_resolved",
        message=f"without temporal noise the variance from pixel to pixel is {number_with_error(variance, error)} "
        f"DN^2, less than {_RESOLVED_SIGMA:.0f} standard errors above 0: the {name.upper()} is below {size}; take a "
        "stack of at least 16 frames at one level to measure it",
    )


def _unresolved_read_noise(measured: _Measured) -> Flag | None:
    """Return a flag if dark current or rounding hides the read noise."""
    variance = float(measured.values[_DARK_VARIANCE])
    error = float(np.sqrt(measured.covariance[_DARK_VARIANCE, _DARK_VARIANCE]))
    if variance - ROUNDING_VAR_DN2 > _RESOLVED_SIGMA * error and variance > QUANTISATION_LIMIT_DN2:
        return None
    bound_e = np.sqrt(max(variance, QUANTISATION_LIMIT_DN2) + _RESOLVED_SIGMA * error) / measured.values[_GAIN]
    return Flag(
        name="read_noise_not_resolved",
        message=f"the dark variance at zero exposure is {number_with_error(variance, error)} DN^2, which rounding and "
        f"its error explain: the read noise is below {bound_e:.3g} e-; take dark frames at shorter exposures",
    )


def _unresolved_dark_current(measured: _Measured, darks: Sequence[LevelStatistics]) -> Flag | None:
    """Return a flag if the dark current does not differ from 0 significantly."""
    slope, error = (
        float(measured.values[_DARK_SLOPE]),
        float(np.sqrt(measured.covariance[_DARK_SLOPE, _DARK_SLOPE])),
    )
    if abs(slope) > _RESOLVED_SIGMA * error:
        return None
    bound_e_per_s = (max(slope, 0.0) + _RESOLVED_SIGMA * error) / measured.values[_GAIN]
    advice = _longer(bound_e_per_s, _longest_s(darks))
    return Flag(
        name="dark_current_not_resolved",
        message=f"the dark mean grows by {number_with_error(slope, error)} DN/s, less than {_RESOLVED_SIGMA:.0f} "
        f"standard errors from 0: the dark current is below {bound_e_per_s:.3g} e-/s; {advice}",
    )


def _longer(bound_e_per_s: float, longest_s: float) -> str:
    """Return advice on dark exposures that would show a usual dark current."""
    if not longest_s:
        return "longer dark exposures measure it"
    wanted_s = float(np.clip(longest_s * bound_e_per_s / _SMALL_E_PER_S, 2.0 * longest_s, max(60.0, 2.0 * longest_s)))
    return f"dark frames of {float(f'{wanted_s:.1g}'):g} s would show more than {_SMALL_E_PER_S:g} e-/s"


def _longest_s(darks: Sequence[LevelStatistics]) -> float:
    """Return the longest known exposure, 0 without any."""
    return max((dark.exposure_s for dark in darks if dark.exposure_s is not None), default=0.0)


def _saturation_bound(transfer: PhotonTransfer) -> dict[str, Bound]:
    """Return the brightest signal as a bound if saturation was not reached."""
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


# Figures of merit


def _performance(
    transfer: PhotonTransfer, dark: DarkSignal, best: Mapping[str, Estimate], saturation_e: Estimate | None
) -> Performance:
    """Return the figures of merit of a sensor.

    Rounding counts as noise. The gain nearly cancels in the dynamic range, so its error is that of the saturation and
    of the dark noise in counts.

    EMVA Standard 1288, Release 4.0 Linear; the threshold here without its approximation.
    """
    gain, read_noise_e = best["gain_dn_per_e"], best.get("read_noise_e")
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


def _threshold(gain: Estimate, read_noise_e: Estimate) -> Estimate:
    variance_e2 = read_noise_e.value**2 + ROUNDING_VAR_DN2 / gain.value**2
    root = float(np.sqrt(0.25 + variance_e2))
    # The error of the read noise already includes that of the gain.
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


# Reasons for missing numbers, and the first lines of a report


_STACKS = "take a stack of 16 frames or more at half of saturation, and as many dark frames"


_NO_DARKS = "there are no dark frames: take two or more at each exposure"


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
    "single_dark_exposure": "dark frames have one exposure: take dark frames of 1 s or more too",
}


def _brighter(best: NoiseCalibration) -> str:
    """Return how flats become brighter in a sweep of this kind."""
    return (
        "continue with a brighter lamp until pixels are full"
        if is_lamp_sweep(best.flats)
        else "continue with longer exposures until pixels are full"
    )


def _no_efficiency(best: NoiseCalibration) -> str:
    if any(flat.photons is None for flat in best.flats):
        return "photons per pixel are not stated: measure the irradiance with a calibrated photodiode"
    return "fewer than 7 levels have known light: take more levels with stated photons"


def _standard(best: NoiseCalibration, found: dict[str, str]) -> dict[str, str]:
    """Return the reasons of the standard's own numbers."""
    missing = [name for name, figure in best.emva1288.items() if figure is None]
    reasons = {}
    for name in missing:
        if name.startswith("linearity"):
            reasons[name] = (
                f"it covers 5 to 95 % of saturation, which was not reached: {_brighter(best)}"
                if best.saturation_e is None
                else "fewer than three levels of known light lie within 5 to 95 % of saturation: take more"
            )
        elif name.startswith(("dsnu", "prnu")):
            reasons[name] = f"temporal noise hides its variance: {_STACKS}"
        elif name.startswith("dark_current"):
            reasons[name] = found.get("dark_current_e_per_s", "dark frames have fewer than three exposures: take more")
        elif name.startswith(("saturation", "dynamic", "snr")) and best.saturation_e is None:
            reasons[name] = found["saturation_e"]
        else:
            reasons[name] = _no_efficiency(best)
    return {name: reason for name, reason in reasons.items() if name not in found}


_NAMES = {
    "read_noise_e": "read noise",
    "dark_current_e_per_s": "dark current",
    "saturation_e": "saturation",
    "prnu": "PRNU",
    "dsnu_e": "DSNU",
}


_NEXT = {
    "no_darks": "take dark frames, two or more at each exposure",
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
    "unclear_level": "take the named level again, with more levels near it",
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


def _unknown(calibration: NoiseCalibration) -> str:
    missing = {name: word for name, word in _NAMES.items() if getattr(calibration, name) is None}
    bounds = [word for name, word in missing.items() if name in calibration.bounds]
    unknown = [word for name, word in missing.items() if name not in calibration.bounds]
    found = []
    if bounds:
        found.append(f"{_listed(bounds)} {'is a bound' if len(bounds) == 1 else 'are bounds'}")
    if unknown:
        known = "known" if calibration.darks else "determined"
        found.append(f"{_listed(unknown)} {'is' if len(unknown) == 1 else 'are'} not {known}")
    return "; ".join(found) or "all numbers that the model needs are known"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _next(calibration: NoiseCalibration) -> str:
    for flag in calibration.flags:
        if flag.name == "saturation_not_reached":
            more = "a brighter lamp" if is_lamp_sweep(calibration.flats) else "longer exposures"
            return f"next: continue with {more} until pixels are full"
        if flag.name in _NEXT:
            return f"next: {_NEXT[flag.name]}"
    return "no frames have to be taken again"


# Light in dark frames, from the fixed pattern


def _light_in_darks(pattern: FixedPattern, *, black_level_dn: float) -> tuple[Estimate, Estimate, bool, bool] | None:
    """Return the light in a dark stack [DN], the covariance of dark signal and response, and two verdicts.

    The verdicts state if light is found, and if it is excluded. None if the response has no pattern.

    Dark current has its own pattern, light that of the response (PRNU), and so has dark current if pixels differ in
    gain. With r the relative response, d the dark mean less its local mean, cov(d, r) = light var(r) - noise / signal,
    where the noise of the dark mean enters r by the subtracted dark.

    The noise of the pixels shows which share of the response is gain, since photon variance is proportional to the
    square of the gain and to the light. If this share of the dark signal explains all, there is no sign of light.
    """
    if float(np.median(pattern.dark.temporal_variance_dn2)) < QUANTISATION_LIMIT_DN2:
        # Pixel offsets hidden by rounding stay in the flat and look like response.
        return None
    relative = pattern.flat.mean_dn - pattern.dark.mean_dn
    relative /= np.float32(pattern.signal_dn)
    dark, response = _local(pattern.dark.mean_dn), _local(relative)
    del relative
    noise_dn2 = float(np.mean(pattern.dark.temporal_variance_dn2)) / pattern.n_dark_frames
    flat_noise_dn2 = float(np.mean(pattern.flat.temporal_variance_dn2)) / pattern.n_flat_frames
    kept = (np.abs(dark) < hit_limit(some_pixels(dark))) & (np.abs(response) < hit_limit(some_pixels(response)))
    if np.count_nonzero(kept) < _LEAST_PIXELS:
        return None
    d, r = dark[kept], response[kept]
    del dark, response
    _, (d_variance, r_variance), d_with_r = _pair_moments(d, r)
    of_response = r_variance - _LOCAL_SHARE * (noise_dn2 + flat_noise_dn2) / pattern.signal_dn**2
    if of_response <= 0.0:
        return None
    together = d_with_r + _LOCAL_SHARE * noise_dn2 / pattern.signal_dn
    of_chance = float(np.sqrt(d_variance * r_variance / d.size))
    light_dn, error_dn = together / of_response, of_chance / of_response
    dark_dn = max(float(pattern.dark.mean_dn[kept].mean()) - black_level_dn, 0.0)
    del d
    share, share_error = _gain_share(pattern, r, kept, of_response=of_response)
    is_of_gain = share > _RESOLVED_SIGMA * share_error and light_dn - share * dark_dn < (
        _RESOLVED_SIGMA * float(np.hypot(error_dn, share_error * dark_dn))
    )
    is_there = light_dn > _LIGHT_SIGMA * error_dn and light_dn > _LEAST_LIGHT * pattern.signal_dn
    n, signal_dn = pattern.n_dark_frames, pattern.signal_dn
    return (
        Estimate(value=light_dn, std_error=error_dn, n=n),
        Estimate(value=together / signal_dn, std_error=of_chance / signal_dn, n=n),
        is_there and not is_of_gain,
        light_dn < _RESOLVED_SIGMA * error_dn and dark_dn - light_dn > _LIGHT_SIGMA * error_dn,
    )


def _gain_share(pattern: FixedPattern, response: SingleArray, kept: Mask, *, of_response: float) -> tuple[float, float]:
    """Return the share of the differences in response due to gain, and its error.

    Photon variance grows with the first power of the light that a pixel collects, and with the square of its gain.
    """
    variance = (pattern.flat.temporal_variance_dn2 - pattern.dark.temporal_variance_dn2)[kept]
    (mean, _), (of_variance, variance_of_response), together = _pair_moments(variance, response)
    slope = together / mean / of_response
    error = float(np.sqrt(of_variance * variance_of_response / response.size)) / abs(mean) / of_response
    return slope - 1.0, error


def _pair_moments(one: SingleArray, other: SingleArray) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return means, variances and covariance of two rows of pixels in double precision, a block at a time."""
    means = float(one.mean(dtype=np.float64)), float(other.mean(dtype=np.float64))
    sums = np.zeros(3)
    for start in range(0, one.size, _BLOCK_PIXELS):
        a = one[start : start + _BLOCK_PIXELS].astype(np.float64) - means[0]
        b = other[start : start + _BLOCK_PIXELS].astype(np.float64) - means[1]
        sums += (a @ a, b @ b, a @ b)
    first, second, together = (sums / one.size).tolist()
    return means, (first, second), together


def _local(picture: SingleArray) -> SingleArray:
    """Return a picture less its local mean, without rows and columns."""
    local: SingleArray = np.asarray(cv2.blur(picture, (_WINDOW, _WINDOW)), np.float32)
    np.subtract(picture, local, out=local)
    local -= np.median(local, axis=0, keepdims=True)
    local -= np.median(local, axis=1, keepdims=True)
    return local


def _with_own_response(calibration: NoiseCalibration, covariance: Estimate) -> NoiseCalibration:
    """Return a calibration with the PRNU of light alone, if dark signal and response are correlated.

    The variance of a flat less that of its dark includes twice their covariance, which pixels of unequal gain cause.
    """
    prnu, stacks = calibration.prnu, calibration.stacks
    if prnu is None or stacks is None or abs(covariance.value) < _RESOLVED_SIGMA * covariance.std_error:
        return calibration
    # The dark signal within the flat over that within the dark stack.
    share, (flat_s, dark_s) = 1.0, (level.exposure_s for level in stacks)
    if flat_s is not None and dark_s is not None and calibration.dark.has_slope:
        of_flat, of_dark = calibration.dark.mean_at(np.array([flat_s, dark_s])) - calibration.black_level_dn.value
        share = float(of_flat / of_dark) if of_dark > 0.0 and of_flat > 0.0 else 1.0
    square = prnu.value**2 - 2.0 * share * covariance.value
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
    """Return a calibration whose dark current may include light: uncertain, or a bound if it is unusually large."""
    message = (
        f"dark frames show the pattern of the response to light, of {number_with_error(light.value, light.std_error)} "
        f"DN (more than {_LIGHT_SIGMA:.0f} standard errors): light got in, or pixels differ in gain; the dark current "
        "cannot be separated from it: cover the lens, and take the dark frames again"
    )
    flag, current, stacks = (
        Flag(name="light_in_darks", message=message),
        calibration.dark_current_e_per_s,
        calibration.stacks,
    )
    flagged = replace(calibration, flags=by_consequence((*calibration.flags, flag)))
    if current is None or stacks is None or not stacks[1].exposure_s:
        return flagged
    rate_e_per_s = light.value / calibration.gain_dn_per_e.value / stacks[1].exposure_s
    if rate_e_per_s >= _USUAL_DARK_E_PER_S:
        return _without_dark_current(calibration, flag, bound=current)
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
    largest = max(bound.value, 0.0) + _RESOLVED_SIGMA * bound.std_error
    of_current = {one.name: one for one in calibration.flags if one.name in _OF_DARK_CURRENT}
    flags = tuple(one for one in calibration.flags if one.name not in of_current)
    if (unusual := of_current.get("unusual_dark_current")) is not None:
        flag = replace(flag, message=f"{flag.message}; without light, {unusual.message}")
    return replace(
        calibration,
        dark_current_e_per_s=None,
        bounds=calibration.bounds | {_DARK_CURRENT: Bound(bound="<", value=largest)},
        covariance=JointCovariance(names=tuple(names[index] for index in kept), matrix=matrix[np.ix_(kept, kept)]),
        flags=by_consequence((*flags, flag)),
    )
