"""Figures of the rig: scans of the polarizer, and how a stage turns."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import SEEN_SIGMAS, AxisFit, half_turn
from rigctl.calibrations.polarizer.polarimeter_maps import PolarimeterMaps
from rigctl.calibrations.polarizer.polarizer_calibration import PolarizerCalibration, ScanCurve
from rigctl.devices.characterise import SIDES, Characterisation, Side
from rigctl.reports.figures.figure_style import MEASURED, legend_beside, png, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FloatArray = NDArray[np.float64]

# Colours that a colour-blind reader tells apart (Okabe and Ito), and markers that differ too.
_STYLES = (
    ("#0072b2", "o"),
    ("#d55e00", "s"),
    ("#009e73", "^"),
    ("#cc79a7", "D"),
    ("#000000", "v"),
    ("#e69f00", "P"),
)
_PERCENT = 100.0
# Share of the blocks that a map's colours leave out at either end.
_BEYOND = 1.0
# Two colours that a colour-blind reader tells apart, and that differ in grey.
_COLOURS: dict[Side, str] = {"forward": "#0b3c6f", "backward": "#d1701a"}
_DOTS_PER_INCH = 150


def curves_png(found: PolarizerCalibration) -> bytes:
    """Return the scans with their fits, and what the fits leave."""
    figure, (above, below) = subplots(2, 1, size=(7.4, 6.2))
    turned = "stage" if found.channels is None else "generator"
    for (color, marker), curve in zip(_styles(len(found.curves)), found.curves, strict=True):
        _draw_curve(above, below, curve, color=color, marker=marker)
    above.set(xlabel=f"{turned} angle [deg]", ylabel="signal above dark [DN]", title="Light against angle")
    below.axhline(0.0, color="black", lw=0.8)
    below.set(xlabel=f"{turned} angle [deg]", ylabel="off the fit [% of mean]")
    figure.legend(loc="outside lower center", fontsize=8, ncols=4)
    for axes in (above, below):
        axes.grid(color="0.9")
    return png(figure)


def _styles(count: int) -> list[tuple[str, str]]:
    return [_STYLES[k % len(_STYLES)] for k in range(count)]


def _draw_curve(above: Axes, below: Axes, curve: ScanCurve, *, color: str, marker: str) -> None:
    degrees = np.degrees(curve.angle_rad)
    shown = np.linspace(curve.angle_rad.min(), curve.angle_rad.max(), 361)
    above.plot(np.degrees(shown), curve.fit.at(shown), color=color, lw=1.0)
    above.plot(degrees, curve.signal_dn, ls="", marker=marker, ms=4, color=color, label=curve.label)
    off = _PERCENT * (curve.signal_dn - curve.fit.at(curve.angle_rad)) / float(curve.fit.terms[0])
    below.plot(degrees, off, ls=":", lw=0.7, marker=marker, ms=3.5, color=color)


def harmonics_png(found: PolarizerCalibration) -> bytes | None:
    """Return the harmonics beside Malus' law; None where the angles tell none."""
    if not found.harmonics:
        return None
    figure, (axes,) = subplots(1, 1, size=(7.4, 3.0))
    places = np.arange(len(found.harmonics))
    amplitudes = _PERCENT * np.array([one.amplitude for one in found.harmonics])
    errors = _PERCENT * np.array([one.std_error for one in found.harmonics])
    colors = [MEASURED if one.is_seen else "0.7" for one in found.harmonics]
    axes.bar(places, amplitudes, yerr=errors, width=0.5, color=colors, capsize=4)
    limits = SEEN_SIGMAS * errors
    axes.hlines(limits, places - 0.32, places + 0.32, color="black", ls="--", lw=1.5, label="seen above this")
    axes.set_xticks(places, [f"{one.order} a turn" for one in found.harmonics])
    axes.set(ylabel="amplitude [% of mean]", title="Harmonics of the residual (orange: seen)")
    legend_beside(axes)
    axes.margins(x=0.25)
    axes.grid(axis="y", color="0.9")
    axes.set_axisbelow(True)
    return png(figure)


