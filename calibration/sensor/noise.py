"""A sensor's noise parameters from dark and flat levels, each with what it is uncertain by."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.errors import CalibrationError, RefusedFramesError, refused
from calibration.estimate import Bound, Estimate, JointCovariance
from calibration.flag_order import by_consequence
from calibration.flags import Flag
from calibration.sensor.ceiling import sample_ceiling_dn
from calibration.sensor.curve_checks import curve_flags
from calibration.sensor.dark_signal import DarkMatch, DarkSignal, fit_dark_signal, match_darks
from calibration.sensor.emva1288 import EmvaFigure, emva1288_figures
from calibration.sensor.exposure_unit import (
    StatedExposures,
    implausible_unit,
    impossible_exposures,
    is_absurd,
    unusual_dark_current,
)
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.judged_curve import JudgedCurve, judged_curve, sound_darks
from calibration.sensor.level_checks import level_flags, light_course_flags
from calibration.sensor.level_verdicts import LevelInfluence
from calibration.sensor.light_stability import LightStability
from calibration.sensor.measured_levels import Measured, choose_spatial_levels, measure
from calibration.sensor.noise_parameters import NoiseParameters, noise_parameters
from calibration.sensor.parameter_checks import parameter_flags
from calibration.sensor.pattern_checks import left_out_flags
from calibration.sensor.performance import Performance, performance
from calibration.sensor.photon_transfer import PhotonTransfer
from calibration.sensor.propagation import SpatialLevels
from calibration.sensor.row_column_checks import row_column_flags
from calibration.sensor.sample_checks import sample_flags

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
    flags = (*sample_flags(levels, bit_depth=bit_depth), *level_flags(levels), *row_column_flags(levels))
    flags += impossible_exposures(levels, stated=stated)
    _refuse_if_any(flags)
    darks, dark_flags = sound_darks(all_darks)
    dark, match = fit_dark_signal(darks), match_darks(flats, darks)
    ceiling_dn = sample_ceiling_dn(levels, bit_depth=bit_depth)
    curve = judged_curve(flats, darks, dark, match, ceiling_dn=ceiling_dn)
    wrong = [flat for flat, one in zip(flats, curve.levels, strict=True) if one.cause is not None]
    flags += (*dark_flags, *curve.flags, *light_course_flags(levels, wrong=wrong))
    flags += curve_flags(flats, curve.transfer, dark, match)
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
