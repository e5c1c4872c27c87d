"""Findings in dark signal and photon-transfer curve that speak against a calibration, each by its own name."""

from collections.abc import Sequence

import numpy as np

from calibration.estimate import number_with_error, percent_with_error
from calibration.flags import Flag
from calibration.sensor.brighter_fatter import brighter_fatter
from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2, DarkMatch, DarkSignal
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.level_influence import is_lamp_sweep
from calibration.sensor.level_names import level_names
from calibration.sensor.photon_transfer import BEND_LEVELS, PhotonTransfer

# A curve that is off its own first slope by so much is no photon noise of a linear sensor.
_NO_LINE = 0.3
# Beyond saturation the mean grows by little; a curve whose variance falls while the mean goes on is a tone curve.
_BEYOND_SATURATION = 1.5
_BEND = 0.02
_BEND_SIGMA = 3.0
_LEFT_SIGMA = 2.0
_SCATTER = 0.005
_NOT_LINEAR = 0.01
_LAMP = 0.01
_SCATTER_CHI2_PER_DOF = 3.0
_CLAMP_SIGMA = 5.0


def curve_flags(
    flats: Sequence[LevelStatistics], transfer: PhotonTransfer, dark: DarkSignal, match: DarkMatch
) -> tuple[Flag, ...]:
    """Return what is odd in the fits.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        In the order of the curve's points.
    transfer : PhotonTransfer
        The curve.
    dark : DarkSignal
        The dark levels.
    match : DarkMatch
        Which darks belong to which flat.
    """
    found = (
        _not_photon_noise(transfer),
        _too_few_levels(transfer),
        _saturation_not_reached(flats, transfer),
        _bent(transfer),
        _scattered(transfer),
        _not_linear(transfer),
        _unsteady_lamp(transfer),
        _uncovered(flats, transfer, match),
        _single_dark_exposure(dark),
        _dark_current_changed(dark),
        _quantisation_limited(transfer, dark),
        _black_clamp(transfer, dark),
    )
    return tuple(flag for flag in found if flag is not None)


def _relative_bend(transfer: PhotonTransfer) -> float:
    """Return by which share the curve departs from its first slope, at the brightest point of the fit."""
    top_dn = transfer.top_dn
    return (transfer.bend + transfer.cubic * top_dn) * top_dn / transfer.gain_dn_per_e


def _relative_bend_error(transfer: PhotonTransfer) -> float:
    """Return the standard error of the bend at the brightest point of the fit."""
    top_dn = transfer.top_dn
    gradient = top_dn ** np.arange(1, len(transfer.fit.parameters))
    own = gradient @ transfer.fit.covariance[1:, 1:] @ gradient
    return float(np.sqrt(own)) / transfer.gain_dn_per_e


def _not_photon_noise(transfer: PhotonTransfer) -> Flag | None:
    bend = abs(_relative_bend(transfer))
    is_line = transfer.gain_dn_per_e > 0.0 and (bend < _NO_LINE or bend < _BEND_SIGMA * _relative_bend_error(transfer))
    if is_line and not _falls_early(transfer):
        return None
    signal, variance = transfer.points.signal_dn, transfer.points.variance_dn2
    first, last = np.flatnonzero(transfer.used if not is_line else ~transfer.points.saturated)[[0, -1]]
    return Flag(
        name="not_photon_noise",
        message=f"the temporal variance goes from {variance[first]:.4g} to {variance[last]:.4g} DN^2 while the signal "
        f"goes from {signal[first]:.4g} to {signal[last]:.4g} DN; photon noise grows in proportion to the signal: "
        f"switch gamma, tone mapping, noise reduction and compression off, and check kinds and exposures",
        refuses=True,
    )


def _falls_early(transfer: PhotonTransfer) -> bool:
    """Return whether the variance is largest at a signal far below others that are not saturated."""
    peak, open_ = transfer.saturation, transfer.points.signal_dn[~transfer.points.saturated]
    return peak is not None and float(open_.max()) > _BEYOND_SATURATION * transfer.points.signal_dn[peak.upper]


