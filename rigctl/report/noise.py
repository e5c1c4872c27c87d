"""A noise calibration for people: table of numbers, EMVA 1288 summary sheet, figures, history, and the report page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.emva1288 import EMVA_SYMBOLS
from calibration.sensor.noise import first_lines, not_known, temporal_noise_e, total_noise_e
from calibration.sensor.pattern import Defect
from rigctl.base.numbers import to_digits, utc_moment
from rigctl.report.document import Column, Picture, Report, Section, Shown, Table, text_columns
from rigctl.report.drawing import (
    MEASURED,
    PREDICTED,
    few_log_labels,
    finish_picture,
    legend_below,
    legend_beside,
    legend_of_all,
    mark_beyond,
    png,
    subplots,
)
from rigctl.version import VERSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibration.estimate import Estimate
    from calibration.results import Flag
    from calibration.sensor.emva1288 import EmvaFigure
    from calibration.sensor.levels import LevelStatistics
    from calibration.sensor.noise import NoiseCalibration, Performance
    from calibration.sensor.pattern import FixedPattern, PatternHistogram, Spectrogram
    from rigctl.calibrations.noise_frames import FrameSet, FrameSource
    from rigctl.calibrations.store import History
    from rigctl.report.document import Block


_BEST, _STANDARD = "best", "EMVA 1288"
_NOT_KNOWN, _NOT_DETERMINED = "not known", "not determined"
# Digits of a number without an error, and limit for powers of ten.
_MOST_DIGITS, _LARGE, _THOUSAND = 6, 1e6, 1e3
# Title, unit, factor from the file's unit to this one, key of the best number, key of the standard's.
_ROWS: tuple[tuple[str, str, float, str | None, str | None], ...] = (
    ("gain", "DN/e-", 1.0, "gain_dn_per_e", "gain_dn_per_e"),
    ("quantum efficiency", "%", 100.0, "quantum_efficiency", "quantum_efficiency"),
    ("responsivity", "DN/photon", 1.0, None, "responsivity_dn_per_photon"),
    ("read noise", "e-", 1.0, "read_noise_e", "temporal_dark_noise_e"),
    ("dark noise with rounding", "DN", 1.0, None, "temporal_dark_noise_dn"),
    ("black level", "DN", 1.0, "black_level_dn", None),
    ("sensitivity threshold", "e-", 1.0, "threshold_e", "threshold_e"),
    ("sensitivity threshold", "photons", 1.0, None, "threshold_photons"),
    ("saturation", "e-", 1.0, "saturation_e", "saturation_e"),
    ("saturation", "photons", 1.0, None, "saturation_photons"),
    ("dynamic range", "", 1.0, "dynamic_range", "dynamic_range"),
    ("largest SNR", "", 1.0, "snr_max", "snr_max"),
    ("linearity error, lowest", "%", 100.0, None, "linearity_error_min"),
    ("linearity error, highest", "%", 100.0, None, "linearity_error_max"),
    ("dark current by mean", "e-/s", 1.0, "dark_current_e_per_s", "dark_current_mean_e_per_s"),
    ("dark current by variance", "e-/s", 1.0, "dark_current_variance_e_per_s", "dark_current_variance_e_per_s"),
    ("DSNU", "e-", 1.0, "dsnu_e", "dsnu_e"),
    ("DSNU of rows", "e-", 1.0, None, "dsnu_row_e"),
    ("DSNU of columns", "e-", 1.0, None, "dsnu_column_e"),
    ("DSNU of pixels", "e-", 1.0, None, "dsnu_pixel_e"),
    ("PRNU", "%", 100.0, "prnu", "prnu"),
    ("PRNU of rows", "%", 100.0, None, "prnu_row"),
    ("PRNU of columns", "%", 100.0, None, "prnu_column"),
    ("PRNU of pixels", "%", 100.0, None, "prnu_pixel"),
)


# A quantity with its numbers as text, to the digits of their errors: `value`, `error` and `frames` of the number that
# the model uses, `emva_value`, `emva_error`, `emva_frames` and `symbol` of the standard's; empty where it has none.
Row = dict[str, str]


def _column(key: str, title: str, *, group: str = "", left: bool = False, shown: Shown = Shown.PEOPLE) -> Column[Row]:
    return Column(title=title, text=itemgetter(key), group=group, left=left, shown=shown)


_QUANTITY, _UNIT = _column("quantity", "quantity", left=True), _column("unit", "unit", left=True)
_COLUMNS = (
    _QUANTITY,
    _column("value", "value", group=_BEST),
    _column("error", "std error", group=_BEST),
    _column("frames", "frames", group=_BEST, shown=Shown.PAGE),
    _column("symbol", "symbol", group=_STANDARD, shown=Shown.PAGE),
    _column("emva_value", "value", group=_STANDARD, shown=Shown.PAGE),
    _column("emva_value", _STANDARD, shown=Shown.TERMINAL),
    _column("emva_error", "std error", group=_STANDARD),
    _column("emva_frames", "frames", group=_STANDARD, shown=Shown.PAGE),
    _UNIT,
)
_SHEET_COLUMNS = (
    _QUANTITY,
    _column("symbol", "symbol", left=True),
    _column("emva_value", "value"),
    _column("emva_error", "std error"),
    _UNIT,
)


def calibration_table(rows: list[Row]) -> Table[Row]:
    """Return the known numbers of a calibration, or bounds, next to those of the standard."""
    missing = ("", _NOT_KNOWN, _NOT_DETERMINED)
    known = (row for row in rows if row["value"] not in missing or row["emva_value"] not in missing)
    return Table(columns=_COLUMNS, rows=tuple(known))


def sheet_table(rows: list[Row]) -> Table[Row]:
    """Return the numbers of the standard's summary sheet."""
    return Table(columns=_SHEET_COLUMNS, rows=tuple(row for row in rows if row["symbol"]))


