"""A sweep of a scene for people and programs: tables, JSON, CSV, curves and maps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.prediction.predict import SWEPT_RATES
from rigctl.report.detection import roc_json
from rigctl.report.document import Column, Table
from rigctl.report.drawing import (
    LINE_STYLES,
    legend_below,
    png,
    say_beneath,
    subplots,
)
from rigctl.report.prediction import FloatArray, shown_snr

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rigctl.console import Json
    from rigctl.files.choices import SnrKind
    from rigctl.prediction.sweep import Sweep


SWEEP_SCHEMA = 2
# False alarm rate for detection in table and plot.
SHOWN_RATE = 1e-3
# Most columns for a terminal.
_MOST_PAIRS_SHOWN = 3


def sweep_tables(found: Sweep, *, snr: SnrKind = "exact") -> Iterable[Table[int]]:
    """Return a table per region, with DoLP, its SNR and S0 in a row per point, and one of detection."""
    shown = (("dolp_pixels", "mean", "mean DoLP of pixels"), *shown_snr(snr), ("s0", "mean", "S0 DN"))
    for region in found.regions:
        columns = [(label, found.series(region, quantity, kind)) for quantity, kind, label in shown]
        yield _table(region, found, columns, about=(f"{region}: ",))
    if 0 < len(found.pairs) <= _MOST_PAIRS_SHOWN:
        names = [f"{target} on {background}" for target, background in found.pairs]
        columns = [(name, found.detection(pair, SHOWN_RATE)) for name, pair in zip(names, found.pairs, strict=True)]
        yield _table(f"P_D at P_FA {SHOWN_RATE:g}", found, columns, about=tuple(f"{name}: " for name in names))


def warning_lines(found: Sweep) -> Iterable[str]:
    """Return the warnings of a sweep, each once with its points."""
    places: dict[str, list[tuple[int, ...]]] = {}
    for index, message in found.warnings:
        places.setdefault(message, []).append(index)
    for message, indices in places.items():
        first = _point_text(found, indices[0])
        more = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
        yield f"warning at {first}{more}: {message}"


def _point_text(found: Sweep, index: tuple[int, ...]) -> str:
    return ", ".join(f"{axis.key} = {axis.values[k]:g}" for axis, k in zip(found.axes, index, strict=True))


def _table(title: str, found: Sweep, series: Sequence[tuple[str, FloatArray]], *, about: tuple[str, ...]) -> Table[int]:
    warned = {int(np.ravel_multi_index(index, found.shape)) for index, text in found.warnings if text.startswith(about)}
    columns: tuple[Column[int], ...] = (
        *_axis_columns(found),
        *(Column(title=label, text=partial(_cell, values=values.ravel())) for label, values in series),
    )
    if warned:
        # Warnings are below the tables, and marked in the rows.
        columns = (*columns, Column(title="", text=lambda row: "warning" if row in warned else "", left=True))
    return Table(title=title, columns=columns, rows=tuple(range(math.prod(found.shape))))


def _axis_columns(found: Sweep) -> Iterable[Column[int]]:
    grids = np.meshgrid(*(axis.values for axis in found.axes), indexing="ij")
    for axis, grid in zip(found.axes, grids, strict=True):
        flat = grid.ravel()
        yield Column(title=axis.key, key=axis.key, value=partial(_number, values=flat), text=_general(flat))


def _general(values: FloatArray) -> Callable[[int], str]:
    return lambda row: f"{values[row]:g}"


def _cell(row: int, values: FloatArray) -> str:
    return "-" if math.isnan(values[row]) else f"{values[row]:.5g}"


def sweep_json(found: Sweep, *, remarks: Iterable[str] = ()) -> dict[str, Json]:
    """Return a sweep as JSON: arrays in the order of the axes, null with a reason for missing numbers."""
    one = {"key": found.key, "values": found.values.tolist()} if len(found.axes) == 1 else {}
    content = {
        "schema_version": SWEEP_SCHEMA,
        **one,
        "axes": [{"key": axis.key, "values": axis.values.tolist()} for axis in found.axes],
        "regions": {
            region: {
                quantity: {kind: _numbers(found.series(region, quantity, kind)) for kind in kinds}
                for quantity, kinds in _quantities(found, region).items()
            }
            for region in found.regions
        },
        "detection": [
            {"target": pair[0], "background": pair[1]}
            | {"p_detection": {f"{rate:g}": _numbers(found.detection(pair, rate)) for rate in SWEPT_RATES}}
            for pair in found.pairs
        ],
        "warnings": [{"index": list(index), "message": message} for index, message in found.warnings],
        "reasons": [
            {"index": list(index), "number": number, "reason": reason} for index, number, reason in found.missing
        ],
        "remarks": list(remarks),
    }
    return content | ({"roc": roc_json(found.rocs, found.shape)} if found.rocs else {})


def sweep_table(found: Sweep, *, remarks: Sequence[str] = ()) -> Table[int]:
    """Return a sweep for programs, one row per point and one column per number.

    The last columns have warnings of the point, reasons for missing numbers, and remarks on all in the first row.
    """
    warnings = _by_row(found, found.warnings)
    reasons = _by_row(found, ((index, f"{number}: {reason}") for index, number, reason in found.missing))
    columns: tuple[Column[int], ...] = (
        *_axis_columns(found),
        *(
            Column(key=".".join(name), value=partial(_number, values=found.series(*name).ravel()))
            for name in _names(found)
        ),
        *(
            Column(
                key=f"{pair[0]}_on_{pair[1]}.p_detection.{rate:g}",
                value=partial(_number, values=found.detection(pair, rate).ravel()),
            )
            for pair in found.pairs
            for rate in SWEPT_RATES
        ),
        Column(key="warnings", value=lambda row: "; ".join(warnings.get(row, ()))),
        Column(key="reasons", value=lambda row: "; ".join(reasons.get(row, ()))),
        Column(key="remarks", value=lambda row: "; ".join(remarks) if row == 0 else ""),
    )
    return Table(columns=columns, rows=tuple(range(math.prod(found.shape))))


def _by_row(found: Sweep, texts: Iterable[tuple[tuple[int, ...], str]]) -> dict[int, list[str]]:
    rows: dict[int, list[str]] = {}
    for index, text in texts:
        rows.setdefault(int(np.ravel_multi_index(index, found.shape)), []).append(text)
    return rows


def _number(row: int, values: FloatArray) -> float:
    return float(values[row])


def _names(found: Sweep) -> Iterable[tuple[str, str, str]]:
    for region in found.regions:
        for quantity, kinds in _quantities(found, region).items():
            yield from ((region, quantity, kind) for kind in kinds)


def _quantities(found: Sweep, region: str) -> dict[str, tuple[str, ...]]:
    """Quantities and statistics that a region has at any point."""
    names: dict[str, dict[str, None]] = {}
    for step in found.quantities:
        for quantity, statistics in step[region].items():
            names.setdefault(quantity, {}).update(dict.fromkeys(statistics))
    return {quantity: tuple(kinds) for quantity, kinds in names.items()}


def _numbers(values: FloatArray) -> Any:
    """Return nested lists in the order of the axes, with null for missing numbers."""
    if values.ndim > 1:
        return [_numbers(part) for part in values]
    return [None if np.isnan(value) else float(value) for value in values]


# Most warnings under a plot; table, CSV and JSON have all.
_MOST_LINES = 4
_MAP_KEY = "red cross: warning; white: the number does not exist"
# A map with its bar; its margins left, right (with the bar), below and above; and room for words under all of them.
_MAP_INCH, _MAP_MARGINS, _BENEATH_INCH = (5.4, 4.0), (0.75, 1.0, 0.55, 0.35), 1.5
# Most axes of a plot.
MOST_AXES = 2


def sweep_png(found: Sweep, *, snr: SnrKind = "exact", remarks: Sequence[str] = ()) -> bytes:
    """Return plots of DoLP with its deviation, DoLP SNR and detection of all regions over the sweep.

    A sweep of two numbers gives maps.
    """
    are_maps = len(found.axes) == MOST_AXES
    figure = _maps(found, snr) if are_maps else _curves(found, snr)
    key = [_MAP_KEY] if are_maps and found.warnings else []
    say_beneath(figure, [*key, *_shortened([*warning_lines(found), *remarks])])
    return png(figure)


def _curves(found: Sweep, snr: SnrKind) -> Figure:
    panels = 3 if found.pairs else 2
    figure, axes = subplots(1, panels, size=(5.0 * panels, 5.8))
    degree, ratio = axes[:2]
    for region, style in zip(found.regions, cycle(LINE_STYLES)):
        mean, std = (found.series(region, "dolp_pixels", kind) for kind in ("mean", "std"))
        (line,) = degree.plot(found.values, mean, style, marker=".", label=region)
        degree.fill_between(found.values, mean - std, mean + std, color=line.get_color(), alpha=0.2, linewidth=0)
        _mark(degree, found, region, mean)
        for quantity, kind, label in shown_snr(snr):
            name = f"{region}, first order" if kind == "first_order" else region
            marker = "x" if "first order" in label else "."
            ratio.plot(found.values, found.series(region, quantity, kind), style, marker=marker, label=name)
    degree.set_ylabel("mean DoLP of pixels; band: deviation")
    ratio.set_ylabel(_snr_label(snr))
    for (target, background), style in zip(found.pairs, cycle(LINE_STYLES)):
        detected = found.detection((target, background), SHOWN_RATE)
        axes[2].plot(found.values, detected, style, marker=".", label=f"{target} on {background}")
        axes[2].set_ylabel(f"P_D at P_FA {SHOWN_RATE:g}")
    for ax in axes:
        ax.set_xlabel(found.key)
        ax.set_ylim(bottom=0.0)
    if found.pairs:
        axes[2].set_ylim(0.0, 1.05)
    for ax in axes[1:]:
        legend_below(ax)
    return figure


def _snr_label(snr: SnrKind) -> str:
    return {"exact": "DoLP SNR of the exact law", "first-order": "DoLP SNR, first order"}.get(snr, "DoLP SNR")


def _mark(ax: Axes, found: Sweep, region: str, values: FloatArray) -> None:
    """Ring the points of a region with warnings."""
    warned = sorted({index[0] for index, text in found.warnings if text.startswith(f"{region}: ")})
    if warned:
        ax.plot(found.values[warned], values[warned], "o", color="#b00000", markersize=9, fillstyle="none")


def _maps(found: Sweep, snr: SnrKind) -> Figure:
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    panels = list(_map_panels(found, snr))
    columns = 2 if len(panels) <= 4 else 3
    rows = -(-len(panels) // columns)
    # Fixed places in inches, because a layout engine takes longer than the drawing.
    wide, high = _MAP_INCH
    width, height = columns * wide, rows * high + _BENEATH_INCH
    left, right, below, above = _MAP_MARGINS
    figure = Figure(figsize=(width, height))
    first, second = found.axes
    for k, (title, values) in enumerate(panels):
        norm = Normalize(0.0, 1.0 if title.startswith("P_D") else float(np.nanmax(values, initial=1e-12)))
        x, y = (k % columns) * wide + left, height - (k // columns + 1) * high + below
        size = (wide - left - right, high - below - above)
        ax = figure.add_axes((x / width, y / height, size[0] / width, size[1] / height))
        shown = ax.pcolormesh(second.values, first.values, values, shading="nearest", cmap="viridis", norm=norm)
        _cross(ax, found, title)
        ax.set_title(title, fontsize=9)
        ax.set_xlabel(second.key)
        ax.set_ylabel(first.key)
        bar = figure.add_axes(((x + size[0] + 0.15) / width, y / height, 0.14 / width, size[1] / height))
        figure.colorbar(shown, cax=bar)
    return figure


def _cross(ax: Axes, found: Sweep, title: str) -> None:
    """Cross the points of a map with warnings of its regions."""
    region, _, pair = title.partition(": ")
    named = (region,) if region in found.regions else (*pair.split(" on "), pair)
    starts = tuple(f"{name}: " for name in named)
    warned = sorted({index for index, text in found.warnings if text.startswith(starts)})
    first, second = found.axes
    ax.plot([second.values[j] for _, j in warned], [first.values[i] for i, _ in warned], "x", color="#d00000", ms=4)


def _map_panels(found: Sweep, snr: SnrKind) -> Iterable[tuple[str, FloatArray]]:
    for region in found.regions:
        yield f"{region}: mean DoLP of pixels", found.series(region, "dolp_pixels", "mean")
        for quantity, kind, label in shown_snr(snr):
            yield f"{region}: {label}", found.series(region, quantity, kind)
    for pair in found.pairs:
        yield f"P_D at P_FA {SHOWN_RATE:g}: {pair[0]} on {pair[1]}", found.detection(pair, SHOWN_RATE)


def _shortened(lines: Sequence[str]) -> list[str]:
    more = len(lines) - _MOST_LINES
    return [*lines[:_MOST_LINES], *([f"... and {more} more: see sweep.json"] if more > 0 else [])]
