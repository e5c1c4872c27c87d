"""Predictions without a run as pictures: counts, laws of s1, s2 and DoLP, and sweeps."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from model.prediction import LEAST_S0_DN, RegionPrediction
from model.processing import dolp_studies as normalized_stokes
from model.processing.dolp import pdf
from rigctl.files.choices import SnrKind
from rigctl.prediction.sweep import Sweep
from rigctl.reports.figures.figure_style import (
    LINE_STYLES,
    legend_below,
    legend_of_all,
    png,
    say_beneath,
    subplots,
)
from rigctl.reports.tables.sweep_tables import SHOWN_RATE, shown_snr, warning_lines

FloatArray = NDArray[np.float64]

_POINTS, _SPAN = 400, 5.0
# Words under a plot: more of them stand in table, CSV and JSON.
_MOST_LINES = 4
_MAP_KEY = "red cross: there is a warning of this point; white: the number does not exist"
# A map with its bar; its margins left, right (with the bar), below and above; and room for words under all of them.
_MAP_INCH, _MAP_MARGINS, _BENEATH_INCH = (5.4, 4.0), (0.75, 1.0, 0.55, 0.35), 1.5
# More numbers than these make no plot.
MOST_AXES = 2


def counts_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return mean and deviation of the counts behind each angle, as [MK14] Fig. 7 has them."""
    figure, axes = subplots(1, 2, size=(11.0, 4.4))
    for k, (name, one) in enumerate(predictions.items()):
        counts = {key: value for key, value in one.quantities.items() if key.startswith("dn_")}
        angles = [key.removeprefix("dn_") for key in counts]
        places = np.arange(len(angles)) + 0.8 * (k + 0.5) / len(predictions) - 0.4
        for ax, statistic in zip(axes, ("mean", "std"), strict=True):
            ax.bar(places, [value[statistic] for value in counts.values()], 0.8 / len(predictions), label=name)
            ax.set_xticks(np.arange(len(angles)), angles)
            ax.set_xlabel("angle of the polarizer [deg]")
    axes[0].set_ylabel("mean counts [DN]")
    axes[1].set_ylabel("deviation of the counts over pixels [DN]")
    legend_of_all(figure, axes[0], place="upper")
    say_beneath(figure, warnings)
    return png(figure)


def laws_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return the laws of s1, s2 and DoLP of single pixels, as [MK14] Fig. 8b has them, by the exact distributions."""
    figure, axes = subplots(1, 3, size=(14.0, 4.4))
    for (name, one), style in zip(predictions.items(), cycle(LINE_STYLES)):
        if not one.stokes_dn.mean[0] > LEAST_S0_DN:
            continue
        for ax, (x, density) in zip(axes, laws_of(one), strict=True):
            if x.size > 1:
                ax.plot(x, density, style, label=name)
            else:
                ax.plot(np.repeat(x, 2), (0.0, 1.0), style, label=name, transform=ax.get_xaxis_transform())
    for ax, label in zip(axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
    legend_of_all(figure, axes[0], place="upper")
    say_beneath(figure, warnings)
    return png(figure)


def laws_of(one: RegionPrediction) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return abscissa and density of s1, s2 and DoLP of a region's pixels; its S0 is above 0.

    A number that does not fluctuate has no density: its abscissa is the one value that it has.
    """
    mean, cov = one.stokes_dn.mean, one.stokes_dn.cov

    def ratio(x: FloatArray, component: int) -> FloatArray:
        return normalized_stokes.distribution(x, mean, cov, component=component).density

    found = []
    for component, name in ((1, "s1n"), (2, "s2n")):
        value, std = one.quantities[name]["mean"], one.quantities[name]["std"]
        limits = (value - _SPAN * std, value + _SPAN * std)
        found.append(_law(partial(ratio, component=component), limits, value))
    return (*found, _law(lambda x: pdf(x, mean, cov), _dolp_limits(one), one.quantities["dolp"]["mean"]))


def _law(
    density: Callable[[FloatArray], FloatArray], limits: tuple[float, float], value: float
) -> tuple[FloatArray, FloatArray]:
    x = np.linspace(*limits, _POINTS)
    alone = np.array([value]), np.array([np.inf])
    if not limits[0] < limits[1]:
        return alone
    try:
        return x, density(x)
    except ValueError:
        return alone


def _dolp_limits(one: RegionPrediction) -> tuple[float, float]:
    mean, std = one.quantities["dolp"]["mean"], max(one.quantities["s1n"]["std"], one.quantities["s2n"]["std"])
    return max(mean - _SPAN * std, 0.0), mean + _SPAN * std


def sweep_png(found: Sweep, *, snr: SnrKind = "exact", remarks: Sequence[str] = ()) -> bytes:
    """Return DoLP with its deviation, DoLP SNR and detection of all regions over what was swept.

    Over two numbers, the most that there may be, these are maps.
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
    """Ring the points of a region of which there is something to be said."""
    warned = sorted({one.index[0] for one in found.warnings if one.message.startswith(f"{region}: ")})
    if warned:
        ax.plot(found.values[warned], values[warned], "o", color="#b00000", markersize=9, fillstyle="none")


def _maps(found: Sweep, snr: SnrKind) -> Figure:
    panels = list(_map_panels(found, snr))
    columns = 2 if len(panels) <= 4 else 3
    rows = -(-len(panels) // columns)
    # Places are counted out, in inches: a layout engine takes longer than the drawing.
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
    """Cross the points of a map of whose region, or regions, there is something to be said."""
    region, _, pair = title.partition(": ")
    named = (region,) if region in found.regions else (*pair.split(" on "), pair)
    starts = tuple(f"{name}: " for name in named)
    warned = sorted({one.index for one in found.warnings if one.message.startswith(starts)})
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