def _too_few_levels(transfer: PhotonTransfer) -> Flag | None:
    n_used = int(np.count_nonzero(transfer.used))
    if n_used >= BEND_LEVELS:
        return None
    return Flag(
        name="too_few_levels",
        message=f"{n_used} of {len(transfer.used)} flat levels can be used for the gain; with fewer than {BEND_LEVELS} "
        f"neither bend nor scatter of the photon-transfer curve is seen, and a sensor that is not linear has a "
        f"larger error than stated: take 10 levels or more between dark and 80 % of saturation",
    )


def _saturation_not_reached(flats: Sequence[LevelStatistics], transfer: PhotonTransfer) -> Flag | None:
    if transfer.saturation is not None:
        return None
    more = "go on with a brighter lamp" if is_lamp_sweep(flats) else "add longer exposures"
    return Flag(
        name="saturation_not_reached",
        message=f"no rise and fall of the temporal variance is seen up to the brightest level "
        f"({transfer.points.signal_dn.max():.4g} DN above dark), so saturation is not known: {more}, "
        f"until most of the picture is saturated",
    )


def _bent(transfer: PhotonTransfer) -> Flag | None:
    bend = _relative_bend(transfer)
    if abs(bend) < _BEND or abs(bend) < _BEND_SIGMA * _relative_bend_error(transfer):
        return None
    return Flag(
        name="bent_photon_transfer",
        message=f"at {transfer.top_dn:.4g} DN the photon-transfer curve is {bend:+.1%} off its slope at no signal "
        f"(more than {_BEND:.0%} and than noise): {_cause(transfer)}; the gain given is the one at no signal, and "
        f"noise predicted for bright scenes is off by as much",
    )


def _cause(transfer: PhotonTransfer) -> str:
    """Return what bends the curve, as far as its direction and the response of the sensor tell."""
    spreading, curve = brighter_fatter(transfer), transfer.linearity
    rises = _relative_bend(transfer) > 0.0
    if spreading is None or curve is None:
        # Charge that spreads between pixels only ever takes variance away.
        return (
            "the response is not linear (digital corrections, gamma), or light or gain changed within levels"
            if rises
            else "the sensor is not linear, or charge spreads between pixels"
        )
    top_dn = transfer.top_dn
    response = (curve.quadratic_per_dn + curve.cubic_per_dn2 * top_dn) * top_dn
    found = f"mean against {curve.light} is {response:+.2%} off its line there"
    left = f"{percent_with_error(spreading.value, spreading.std_error)}"
    if abs(spreading.value) < _LEFT_SIGMA * spreading.std_error:
        return f"{found}, and what that does not explain ({left}) is within its error"
    if spreading.value > 0.0:
        return f"{found}, and {left} more is left that no spreading of charge makes: another noise grows with the light"
    return f"{found}, and {left} is left for charge that spreads between pixels"


def _scattered(transfer: PhotonTransfer) -> Flag | None:
    scatter, chi2_per_dof = transfer.fit.scatter / abs(transfer.gain_dn_per_e), transfer.fit.chi2_per_dof
    if chi2_per_dof is None or chi2_per_dof < _SCATTER_CHI2_PER_DOF or scatter < _SCATTER:
        return None
    return Flag(
        name="scattered_photon_transfer",
        message=f"the points scatter by {scatter:.1%} about the photon-transfer curve, more than their sampling "
        f"explains (chi-squared {chi2_per_dof:.3g} per degree of freedom); the standard errors hold it: more "
        f"exposures make the gain better, more frames at each do not",
    )


def _not_linear(transfer: PhotonTransfer) -> Flag | None:
    curve = transfer.linearity
    if curve is None:
        return None
    top_dn = transfer.top_dn
    off = (curve.quadratic_per_dn + curve.cubic_per_dn2 * top_dn) * top_dn
    gradient = np.array([top_dn, top_dn**2])
    error = float(np.sqrt(gradient @ curve.covariance @ gradient))
    if abs(off) < _NOT_LINEAR or abs(off) < _BEND_SIGMA * error:
        return None
    return Flag(
        name="response_not_linear",
        message=f"at {top_dn:.4g} DN the mean is {percent_with_error(off, error)} off its slope at no signal (more "
        f"than {_NOT_LINEAR:.0%}): radiances of bright scenes are off by as much; the response is in the calibration, "
        f"or expose so that scenes stay below {_NOT_LINEAR / abs(off) * top_dn:.0f} DN",
    )


