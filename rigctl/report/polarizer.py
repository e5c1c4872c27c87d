"""A polarizer calibration and a rotation stage as people read them: numbers, scans, harmonics, channels, maps, page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.analyzer import SEEN_SIGMAS, false_dolp, half_turn
from rigctl.calibrations.polarizer import HARMONIC_MEANING, NO_HARMONICS, rig_lines
from rigctl.files.session_file import DEFAULT_ANGLES_DEG
from rigctl.report.document import Column, Picture, Report, Section, Table, Verbatim, text_columns
from rigctl.report.drawing import (
    MEASURED,
    legend_beside,
    png,
    subplots,
)
from rigctl.rig.characterise import SIDES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from calibration.polarimeter.analyzer import AxisFit, DataReduction, Harmonic
    from rigctl.calibrations.polarizer_scan import PolarimeterMaps, PolarizerCalibration, ScanCurve
    from rigctl.report.document import Block
    from rigctl.rig.characterise import Characterisation, Side


FloatArray = NDArray[np.float64]
_PERCENT = 100.0

_TextRow = tuple[str, ...]


def number_table(found: PolarizerCalibration) -> Table[_TextRow]:
    """Return sense, axis offset, diattenuation and extinction."""
    columns = text_columns("quantity", "value", "std error", "unit", left=(0, 3))
    return Table(columns=columns, rows=tuple(_numbers(found)))


def harmonic_table(found: PolarizerCalibration) -> Table[Harmonic]:
    """Return the residual of Malus' law by cycles a turn."""
    columns: tuple[Column[Harmonic], ...] = (
        Column(title="cycles a turn", text=lambda one: str(one.order), left=True),
        Column(title="amplitude [%]", text=lambda one: f"{100 * one.amplitude:.3f}"),
        Column(title="std error [%]", text=lambda one: f"{100 * one.std_error:.3f}"),
        Column(title="false DoLP", text=lambda one: f"{_false_dolp(one):.4f}"),
        Column(title="seen", text=lambda one: HARMONIC_MEANING[one.order] if one.is_seen else "no", left=True),
    )
    return Table(columns=columns, rows=found.harmonics)


def _false_dolp(one: Harmonic) -> float:
    return false_dolp(one, np.radians(DEFAULT_ANGLES_DEG))


def channel_table(found: PolarizerCalibration) -> Table[tuple[str, ...]]:
    """Return axis, throughput and diattenuation of each stage angle, each with its standard error."""
    error = "std error"
    columns = text_columns("stage [deg]", "axis [deg]", error, "throughput", error, "diattenuation", error)
    channels, stage_rad = found.channels, found.stage_rad
    if channels is None or stage_rad is None:
        return Table(columns=columns, rows=())
    numbers = zip(
        np.degrees(stage_rad),
        np.degrees(channels.axis_rad) % 180.0,
        np.degrees(channels.axis_error_rad),
        channels.throughput,
        channels.throughput_error,
        channels.diattenuation,
        channels.diattenuation_error,
        strict=True,
    )
    digits = (3, 4, 4, 5, 5, 5, 5)
    rows = tuple(tuple(f"{one:.{n}f}" for one, n in zip(row, digits, strict=True)) for row in numbers)
    return Table(columns=columns, rows=rows)


def region_table(regions: Mapping[str, PolarizerCalibration]) -> Table[tuple[str, PolarizerCalibration]]:
    """Return offset and diattenuation of each region by itself."""
    columns: tuple[Column[tuple[str, PolarizerCalibration]], ...] = (
        Column(title="region", text=lambda row: row[0], left=True),
        Column(title="offset [deg]", text=lambda row: _offset(row[1])[0]),
        Column(title="std error", text=lambda row: _offset(row[1])[1]),
        Column(title="diattenuation", text=lambda row: _diattenuation(row[1])[0]),
        Column(title="std error", text=lambda row: _diattenuation(row[1])[1]),
    )
    return Table(columns=columns, rows=tuple(regions.items()))


def matrix_table(reduction: DataReduction) -> Table[_TextRow]:
    """Return the data reduction matrix, its values with their errors."""
    rows = tuple(
        (name, *(f"{value:+.5f} ± {error:.5f}" for value, error in zip(values, errors, strict=True)))
        for name, values, errors in zip(("S0", "S1", "S2"), reduction.matrix, reduction.std_error, strict=True)
    )
    return Table(columns=text_columns(*[""] * len(rows[0])), rows=rows)


def _numbers(found: PolarizerCalibration) -> Iterable[_TextRow]:
    yield "sense of rotation", f"{found.axis.best.sense:+d}", "", ""
    yield "axis offset", *_offset(found), "deg"
    if found.diattenuation is not None and found.diattenuation_error is not None:
        yield "diattenuation", *_diattenuation(found), ""
    if found.extinction is not None:
        extinction = found.extinction
        upper = "no upper limit" if extinction.upper is None else f"{extinction.upper:.4g}"
        ratio = "not measured" if extinction.ratio is None else f"{extinction.ratio:.4g}"
        yield "extinction ratio", ratio, f"95 %: {extinction.lower:.4g} to {upper}", ""


def _offset(found: PolarizerCalibration) -> tuple[str, str]:
    best = found.axis.best
    return f"{np.degrees(best.offset_rad):.4f}", f"{np.degrees(best.std_error_rad):.4f}"


def _diattenuation(found: PolarizerCalibration) -> tuple[str, str]:
    if found.diattenuation is None or found.diattenuation_error is None:
        return "not measured", ""
    return f"{found.diattenuation:.5f}", f"{found.diattenuation_error:.5f}"