def channels_png(found: PolarizerCalibration) -> bytes | None:
    """Return throughput, diattenuation and axis of each stage angle; None without a generator."""
    channels, stage_rad = found.channels, found.stage_rad
    if channels is None or stage_rad is None:
        return None
    figure, plots = subplots(1, 3, size=(10.5, 3.2))
    drawn = (
        ("throughput over mean", channels.throughput, channels.throughput_error),
        ("diattenuation", channels.diattenuation, channels.diattenuation_error),
        (
            "axis off the common line [deg]",
            np.degrees(_off_line(channels.axis_rad, stage_rad, found.axis)),
            np.degrees(channels.axis_error_rad),
        ),
    )
    for axes, (label, values, errors) in zip(plots, drawn, strict=True):
        axes.errorbar(np.degrees(stage_rad), values, errors, fmt="o", ms=5, capsize=3, color=MEASURED)
        axes.set(xlabel="stage angle [deg]", ylabel=label)
        axes.grid(color="0.9")
    plots[2].axhline(0.0, color="black", lw=0.8)
    return png(figure)


def _off_line(axis_rad: FloatArray, stage_rad: FloatArray, axis: AxisFit) -> FloatArray:
    return half_turn(axis_rad - axis.best.sense * stage_rad - axis.best.offset_rad)


def maps_png(maps: PolarimeterMaps) -> bytes:
    """Return throughput, diattenuation and axis over the picture, a row for each stage angle."""
    channels = maps.channels
    columns = (
        ("throughput", maps.picture(channels.throughput), "over its mean"),
        ("diattenuation", maps.picture(channels.diattenuation), ""),
        ("axis off its mean", maps.picture(np.degrees(maps.axis_off_mean_rad())), "deg"),
    )
    count = len(maps.stage_rad)
    height, width = maps.lit.shape
    figure, plots = subplots(count, 3, size=(10.5, count * min(3.4, 0.7 + 2.4 * height / width)))
    for row, stage_deg in enumerate(np.degrees(maps.stage_rad)):
        for axes, (name, pictures, unit) in zip(plots[3 * row : 3 * row + 3], columns, strict=True):
            _draw_map(axes, pictures[row], maps.side_pixels, title=f"{stage_deg:.1f} deg: {name}", unit=unit)
    return png(figure)


def _draw_map(axes: Axes, picture: FloatArray, side: int, *, title: str, unit: str) -> None:
    height, width = picture.shape
    low, high = _range(picture)
    edge = -0.5
    extent = (edge, edge + width * side, edge + height * side, edge)
    shown = axes.imshow(picture, cmap="cividis", vmin=low, vmax=high, extent=extent, interpolation="nearest")
    axes.set(xlabel="x [pixel]", ylabel="y [pixel]")
    axes.set_title(title, fontsize=9)
    bar = axes.figure.colorbar(shown, ax=axes, shrink=0.75)
    bar.set_label(unit)
    bar.ax.ticklabel_format(axis="y", useOffset=False)


def _range(picture: FloatArray) -> Sequence[float]:
    """Return the limits of a map's colours: a few odd blocks do not decide them."""
    return [float(limit) for limit in np.nanpercentile(picture, [_BEYOND, 100.0 - _BEYOND])]


def characterisation_png(result: Characterisation) -> bytes:
    """Return a plot as a PNG file: above, readback errors by angle and side; below, how each visit came to rest."""
    from matplotlib.figure import Figure  # half a second, wanted for a plot only

    figure = Figure(figsize=(7.0, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1)
    for side in SIDES:
        _draw_errors(above, result, side)
        _draw_settling(below, result, side)
    title = f"{result.identity.model} {result.identity.serial_number}: backlash {result.backlash_deg:.4f} deg"
    above.set(xlabel="angle [deg]", ylabel="readback - target [deg]", title=title)
    below.axhspan(-result.band_deg, result.band_deg, color="0.9")
    below.axvline(result.settle_s, color="0.5", lw=1, label=f"at rest after {result.settle_s:.2f} s")
    below.set(xlabel="time since the end of the move [s]", ylabel="reading - rest [deg]")
    for axes in (above, below):
        axes.grid(alpha=0.3, lw=0.4)
        legend_beside(axes)
    return png(figure, dpi=_DOTS_PER_INCH)


def _draw_errors(axes: "Axes", result: Characterisation, side: Side) -> None:
    chosen = [visit for visit in result.visits if visit.side == side]
    angles, errors = [visit.angle_deg for visit in chosen], [visit.error_deg for visit in chosen]
    marker = ">" if side == "forward" else "<"
    axes.plot(angles, errors, marker, ms=5, color=_COLOURS[side], label=side, alpha=0.7)


def _draw_settling(axes: "Axes", result: Characterisation, side: Side) -> None:
    for visit in result.visits:
        if visit.side == side:
            times, offs = zip(*visit.watched, strict=True)
            axes.plot(times, offs, lw=0.8, color=_COLOURS[side], alpha=0.6)
