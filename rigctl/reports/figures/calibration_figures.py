"""Curves of a noise calibration: photon transfer, signal-to-noise ratio, linearity, dark signal."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.sensor.levels import LevelStatistics
from calibration.sensor.noise import NoiseCalibration, temporal_noise_e, total_noise_e
from rigctl.numbers.number_text import to_digits
from rigctl.reports.figures.figure_style import (
    MEASURED,
    PREDICTED,
    few_log_labels,
    legend_below,
    legend_beside,
    mark_beyond,
    png,
    subplots,
)

FloatArray = NDArray[np.float64]

_GREY = "0.45"
_MS_PER_S = 1e3
_LONG_BAR = 10.0
# A level fainter than this share of the brightest says nothing of a line.
_FAINT = 0.01
_WRONG_LIGHT = ("wrong_light", "another_gain", "wrong_level")
_LIGHT_GREY = "0.62"
# Times the median error, and relative, that a point may have to count for the axes.
_KNOWN, _LEAST_KNOWN = 10.0, 0.3


def linearity_png(calibration: NoiseCalibration) -> bytes | None:
    """Return mean against light, and how far it is from a straight line; None where no light is known."""
    light, label = _light(calibration.flats)
    if light is None:
        return None
    signal_dn, used = calibration.transfer.points.signal_dn, calibration.transfer.used
    named = np.array([level.cause in _WRONG_LIGHT for level in calibration.influence])
    figure, (above, below) = subplots(2, 1, size=(9.6, 6.0))
    for chosen, marker, colour, name in (
        (used & ~named, "o", MEASURED, "flats used"),
        (~used & ~named, "x", _GREY, "flats left out"),
        (named, "s", "black", "flats named as wrong"),
    ):
        if chosen.any():
            above.plot(light[chosen], signal_dn[chosen], marker, ms=5, color=colour, label=name)
    sound = used & ~named if np.count_nonzero(used & ~named) > 1 else used
    line = (
        np.polyfit(
            light[sound], signal_dn[sound], 1, w=1.0 / np.maximum(signal_dn[sound], _FAINT * signal_dn[sound].max())
        )
        if sound.sum() > 1
        else np.zeros(2)
    )
    shown = np.linspace(0.0, light.max(), 200)
    above.plot(shown, np.polyval(line, shown), color=PREDICTED, label="straight line, weights 1 / signal")
    above.set(xlabel=label, ylabel="signal above dark [DN]", title="Linearity")
    off = 100.0 * (signal_dn[used] / np.polyval(line, light[used]) - 1.0)
    errors = _relative_errors(calibration)
    # A bar that is longer than the axes would be a line across them.
    shown_errors = np.where(errors <= _LONG_BAR * np.median(errors), errors, np.nan)
    below.errorbar(signal_dn[used], off, shown_errors, fmt="o", ms=4, color=MEASURED, label="flats used")
    mark_beyond(below, signal_dn[used], off, errors, trusted=sound[used])
    _draw_response(below, calibration)
    below.axhline(0.0, color="black", lw=0.8)
    below.set(xlabel="signal above dark [DN]", ylabel="off the straight line [%]")
    for axes in (above, below):
        _finish(axes)
    return png(figure)


def _relative_errors(calibration: NoiseCalibration) -> FloatArray:
    """Return the sampling error of the mean of each level that is used [%]."""
    points, used = calibration.transfer.points, calibration.transfer.used
    n = np.array([level.n_frames * level.n_pixels for level in calibration.flats])[used]
    errors: FloatArray = 100.0 * np.sqrt(points.flat_variance_dn2[used] / n) / points.signal_dn[used]
    return errors


def _draw_response(axes: Axes, calibration: NoiseCalibration) -> None:
    curve, signal_dn = calibration.transfer.linearity, calibration.transfer.points.signal_dn[calibration.transfer.used]
    if curve is None:
        return
    response = np.polynomial.Polynomial([0.0, 1.0, curve.quadratic_per_dn, curve.cubic_per_dn2])
    # By the same weights, at the levels, as the line above.
    line = np.polyfit(signal_dn, response(signal_dn), 1, w=1.0 / signal_dn)
    x = np.linspace(max(signal_dn.min(), 0.05 * signal_dn.max()), signal_dn.max(), 200)
    off = 100.0 * (response(x) / np.polyval(line, x) - 1.0)
    axes.plot(response(x), off, color=PREDICTED, label="fitted response (cubic), off its own line")


def _light(flats: tuple[LevelStatistics, ...]) -> tuple[FloatArray | None, str]:
    photons = [flat.photons for flat in flats if flat.photons is not None]
    exposures = [flat.exposure_s for flat in flats if flat.exposure_s is not None]
    if len(photons) == len(flats):
        return np.array(photons), "photons per pixel"
    if len(exposures) == len(flats) and len(set(exposures)) > 2:
        return _MS_PER_S * np.array(exposures), "exposure time [ms]"
    return None, ""


def dark_png(calibration: NoiseCalibration) -> bytes | None:
    """Return mean and variance of the dark frames against exposure; None where exposures are not known."""
    exposures = [level.exposure_s for level in calibration.darks if level.exposure_s is not None]
    if len(exposures) < len(calibration.darks):
        return None
    time_s = np.array(exposures)
    figure, (left, right) = subplots(1, 2, size=(9.6, 4.4))
    dark, shown_s = calibration.dark, np.linspace(0.0, time_s.max(), 50)
    left.plot(_MS_PER_S * time_s, dark.means_dn, "o", ms=5, color=MEASURED, label="dark levels")
    left.plot(_MS_PER_S * shown_s, dark.mean_at(shown_s), color=PREDICTED, label=_mean_label(calibration))
    left.set(ylabel="mean [DN]", title="Dark signal")
    errors = np.array([level.temporal_std_error_dn2 for level in calibration.darks])
    right.errorbar(
        _MS_PER_S * time_s,
        [level.temporal_variance_dn2 for level in calibration.darks],
        errors,
        fmt="o",
        ms=5,
        color=MEASURED,
        label="dark levels",
    )
    fitted = dark.variance_at(shown_s)
    if fitted is not None:
        right.plot(_MS_PER_S * shown_s, fitted, color=PREDICTED, label=_variance_label(calibration))
    right.set(ylabel="variance in time [DN$^2$]", title="Dark noise")
    for axes in (left, right):
        axes.set_xlabel("exposure time [ms]")
        axes.locator_params(axis="x", nbins=6)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.grid(alpha=0.3, which="both", lw=0.4)
        legend_below(axes)
    return png(figure)


def _mean_label(calibration: NoiseCalibration) -> str:
    return _line_label(calibration, calibration.dark_current_e_per_s)


def _variance_label(calibration: NoiseCalibration) -> str:
    return _line_label(calibration, calibration.performance.dark_current_variance_e_per_s)


def _line_label(calibration: NoiseCalibration, dark_current_e_per_s: Estimate | None) -> str:
    if dark_current_e_per_s is None:
        return "straight line" if calibration.dark.has_slope else "mean"
    value, error = dark_current_e_per_s.value, dark_current_e_per_s.std_error
    return f"dark current {to_digits(value, error)} ± {error:.2g} e-/s"


def snr_png(calibration: NoiseCalibration) -> bytes:
    """Return the signal-to-noise ratio of a pixel against its signal; of a read noise that is a bound its curve."""
    gain, points = calibration.gain_dn_per_e.value, calibration.transfer.points
    shown = (points.signal_dn > 0.0) & (points.flat_variance_dn2 > 0.0) & ~points.saturated
    signal_e = points.signal_dn[shown] / gain
    figure, (axes,) = subplots(1, 1, size=(9.6, 4.8))
    ratio = points.signal_dn[shown] / np.sqrt(points.flat_variance_dn2[shown])
    axes.plot(signal_e, ratio, "o", ms=5, color=MEASURED, label="flats, noise in time")
    x = np.geomspace(1.0, signal_e.max(), 300)
    _draw_expected_ratio(axes, calibration, x)
    axes.plot(x, np.sqrt(x), color=_GREY, ls=":", label="photons alone")
    _mark_limits(axes, calibration)
    axes.set(xscale="log", yscale="log", xlabel="signal [e-]", ylabel="signal over noise of a pixel")
    few_log_labels(axes.yaxis)
    axes.set_title("Signal-to-noise ratio")
    axes.set_ylim(bottom=0.05)
    # A level of less than an electron is a dark one.
    axes.set_xlim(left=0.7)
    _finish(axes)
    return png(figure)


def _draw_expected_ratio(axes: Axes, calibration: NoiseCalibration, signal_e: FloatArray) -> None:
    found, bound = calibration.read_noise_e, calibration.bounds.get("read_noise_e")
    if found is None and bound is None:
        return
    read_noise_e = found.value if found is not None else bound.value if bound is not None else 0.0
    temporal_e = temporal_noise_e(signal_e, read_noise_e=read_noise_e, gain_dn_per_e=calibration.gain_dn_per_e.value)
    label = "by gain and read noise" if found is not None else f"at least: read noise below {read_noise_e:.3g} e-"
    axes.plot(signal_e, signal_e / temporal_e, color=PREDICTED, label=label)
    if calibration.prnu is not None and calibration.dsnu_e is not None:
        total_e = total_noise_e(temporal_e, signal_e, prnu=calibration.prnu.value, dsnu_e=calibration.dsnu_e.value)
        axes.plot(signal_e, signal_e / total_e, color=PREDICTED, ls="--", label="with DSNU and PRNU")


def _mark_limits(axes: Axes, calibration: NoiseCalibration) -> None:
    threshold, highest = calibration.performance.threshold_e, calibration.performance.snr_max
    if threshold is not None:
        axes.axhline(1.0, color="black", lw=0.6)
        axes.plot(threshold.value, 1.0, "k^", ms=7, label=f"threshold {threshold.value:.3g} e-")
    if highest is not None:
        label = f"largest {highest.value:.0f} ({20.0 * np.log10(highest.value):.1f} dB)"
        axes.plot(highest.value**2, highest.value, "ks", ms=6, label=label)


def _finish(axes: Axes) -> None:
    axes.grid(alpha=0.3, which="both", lw=0.4)
    legend_beside(axes)


def photon_transfer_png(calibration: NoiseCalibration) -> bytes:
    """Return the photon-transfer plot as a PNG file: noise against signal, and residuals of the fit.

    Notes
    -----
    Above, on log axes: standard deviation in time of a pixel, the fit, and the regimes that it is made of: dark noise
    (slope 0), noise of photons (slope 1/2), and the fixed pattern (slope 1), which is no noise in time. Below: how far
    the points of the variance are from the fit, with their sampling errors, and where the standard's line goes.
    """
    figure, _ = subplots(1, 1, size=(9.6, 7.0))
    figure.clear()
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
    _draw_noise(above, calibration)
    _draw_residuals(below, calibration)
    return png(figure)


def _draw_noise(axes: Axes, calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    points, seen = transfer.points, transfer.points.signal_dn > 0.0
    total_dn2 = points.flat_variance_dn2
    dark_dn2 = float(np.median(total_dn2 - points.variance_dn2))
    signal_dn = np.geomspace(min(points.signal_dn[seen].min() / 2.0, 2.0), points.signal_dn.max(), 300)
    fit_dn2 = dark_dn2 + transfer.variance_at(signal_dn)
    noisy = total_dn2 > 0.0
    named = np.array([level.cause is not None for level in calibration.influence])
    for chosen, marker, colour, label in (
        (transfer.used & noisy, "o", MEASURED, "flats used"),
        (~transfer.used & seen & noisy, "x", _GREY, "flats left out"),
        (named & seen & noisy, "s", "black", "flats named as wrong"),
    ):
        if not chosen.any():
            continue
        axes.plot(
            points.signal_dn[chosen],
            np.sqrt(total_dn2[chosen]),
            marker,
            ms=5,
            mfc="none" if marker == "s" else None,
            color=colour,
            label=label,
        )
    rising = (fit_dn2 > 0.0) & (signal_dn <= 1.3 * transfer.top_dn)
    axes.plot(signal_dn[rising], np.sqrt(fit_dn2[rising]), color=PREDICTED, label=_fit_label(calibration))
    _draw_regimes(axes, calibration, signal_dn, dark_dn=float(np.sqrt(dark_dn2)))
    axes.set(xscale="log", yscale="log", ylabel="noise of a pixel in time [DN]", title="Photon transfer")
    few_log_labels(axes.yaxis)
    axes.set_xlim(_left_dn(calibration), 1.3 * float(points.signal_dn.max()))
    axes.set_ylim(bottom=0.3 * np.sqrt(max(dark_dn2, 1.0 / 12.0)))
    axes.grid(alpha=0.3, which="both", lw=0.4)
    legend_beside(axes)


def _left_dn(calibration: NoiseCalibration) -> float:
    """Return where the axis begins: below the faintest point whose photon noise is known, not of one that is dark."""
    points, used = calibration.transfer.points, calibration.transfer.used
    relative = points.std_error_dn2[used] / calibration.transfer.variance_at(points.signal_dn[used])
    known = np.abs(relative) < max(_KNOWN * float(np.median(np.abs(relative))), _LEAST_KNOWN)
    return float(points.signal_dn[used][known].min()) / 5.0


def _draw_regimes(axes: Axes, calibration: NoiseCalibration, signal_dn: FloatArray, *, dark_dn: float) -> None:
    gain = calibration.gain_dn_per_e.value
    axes.plot(signal_dn, np.full_like(signal_dn, dark_dn), color=_GREY, ls=":", lw=1.2, label=_dark_label(dark_dn))
    axes.plot(
        signal_dn,
        np.sqrt(gain * signal_dn),
        color=_GREY,
        ls="--",
        lw=1.2,
        label="photons, slope 1/2: root(gain x signal)",
    )
    if calibration.prnu is not None:
        label = f"fixed pattern, slope 1: PRNU {calibration.prnu.value:.2%} (not in the points)"
        axes.plot(signal_dn, calibration.prnu.value * signal_dn, color=_GREY, ls="-.", lw=1.2, label=label)
    saturation = calibration.transfer.saturation
    if saturation is not None:
        low, high = (saturation.signal_dn + sign * 3.0**0.5 * saturation.std_error_dn for sign in (-1.0, 1.0))
        axes.axvspan(low, high, color=_LIGHT_GREY, alpha=0.5, lw=0, label="saturation lies here")


def _dark_label(dark_dn: float) -> str:
    return f"dark noise, slope 0: {dark_dn:.3g} DN"


def _fit_label(calibration: NoiseCalibration) -> str:
    gain = calibration.gain_dn_per_e
    return f"fit: gain {gain.value:.4g} ± {gain.std_error:.2g} DN/e- at no signal"


def _draw_residuals(axes: Axes, calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    used = transfer.used
    signal_dn, variance_dn2 = transfer.points.signal_dn[used], transfer.points.variance_dn2[used]
    fit_dn2 = transfer.variance_at(signal_dn)
    off = 100.0 * (variance_dn2 / fit_dn2 - 1.0)
    errors = 100.0 * transfer.points.std_error_dn2[used] / fit_dn2
    axes.errorbar(signal_dn, off, errors, fmt="o", ms=4, color=MEASURED, label="flats used, with sampling errors")
    mark_beyond(axes, signal_dn, off, errors)
    axes.axhline(0.0, color=PREDICTED, lw=1)
    emva = calibration.emva1288["gain_dn_per_e"]
    if emva is not None:
        shown = np.geomspace(signal_dn.min(), signal_dn.max(), 100)
        off = 100.0 * (emva.value * shown / transfer.variance_at(shown) - 1.0)
        axes.plot(shown, off, color=_GREY, ls="--", lw=1.2, label="straight line of EMVA 1288")
    axes.set(xlabel="signal above dark [DN]", ylabel="variance off the fit [%]")
    few_log_labels(axes.xaxis)
    axes.grid(alpha=0.3, which="both", lw=0.4)
    legend_beside(axes)