# Colours that a colour-blind reader tells apart (Okabe and Ito), and markers that differ too.
_STYLES = (
    ("#0072b2", "o"),
    ("#d55e00", "s"),
    ("#009e73", "^"),
    ("#cc79a7", "D"),
    ("#000000", "v"),
    ("#e69f00", "P"),
)
# Share of the blocks that a map's colours leave out at either end.
_BEYOND = 1.0
# Two colours that a colour-blind reader tells apart, and that differ in grey.
_STAGE_COLOURS: dict[Side, str] = {"forward": "#0b3c6f", "backward": "#d1701a"}
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
    """Return the harmonics of the residual; None where no scan determines them."""
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


def polarimeter_maps_png(maps: PolarimeterMaps) -> bytes:
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
    from matplotlib.figure import Figure

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


def _draw_errors(axes: Axes, result: Characterisation, side: Side) -> None:
    chosen = [visit for visit in result.visits if visit.side == side]
    angles, errors = [visit.angle_deg for visit in chosen], [visit.error_deg for visit in chosen]
    marker = ">" if side == "forward" else "<"
    axes.plot(angles, errors, marker, ms=5, color=_STAGE_COLOURS[side], label=side, alpha=0.7)


def _draw_settling(axes: Axes, result: Characterisation, side: Side) -> None:
    for visit in result.visits:
        if visit.side == side:
            times, offs = zip(*visit.watched, strict=True)
            axes.plot(times, offs, lw=0.8, color=_STAGE_COLOURS[side], alpha=0.6)


_CONVENTION = (
    "polarizer angle = sense · stage angle + offset, counter-clockwise as the camera sees the scene. For the rig file:"
)
_SCANS = (
    "Light against the angle of the turned element, with Malus' law fitted to it; below, the residual of the law in "
    "per cent of the mean."
)
_HARMONICS = (
    "Amplitude by cycles a turn, each over the mean: of noise alone it is above the mark once in a thousand. One, "
    "three and five cycles are a wedge or a tilted element, four and six the polarizer or a detector not linear. "
    "The false DoLP is what frames at 0, 45, 90 and 135 deg give to unpolarized light at most."
)
_CHANNELS = (
    "Each stage angle by itself: response to unpolarized light over the mean, diattenuation, and how far the axis is "
    "from the common line. Bars are standard errors."
)


def polarizer_report(
    found: PolarizerCalibration,
    file: Mapping[str, Any],
    *,
    regions: Mapping[str, PolarizerCalibration],
    maps: PolarimeterMaps | None,
) -> Report:
    """Return the report of a polarizer calibration."""
    axis = (number_table(found), _CONVENTION, Verbatim(rig_lines(found)))
    return Report(
        title=f"Polarizer: {', '.join(source['path'] for source in file['source'])}",
        source=_polarizer_facts(file),
        sections=[
            Section(title="Axis and extinction", blocks=axis),
            Section(title="Scans", blocks=(Picture(png=curves_png(found), caption=_SCANS),)),
            Section(title="Residual of Malus' law", blocks=tuple(_left(found))),
            *_channels_section(found),
            *_reduction(found.reduction),
            *([Section(title="Regions", blocks=(region_table(regions),))] if regions else []),
            *_maps(maps),
        ],
    )


def _left(found: PolarizerCalibration) -> Iterable[Block]:
    drawn = harmonics_png(found)
    if drawn is None:
        yield f"{NO_HARMONICS[0].upper()}{NO_HARMONICS[1:]}."
    else:
        yield Picture(png=drawn, caption=_HARMONICS)
        yield harmonic_table(found)


def _channels_section(found: PolarizerCalibration) -> Iterable[Section]:
    if (drawn := channels_png(found)) is not None:
        blocks = (Picture(png=drawn, caption=_CHANNELS), channel_table(found))
        yield Section(title="Each stage angle", blocks=blocks)


def _reduction(reduction: DataReduction | None) -> Iterable[Section]:
    if reduction is not None:
        singular = ", ".join(f"{value:.4g}" for value in reduction.singular_values)
        text = (
            f"Stokes parameters = W · (counts over twice their mean), measured with known states; singular values "
            f"{singular}, of which three are kept; condition {reduction.condition:.3f}."
        )
        yield Section(title="Data reduction matrix", blocks=(text, matrix_table(reduction)))


def _maps(maps: PolarimeterMaps | None) -> Iterable[Section]:
    if maps is not None:
        picture = Picture(png=polarimeter_maps_png(maps), caption=_maps_caption(maps))
        yield Section(title="Over the picture", blocks=(picture,))


def _polarizer_facts(file: Mapping[str, Any]) -> str:
    made = file["made_for"]
    known = [(what, made[f"{what}_model"], made[f"{what}_serial"]) for what in ("camera", "stage")]
    devices = [
        f"{what} {model or ''} {serial}".replace("  ", " ") for what, model, serial in known if serial is not None
    ]
    facts = [
        *devices,
        f"{file['frames']} frames",
        f"manifest {', '.join(source['sha256'][:16] for source in file['source'])}",
        f"made {file['created_utc'][:19]}Z by {file['created_by']}",
    ]
    return f"{'; '.join(facts)}."


def _maps_caption(maps: PolarimeterMaps) -> str:
    side, left_out = maps.side_pixels, int((~maps.lit).sum())
    beside = f" {left_out} blocks are left out: dark or saturated." if left_out else ""
    return (
        f"Blocks of {side} x {side} pixels, each fitted by itself. Throughput is over its mean over the angles, so "
        f"that uneven light drops out; the axis is shown less its mean over the picture.{beside}"
    )
