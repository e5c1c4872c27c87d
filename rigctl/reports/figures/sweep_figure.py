"""A sweep as a plot: curves over one number, maps over two."""

from collections.abc import Iterable, Sequence
from itertools import cycle
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rigctl.files.choices import SnrKind
from rigctl.prediction.sweep import Sweep
from rigctl.reports.figures.figure_style import LINE_STYLES, png, subplots
from rigctl.reports.tables.sweep_tables import SHOWN_RATE, shown_snr, warning_lines

FloatArray = NDArray[np.float64]

# Words under a plot: more of them stand in table, CSV and JSON.
_MOST_LINES, _LINE_LENGTH = 4, 150
# More numbers than these make no plot.
MOST_AXES = 2


def sweep_png(found: Sweep, *, snr: SnrKind = "exact", remarks: Sequence[str] = ()) -> bytes:
    """Return DoLP with its deviation, DoLP SNR and detection of all regions over what was swept.

    Over two numbers, the most that there may be, these are maps.
    """
    figure = _maps(found, snr) if len(found.axes) == MOST_AXES else _curves(found, snr)
    _say_beneath(figure, [*warning_lines(found), *remarks])
    return png(figure)


def _curves(found: Sweep, snr: SnrKind) -> Figure:
    panels = 3 if found.pairs else 2
    figure, axes = subplots(1, panels, size=(5.0 * panels, 4.6))
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
        axes[2].legend(fontsize=8)
    for ax in axes:
        ax.set_xlabel(found.key)
        ax.set_ylim(bottom=0.0)
    if found.pairs:
        axes[2].set_ylim(0.0, 1.05)
    ratio.legend(fontsize=8)
    return figure


def _snr_label(snr: SnrKind) -> str:
    return {"exact": "DoLP SNR of the exact law", "first-order": "DoLP SNR, first order"}.get(snr, "DoLP SNR")


def _mark(ax: Axes, found: Sweep, region: str, values: FloatArray) -> None:
    """Ring the points of a region of which there is something to be said."""
    warned = sorted({one.index[0] for one in found.warnings if one.message.startswith(f"{region}: ")})
    if warned:
        ax.plot(found.values[warned], values[warned], "o", color="#b00000", markersize=9, fillstyle="none")


def _maps(found: Sweep, snr: SnrKind) -> Figure:
    panels = list(_map_panels(found, snr))
    columns = 2 if len(panels) <= 4 else 3
    rows = -(-len(panels) // columns)
    figure, axes = subplots(rows, columns, size=(5.4 * columns, 4.0 * rows + 0.6))
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    first, second = found.axes
    for ax, (title, values) in zip(axes, panels, strict=False):
        norm = Normalize(0.0, 1.0 if title.startswith("P_D") else float(np.nanmax(values, initial=1e-12)))
        shown = ax.pcolormesh(second.values, first.values, values, shading="nearest", cmap="viridis", norm=norm)
        ax.set_title(title, fontsize=9)
        ax.set_xlabel(second.key)
        ax.set_ylabel(first.key)
        figure.colorbar(shown, ax=ax, shrink=0.85)
    return figure


def _map_panels(found: Sweep, snr: SnrKind) -> Iterable[tuple[str, FloatArray]]:
    for region in found.regions:
        yield f"{region}: mean DoLP of pixels", found.series(region, "dolp_pixels", "mean")
        for quantity, kind, label in shown_snr(snr):
            yield f"{region}: {label}", found.series(region, quantity, kind)
    for pair in found.pairs:
        yield f"P_D at P_FA {SHOWN_RATE:g}: {pair[0]} on {pair[1]}", found.detection(pair, SHOWN_RATE)


def _say_beneath(figure: Figure, lines: Sequence[str]) -> None:
    if not lines:
        return
    more = len(lines) - _MOST_LINES
    shown = [*lines[:_MOST_LINES], *([f"... and {more} more: see sweep.json"] if more > 0 else [])]
    text = "\n".join(fill(line, int(_LINE_LENGTH * figure.get_figwidth() / 15.0)) for line in shown)
    figure.supxlabel(text, fontsize=7, x=0.01, ha="left")