def calibration_rows(noise: NoiseCalibration) -> list[Row]:
    """Return the numbers of a calibration."""
    return [_row(noise, *row) for row in _ROWS]


def unknown_lines(noise: NoiseCalibration) -> list[str]:
    """Return a line for each reason for missing numbers, with the remedy."""
    reasons = not_known(noise)
    titles: dict[str, list[str]] = {}
    for title, _, _, key, emva_key in _ROWS:
        for name in (key, emva_key):
            if name is not None and name in reasons and title not in titles.setdefault(reasons[name], []):
                titles[reasons[name]].append(title)
    missing = _NOT_KNOWN if noise.darks else _NOT_DETERMINED
    return [f"{missing}: {', '.join(words)}: {reason}" for reason, words in titles.items() if words]


def _row(noise: NoiseCalibration, title: str, unit: str, factor: float, key: str | None, emva_key: str | None) -> Row:
    best = None if key is None else _best(noise, key)
    missing = _NOT_KNOWN if noise.darks else _NOT_DETERMINED
    value, error, frames = ("", "", "") if key is None else _cells(best, factor, missing)
    if key is not None and best is None and (bound := noise.bounds.get(key)) is not None:
        value = f"{bound.bound} {_brief(factor * bound.value)}"
    standard = None if emva_key is None else noise.emva1288[emva_key]
    emva_value, emva_error, emva_frames = ("", "", "") if emva_key is None else _cells(standard, factor, missing)
    if standard is not None and standard.bound is not None:
        emva_value, emva_error = f"{standard.bound} {_brief(factor * standard.value)}", ""
    symbol = "" if emva_key is None or standard is None else EMVA_SYMBOLS[emva_key]
    best_cells = {"value": value, "error": error, "frames": frames}
    emva_cells = {"emva_value": emva_value, "emva_error": emva_error, "emva_frames": emva_frames, "symbol": symbol}
    return {"quantity": title, "unit": unit, **best_cells, **emva_cells}


def _best(noise: NoiseCalibration, key: str) -> Estimate | None:
    found: Estimate | None = getattr(noise if hasattr(noise, key) else noise.performance, key)
    return found


def _cells(found: Estimate | EmvaFigure | None, factor: float, missing: str) -> tuple[str, str, str]:
    """Return value and standard error to two digits of the error, and the number of frames."""
    if found is None:
        return missing, "", ""
    value = factor * found.value
    if not found.std_error:
        return f"{value:.4g}", "", str(found.n)
    error = factor * found.std_error
    digits = min(1 - _exponent(error), _MOST_DIGITS - 1 - _exponent(value) if value else _MOST_DIGITS)
    return _rounded(value, digits), _rounded(error, digits), str(found.n)