def _unsteady_lamp(transfer: PhotonTransfer) -> Flag | None:
    curve = transfer.linearity
    if curve is None or curve.relative_scatter < _LAMP:
        return None
    return Flag(
        name="unsteady_lamp",
        message=f"the means of the levels scatter by {curve.relative_scatter:.1%} about a smooth response to the "
        f"{curve.light} (more than {_LAMP:.0%}): the lamp flickers or drifts between levels, or exposures are not "
        f"exact; the gain stands, with a larger error since the response is known less well: let the lamp warm up",
    )


def _uncovered(flats: Sequence[LevelStatistics], transfer: PhotonTransfer, match: DarkMatch) -> Flag | None:
    uncovered = [flats[index] for index in np.flatnonzero(transfer.used & ~match.covered).tolist()]
    if not uncovered:
        return None
    return Flag(
        name="dark_exposure_missing",
        message=f"there are no dark frames around the exposure of "
        f"{level_names(uncovered)}; those of the nearest exposure were taken, and the difference in dark current "
        f"counts as signal: take dark frames at the exposures of the flats, or at the shortest and the longest",
    )


def _single_dark_exposure(dark: DarkSignal) -> Flag | None:
    if dark.has_slope or dark.is_curved:
        return None
    return Flag(
        name="single_dark_exposure",
        message="dark frames have one exposure, or exposures are not known: there is no dark current, and what it adds "
        "within this exposure counts as black level and read noise; take dark frames at two or more exposures, the "
        "longest as long as it may be",
    )


def _dark_current_changed(dark: DarkSignal) -> Flag | None:
    if not dark.is_curved:
        return None
    bend, error = float(dark.mean_fit.parameters[2]), float(np.sqrt(dark.mean_fit.covariance[2, 2]))
    return Flag(
        name="dark_current_changed",
        message=f"the mean of dark frames is no straight line of their exposure ("
        f"{number_with_error(bend, error, sign='+')} DN/s^2): "
        f"the sensor warmed up or cooled down while they were taken, or light got in: the dark current is not known, "
        f"black level and read noise are those of a curve: let the camera warm up for half an hour, and take the dark "
        f"frames in mixed order",
    )


def _quantisation_limited(transfer: PhotonTransfer, dark: DarkSignal) -> Flag | None:
    if not dark.quantisation_limited:
        return None
    limit_dn = np.sqrt(QUANTISATION_LIMIT_DN2)
    return Flag(
        name="quantisation_limited",
        message=f"the temporal noise of dark frames is below {limit_dn:.2f} DN, where rounding to whole counts hides "
        f"it: the read noise is only known to be below {limit_dn / abs(transfer.gain_dn_per_e):.3g} e-; raise the "
        f"camera's gain to measure it",
    )


def _black_clamp(transfer: PhotonTransfer, dark: DarkSignal) -> Flag | None:
    fit = dark.variance_fit
    if fit is None or not dark.has_slope:
        return None
    by_mean, by_variance = dark.mean_fit.parameters[1], fit.parameters[1] / transfer.gain_dn_per_e
    error = np.hypot(np.sqrt(dark.mean_fit.covariance[1, 1]), np.sqrt(fit.covariance[1, 1]) / transfer.gain_dn_per_e)
    if abs(by_mean - by_variance) < _CLAMP_SIGMA * error:
        return None
    return Flag(
        name="black_clamp",
        message=f"with exposure the mean of dark frames grows by {by_mean:.4g} DN/s, their variance says "
        f"{by_variance:.4g} DN/s (difference more than {_CLAMP_SIGMA:.0f} standard errors): the camera takes dark "
        f"signal off by itself, or dark frames were not dark; the dark current given is that of the mean",
    )