def _rounded(number: float, digits: int) -> str:
    """Return a number to a number of digits after the point; a negative one counts digits before it."""
    rounded = round(number, digits)
    return _brief(rounded) if abs(rounded) >= _LARGE else f"{rounded:.{max(digits, 0)}f}"


def _brief(number: float) -> str:
    return f"{number:.3g}" if not _LARGE > abs(number) >= _THOUSAND else f"{float(f'{number:.3g}'):.0f}"


def _exponent(number: float) -> int:
    return int(f"{number:.1e}".partition("e")[2])


FloatArray = NDArray[np.float64]

_GREY = "0.45"
_MS_PER_S = 1e3
_LONG_BAR = 10.0
# Least signal for the line, as a share of the brightest.
_FAINT = 0.01
_WRONG_LIGHT = ("wrong_light", "another_gain", "wrong_level")
_LIGHT_GREY = "0.62"
# Largest error of a point that affects the axes, over the median error, and relative.
_KNOWN, _LEAST_KNOWN = 10.0, 0.3


def linearity_png(calibration: NoiseCalibration) -> bytes | None:
    """Return mean against light, and its deviation from a straight line; None if no light is known."""
    light, label = _light(calibration.flats)
    if light is None:
        return None
    signal_dn, used = calibration.transfer.points.signal_dn, calibration.transfer.used
    named = np.array([level.cause in _WRONG_LIGHT for level in calibration.influence])
    figure, (above, below) = subplots(2, 1, size=(9.6, 6.0))
    for chosen, marker, colour, name in (
        (used & ~named, "o", MEASURED, "flats used"),
        (~used & ~named, "x", _GREY, "flats left out"),
        (named, "s", "black", "flats flagged as wrong"),
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
    # A bar longer than the axes would cross them as a line.
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
    """Return the sampling error of the mean of each used level [%]."""
    points, used = calibration.transfer.points, calibration.transfer.used
    n = np.array([level.n_frames * level.n_pixels for level in calibration.flats])[used]
    errors: FloatArray = 100.0 * np.sqrt(points.flat_variance_dn2[used] / n) / points.signal_dn[used]
    return errors


def _draw_response(axes: Axes, calibration: NoiseCalibration) -> None:
    curve, signal_dn = calibration.transfer.linearity, calibration.transfer.points.signal_dn[calibration.transfer.used]
    if curve is None:
        return
    response = np.polynomial.Polynomial([0.0, 1.0, curve.quadratic_per_dn, curve.cubic_per_dn2])
    # With the same weights at the levels as the line above.
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
    """Return mean and variance of the dark frames against exposure; None if exposures are unknown."""
    exposures = [level.exposure_s for level in calibration.darks if level.exposure_s is not None]
    if not exposures or len(exposures) < len(calibration.darks):
        return None
    time_s = np.array(exposures)
    figure, (left, right) = subplots(1, 2, size=(9.6, 4.4))
    dark, shown_s = calibration.dark, np.linspace(0.0, time_s.max(), 50)
    left.plot(_MS_PER_S * time_s, dark.means_dn, "o", ms=5, color=MEASURED, label="dark levels")
    left.plot(
        _MS_PER_S * shown_s,
        dark.mean_at(shown_s),
        color=PREDICTED,
        label=_line_label(calibration, calibration.dark_current_e_per_s),
    )
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
        label = _line_label(calibration, calibration.performance.dark_current_variance_e_per_s)
        right.plot(_MS_PER_S * shown_s, fitted, color=PREDICTED, label=label)
    right.set(ylabel="temporal variance [DN$^2$]", title="Dark noise")
    for axes in (left, right):
        axes.set_xlabel("exposure time [ms]")
        axes.locator_params(axis="x", nbins=6)
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.grid(alpha=0.3, which="both", lw=0.4)
        legend_below(axes)
    return png(figure)


def _line_label(calibration: NoiseCalibration, dark_current_e_per_s: Estimate | None) -> str:
    if dark_current_e_per_s is None:
        return "straight line" if calibration.dark.has_slope else "mean"
    value, error = dark_current_e_per_s.value, dark_current_e_per_s.std_error
    return f"dark current {to_digits(value, error)} ± {error:.2g} e-/s"


def snr_png(calibration: NoiseCalibration) -> bytes:
    """Return the signal-to-noise ratio of a pixel against its signal, or its bound if the read noise is a bound."""
    gain, points = calibration.gain_dn_per_e.value, calibration.transfer.points
    shown = (points.signal_dn > 0.0) & (points.flat_variance_dn2 > 0.0) & ~points.saturated
    signal_e = points.signal_dn[shown] / gain
    figure, (axes,) = subplots(1, 1, size=(9.6, 4.8))
    ratio = points.signal_dn[shown] / np.sqrt(points.flat_variance_dn2[shown])
    axes.plot(signal_e, ratio, "o", ms=5, color=MEASURED, label="flats, temporal noise")
    x = np.geomspace(1.0, signal_e.max(), 300)
    _draw_expected_ratio(axes, calibration, x)
    axes.plot(x, np.sqrt(x), color=_GREY, ls=":", label="photons alone")
    _mark_limits(axes, calibration)
    axes.set(xscale="log", yscale="log", xlabel="signal [e-]", ylabel="signal over noise of a pixel")
    few_log_labels(axes.yaxis)
    axes.set_title("Signal-to-noise ratio")
    axes.set_ylim(bottom=0.05)
    # A level below an electron is dark.
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

    Above, on log axes: temporal standard deviation of a pixel, the fit, and its regimes: dark noise (slope 0), photon
    noise (slope 1/2), and the fixed pattern (slope 1), which is not temporal. Below: deviations of the variance from
    the fit, with their sampling errors, and the standard's line.
    """
    figure, _ = subplots(1, 1, size=(9.6, 7.0))
    figure.clear()
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.25))
    _draw_noise(above, calibration)
    _draw_residuals(below, calibration)
    return png(figure)


def _draw_noise(axes: Axes, calibration: NoiseCalibration) -> None:
    transfer = calibration.transfer
    points, lit = transfer.points, transfer.points.signal_dn > 0.0
    total_dn2 = points.flat_variance_dn2
    dark_dn2 = max(float(np.median(total_dn2 - points.variance_dn2)), 0.0)
    signal_dn = np.geomspace(min(points.signal_dn[lit].min() / 2.0, 2.0), points.signal_dn.max(), 300)
    fit_dn2 = dark_dn2 + transfer.variance_at(signal_dn)
    noisy = total_dn2 > 0.0
    named = np.array([level.cause is not None for level in calibration.influence])
    for chosen, marker, colour, label in (
        (transfer.used & noisy, "o", MEASURED, "flats used"),
        (~transfer.used & lit & noisy, "x", _GREY, "flats left out"),
        (named & lit & noisy, "s", "black", "flats named as wrong"),
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
    gain = calibration.gain_dn_per_e
    label = f"fit: gain {gain.value:.4g} ± {gain.std_error:.2g} DN/e- at zero signal"
    axes.plot(signal_dn[rising], np.sqrt(fit_dn2[rising]), color=PREDICTED, label=label)
    _draw_regimes(axes, calibration, signal_dn, dark_dn=float(np.sqrt(dark_dn2)))
    axes.set(xscale="log", yscale="log", ylabel="temporal noise of a pixel [DN]", title="Photon transfer")
    few_log_labels(axes.yaxis)
    axes.set_xlim(_left_dn(calibration), 1.3 * float(points.signal_dn.max()))
    axes.set_ylim(bottom=0.3 * np.sqrt(max(dark_dn2, 1.0 / 12.0)))
    axes.grid(alpha=0.3, which="both", lw=0.4)
    legend_beside(axes)


def _left_dn(calibration: NoiseCalibration) -> float:
    """Return the start of the axis: below the faintest point whose photon noise is known."""
    points, used = calibration.transfer.points, calibration.transfer.used
    relative = points.std_error_dn2[used] / calibration.transfer.variance_at(points.signal_dn[used])
    known = np.abs(relative) < max(_KNOWN * float(np.median(np.abs(relative))), _LEAST_KNOWN)
    return float(points.signal_dn[used][known].min()) / 5.0


def _draw_regimes(axes: Axes, calibration: NoiseCalibration, signal_dn: FloatArray, *, dark_dn: float) -> None:
    gain = calibration.gain_dn_per_e.value
    if calibration.darks:
        label = f"dark noise, slope 0: {dark_dn:.3g} DN"
        axes.plot(signal_dn, np.full_like(signal_dn, dark_dn), color=_GREY, ls=":", lw=1.2, label=label)
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


_TITLES = {
    "gain_dn_per_e": "gain [DN per electron]",
    "read_noise_e": "read noise [electrons]",
    "dark_current_e_per_s": "dark current [electrons/s]",
    "offset_deg": "axis: offset of the polarizer [deg]",
}
_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple", "tab:brown", "tab:cyan")


def history_png(histories: Sequence[History]) -> bytes:
    """Return the picture: one panel per quantity, one colour per device, points outside the limits ringed in red."""
    from matplotlib.figure import Figure

    quantities = [name for name in _TITLES if any(one.quantity == name for one in histories)]
    figure = Figure(figsize=(9.0, 2.6 * len(quantities) + 0.6), layout="constrained")
    panels = figure.subplots(len(quantities), 1, sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(panels, quantities, strict=True):
        of_quantity = [one for one in histories if one.quantity == quantity]
        for place, one in enumerate(of_quantity):
            _draw(axes, one, _COLOURS[place % len(_COLOURS)])
        axes.set_ylabel(_TITLES[quantity], fontsize=8)
        axes.grid(visible=True, alpha=0.3)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    panels[0].set_title("dashed: control limits by the stated errors; ringed: outside them", fontsize=8, loc="left")
    panels[-1].set_xlabel("when the frames were taken (UTC)")
    for label in panels[-1].get_xticklabels():
        label.set_rotation(20)
    return png(figure)


def _draw(axes: Axes, one: History, colour: str) -> None:
    times = np.array([utc_moment(point.utc).replace(tzinfo=None) for point in one.points], dtype="datetime64[s]")
    values = [point.value for point in one.points]
    drift = "" if one.drift_per_year is None else f"\n{one.drift_per_year:+.2g} +- {one.drift_error:.1g} a year"
    axes.errorbar(
        times, values, [point.std_error for point in one.points], fmt="o-", ms=4, lw=0.8, color=colour, capsize=2,
        label=one.device + drift,
    )  # fmt: skip
    lower, upper = zip(*(point.limits for point in one.points), strict=True)
    axes.plot(times, lower, "--", lw=0.7, color=colour)
    axes.plot(times, upper, "--", lw=0.7, color=colour)
    outside = np.array([not point.is_inside for point in one.points])
    axes.plot(times[outside], np.array(values)[outside], "o", ms=10, mfc="none", mec="tab:red")


SingleArray = NDArray[np.float32]

_SHOWN_PERCENTILES = (0.5, 99.5)
PERCENT = 100.0
# Pixels of a picture on a page; larger ones are averaged.
_WIDEST = 900
_LEAST_COUNT = 0.5
_DEFECT_COLOURS = {
    "hot": "#d55e00",
    "cold": "#0072b2",
    "bright": "#e69f00",
    "weak": "#009e73",
    "noisy": "#cc79a7",
    "jumping": "#000000",
}
_MARKERS = dict(zip(_DEFECT_COLOURS, "ov^sDx", strict=True))


def maps_png(pattern: FixedPattern) -> bytes:
    """Return pictures of dark mean, response, temporal noise and defects."""
    response = PERCENT * (pattern.flat.mean_dn - pattern.dark.mean_dn) / pattern.signal_dn
    height, width = response.shape
    figure, axes = subplots(2, 2, size=(10.8, min(max(8.4 * height / width + 1.4, 4.0), 18.0)))
    _map(figure, axes[0], pattern.dark.mean_dn, title="Dark mean", label="mean [DN]")
    _map(figure, axes[1], response, title="Response", label="signal over its mean [%]")
    _map(figure, axes[2], np.sqrt(pattern.dark.temporal_variance_dn2), title="Temporal dark noise", label="noise [DN]")
    _defects(axes[3], pattern)
    return png(figure)


def _map(figure: Figure, axes: Axes, picture: SingleArray, *, title: str, label: str) -> None:
    import cv2

    height, width = picture.shape
    scale = min(1.0, _WIDEST / width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if scale < 1.0 else picture
    low, high = np.percentile(small, _SHOWN_PERCENTILES)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    shown = axes.imshow(small, cmap="cividis", vmin=low, vmax=high, interpolation="nearest", extent=extent)
    finish_picture(figure, axes, shown, title=f"{title} (0.5 to 99.5 %)", label=label)


def _defects(axes: Axes, pattern: FixedPattern) -> None:
    mask = pattern.defects.mask
    axes.set(xlim=(-0.5, mask.shape[1] - 0.5), ylim=(mask.shape[0] - 0.5, -0.5), aspect="equal")
    for name, count in pattern.defects.counts.items():
        y, x = np.nonzero(mask & Defect[name.upper()].value)
        (shown,) = axes.plot(x, y, _MARKERS[name], ms=4, color=_DEFECT_COLOURS[name], label=f"{name}: {count}")
        shown.set_markerfacecolor("none")
    axes.set(xlabel="x [pixel]", ylabel="y [pixel]", title=f"{pattern.defects.n_defect} outlying pixels")
    if not pattern.defects.n_defect:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", va="center")
        return
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.08, 1.0), borderaxespad=0.0)


def histograms_png(pattern: FixedPattern) -> bytes:
    """Return logarithmic and accumulated histograms of the pixels' deviations from their neighbours."""
    figure, axes = subplots(2, 2, size=(10.4, 6.6))
    for column, (found, factor, what) in enumerate(
        (
            (pattern.dark_histogram, 1.0, "dark mean off that of 5 x 5 pixels [DN]"),
            (pattern.response_histogram, PERCENT, "response off that of 5 x 5 pixels [%]"),
        )
    ):
        _histogram(axes[column], found, factor, what)
        _accumulated(axes[2 + column], found, factor, what)
    return png(figure)


def _histogram(axes: Axes, found: PatternHistogram, factor: float, what: str) -> None:
    centres = factor * found.centres
    axes.step(centres, np.maximum(found.counts, _LEAST_COUNT), where="mid", color=MEASURED, lw=1.2, label="pixels")
    label = f"normal law, {factor * found.sigma:.3g} from quartiles"
    axes.plot(centres, np.maximum(found.normal_counts, 1e-3), color=PREDICTED, ls="--", label=label)
    axes.set(yscale="log", xlabel=what, ylabel="pixels in a bin", ylim=(_LEAST_COUNT, None))
    axes.grid(alpha=0.3, lw=0.4)
    legend_below(axes)


def _accumulated(axes: Axes, found: PatternHistogram, factor: float, what: str) -> None:
    share = PERCENT * found.at_least / found.counts.sum()
    axes.step(factor * found.reach, share, where="post", color=MEASURED, lw=1.2, label="pixels")
    axes.set(
        yscale="log",
        xlabel=f"|{what.partition(' [')[0]}| [{what.partition('[')[2]}",
        ylabel="pixels with at least this deviation [%]",
    )
    axes.set_ylim(0.5 * PERCENT / found.counts.sum(), 200.0)
    axes.grid(alpha=0.3, lw=0.4)


def spectrograms_png(pattern: FixedPattern) -> bytes:
    """Return the fixed pattern by spatial frequency, along rows and along columns, in the dark and with light."""
    figure, axes = subplots(2, 2, size=(10.4, 6.4))
    dark_noise_dn = float(np.sqrt(pattern.dark.temporal_variance_dn2.mean() / pattern.n_dark_frames))
    flat_noise = float(np.sqrt(pattern.flat.temporal_variance_dn2.mean() / pattern.n_flat_frames)) / pattern.signal_dn
    response_noise = float(np.hypot(flat_noise, dark_noise_dn / pattern.signal_dn))
    for place, found, factor, noise, title, unit in (
        (0, pattern.dark_rows, 1.0, dark_noise_dn, "Dark, along rows", "DN"),
        (1, pattern.dark_columns, 1.0, dark_noise_dn, "Dark, along columns", "DN"),
        (2, pattern.response_rows, PERCENT, response_noise, "Response, along rows", "%"),
        (3, pattern.response_columns, PERCENT, response_noise, "Response, along columns", "%"),
    ):
        _spectrogram(axes[place], found, factor, noise)
        axes[place].set(title=title, xlabel="frequency [cycles per pixel]", ylabel=f"amplitude [{unit}]")
    legend_of_all(figure, axes[0])
    return png(figure)


def _spectrogram(axes: Axes, found: Spectrogram, factor: float, noise: float) -> None:
    if not found.amplitude.size:
        return
    axes.semilogy(
        found.frequency_per_pixel, factor * found.amplitude, color=MEASURED, lw=0.9, label="fixed pattern and noise"
    )
    axes.axhline(factor * noise, color=PREDICTED, ls="--", lw=1.2, label="remaining temporal noise")
    axes.axhline(factor * found.median, color="0.45", ls=":", lw=1.2, label="median: independent pixels")
    axes.grid(alpha=0.3, which="both", lw=0.4)
    few_log_labels(axes.yaxis)
    axes.tick_params(axis="y", which="both", labelsize=8)


_DECIBEL = 20.0
_MADE_FOR = ("camera_model", "camera_serial", "gain_db", "pixel_format", "binning")
_NUMBERS = (
    "Left the values used by the model (best: weighted fits with the response of the sensor); right the fits of EMVA "
    "Standard 1288, Release 4.0 Linear, for comparison with data sheets. Errors are standard errors; those of the "
    "standard's numbers come from leaving out one level after the other."
)
_TRANSFER = (
    "Temporal noise against signal, with dark noise, photon noise and fixed pattern as lines; below, deviations of the "
    "variances from the fit."
)
_LINEARITY = (
    "Mean against light; below, its deviation from a straight line. Error bars are the sampling errors of the means, "
    "often smaller than a point."
)
_DARK = "Mean and variance of dark frames against exposure{}."
_DARK_CURRENT = "; slopes of both are dark current, in electrons"
_SNR = "Signal over noise of one pixel in one frame."
_MAPS = (
    "Each pixel: dark mean, response to light, dark noise, and pixels more than 6 standard deviations from the others."
)
_HISTOGRAMS = (
    "Deviations of pixels from the mean of the 5 x 5 pixels around them, on logarithmic axes; below, numbers of pixels "
    "with at least this deviation."
)
_SHEET = (
    "Not measured here, and therefore not stated: spectral responsivity, microlens angle, non-whiteness by section. "
    "Numbers without photons per pixel are left out."
)


def calibration_report(noise: NoiseCalibration, frames: FrameSet, *, created_utc: str) -> Report:
    """Return the report of a noise calibration."""
    remarks = _remarks(noise.performance)
    rows = calibration_rows(noise)
    unknown = tuple(unknown_lines(noise))
    numbers: tuple[Block, ...] = (
        first_lines(noise),
        _NUMBERS,
        calibration_table(rows),
        *((unknown,) if unknown else ()),
    )
    return Report(
        title=f"Sensor noise: {Path(frames.source.path).name}",
        source=_facts(frames.source, created_utc),
        sections=[
            Section(title="Numbers", blocks=(*numbers, tuple(remarks)) if remarks else numbers),
            Section(title="Findings in the frames", blocks=(_flags(noise.flags),)),
            *_curves(noise),
            *_pattern(noise.pattern),
            Section(
                title="EMVA 1288 summary sheet",
                blocks=(
                    Table(
                        columns=text_columns("operation point", "", left=(0, 1)),
                        rows=tuple(_sheet_facts(noise, frames)),
                    ),
                    sheet_table(rows),
                    _SHEET,
                ),
            ),
        ],
    )


def _flags(flags: tuple[Flag, ...]) -> Block:
    if not flags:
        return "No findings."
    rows = tuple((flag.name, flag.message) for flag in flags)
    return Table(columns=text_columns("finding", "meaning", left=(0, 1), wide=1), rows=rows)


def _curves(noise: NoiseCalibration) -> Iterable[Section]:
    yield _pictured("Photon transfer", photon_transfer_png(noise), _TRANSFER)
    no_curve = f" Its curve is a bound, or missing: {not_known(noise).get('read_noise_e', 'it is not known')}."
    yield _pictured("Signal-to-noise ratio", snr_png(noise), _SNR + (no_curve if noise.read_noise_e is None else ""))
    yield _pictured("Linearity", linearity_png(noise), _LINEARITY, otherwise="The light of the levels is not known.")
    caption = _DARK.format("" if noise.dark_current_e_per_s is None else _DARK_CURRENT)
    no_dark = "Exposures of the dark frames are not known." if noise.darks else "There are no dark frames."
    yield _pictured("Dark signal", dark_png(noise), caption, otherwise=no_dark)


def _pictured(title: str, png: bytes | None, caption: str, *, otherwise: str = "There is nothing to draw.") -> Section:
    """Return a section with a figure, or with words if there is nothing to draw."""
    if png is not None:
        return Section(title=title, blocks=(Picture(png=png, caption=caption),))
    return Section(title=title, blocks=(otherwise,))


def _pattern(pattern: FixedPattern | None) -> Iterable[Section]:
    blocks: tuple[Block, ...] = ("No flat is brighter than a dark level: there are no maps.",)
    if pattern is not None:
        by_frequency = "The fixed pattern by spatial frequency; independent pixels make a level line."
        blocks = (
            Picture(png=maps_png(pattern), caption=_MAPS),
            Picture(png=histograms_png(pattern), caption=_HISTOGRAMS),
            Picture(png=spectrograms_png(pattern), caption=by_frequency),
        )
    yield Section(title="Fixed pattern", blocks=blocks)


def _facts(source: FrameSource, created_utc: str) -> str:
    facts = [
        f"from {source.path}",
        f"SHA-256 over all frames {source.frames_sha256[:16]}",
        f"made {created_utc[:19]}Z by rigctl {VERSION}",
    ]
    return f"{'; '.join(facts)}."


def _remarks(best: Performance) -> list[str]:
    """Return numbers in other units, and the comparison of two estimates of the dark current."""
    found = []
    if best.dynamic_range is not None:
        found.append(f"dynamic range {_decibels_and_bits(best.dynamic_range.value)}")
    if best.snr_max is not None:
        found.append(f"largest SNR {_decibels_and_bits(best.snr_max.value)}")
    if best.dark_current_disagreement is not None:
        score = best.dark_current_disagreement
        word = (
            "consistent" if abs(score) < 3.0 else "in disagreement: the camera clamps its black level, or light got in"
        )
        found.append(f"dark current by mean and by variance are {score:+.1f} standard errors apart, {word}")
    if best.quantum_efficiency is not None:
        found.append("the error of the quantum efficiency does not include that of the stated photons")
    return found


def _decibels_and_bits(ratio: float) -> str:
    return f"{_DECIBEL * np.log10(ratio):.1f} dB, {np.log2(ratio):.1f} bits"


def _sheet_facts(noise: NoiseCalibration, source: FrameSet) -> list[tuple[str, str]]:
    made_for = source.made_for
    frames = [level.n_frames for level in (*noise.flats, *noise.darks)]
    exposures = [level.exposure_s for level in (*noise.flats, *noise.darks) if level.exposure_s is not None]
    rows, columns = noise.flats[0].shape
    pattern = _NOT_DETERMINED
    if noise.stacks is not None:
        flat, dark = noise.stacks
        pattern = f"{flat.n_frames} flats at {flat.mean_dn:.0f} DN and {dark.n_frames} darks"
    return [
        *((name.replace("_", " "), _known(getattr(made_for, name))) for name in _MADE_FOR),
        ("temperature", "not known" if made_for.temperature_c is None else f"{made_for.temperature_c:.1f} °C"),
        ("picture", f"{columns} x {rows} pixels, {source.bit_depth} bits"),
        ("levels", f"{len(noise.flats)} with light, {len(noise.darks)} dark, {sum(frames)} frames"),
        ("exposures", f"{_ms(min(exposures))} to {_ms(max(exposures))}" if exposures else "not known"),
        ("light varied by", "exposure time" if len(set(exposures)) > len(noise.darks) // 2 > 0 else "lamp"),
        ("fixed pattern from", pattern),
    ]


def _known(value: str | float | None) -> str:
    return "not known" if value is None else str(value)


def _ms(time_s: float) -> str:
    return f"{_MS_PER_S * time_s:.4g} ms"
