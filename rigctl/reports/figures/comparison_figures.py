"""Figures of a comparison: counts, laws, standard scores, uncertainty budget, and many runs."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from model.moments import Moments
from model.prediction import RegionPrediction
from model.processing import dolp
from model.processing import dolp_studies as normalized_stokes
from model.quantities import FOLLOWED, QUANTITIES, angle_of
from model.stokes import dolp as degree_of_polarization
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.rows import Row, off_prediction
from rigctl.comparison.series import SeriesPoint, mean_row
from rigctl.comparison.uncertainty_budget import FAULTS, RegionBudget
from rigctl.measurement.measurement import Measurement
from rigctl.reports.figures.figure_style import (
    MEASURED,
    PREDICTED,
    legend_beside,
    legend_of_all,
    placed_axes,
    png,
    subplots,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FloatArray = NDArray[np.float64]
Law = Callable[[FloatArray], FloatArray]

_BINS = 60
# Two pixels apart.
_LAW_POINTS = 150
# Of S0 the budget is a share of itself.
_TITLES = {name: QUANTITIES[name].label for name in FOLLOWED} | {"s0": "S0 (share of itself)"}
# Colours after Okabe and Ito, told apart by colour-blind readers; hatches tell them apart in grey. A cause has the same
# in every report.
_LOOKS = {
    "shot": ("#0072b2", ""),
    "read": ("#56b4e9", "//"),
    "fixed pattern": ("#009e73", ""),
    "texture": ("#f0e442", "xx"),
    "texture and fixed pattern": ("#f0e442", "xx"),
    "noise and texture": ("#0072b2", "\\\\"),
    "dark level": ("#999999", ""),
    "registration": ("#999999", ".."),
    FAULTS: ("#000000", "//"),
    "repeatability": ("#666666", "xx"),
    "angle": ("#e69f00", "//"),
    "drift": ("#cc79a7", ""),
    "inputs": ("#d55e00", ""),
}
# A cause below this share of the largest of a panel is not drawn to scale but at the edge.
_SHOWN_DECADES = 3.0
# Of a letter, at most.
_NAME_INCH = 0.1


def channel_bars(rows: tuple[Row, ...], *, unit: str) -> bytes:
    """Return mean and deviation of the counts by channel, predicted beside measured, as [MK14] Fig. 7."""
    regions = list(dict.fromkeys(row.region for row in rows))
    size = 3.6 * len(regions) + 0.2, 5.6
    figure, axes = placed_axes(2, len(regions), size=size, margins=(0.85, 0.1, 0.85, 0.3), apart=(0.9, 0.8))
    for column, region in enumerate(regions):
        for line, (statistic, title) in enumerate((("mean", "mean"), ("std", "deviation over pixels, one frame"))):
            ax = axes[line * len(regions) + column]
            chosen = [r for r in rows if r.region == region and r.quantity[:3] == "dn_" and r.statistic == statistic]
            _bars(ax, chosen)
            ax.set_title(f"{region}: {title}", fontsize=9)
            ax.set_xlabel("polarizer angle [deg]")
            ax.set_ylabel(f"counts above dark [{unit}]")
    legend_of_all(figure, axes[0])
    return png(figure)


def histograms(measurement: Measurement, predictions: dict[str, RegionPrediction]) -> bytes:
    """Return histograms of s1, s2 and DoLP of each region's pixels with their exact laws, as [MK14] Fig. 8."""
    names = [name for name in predictions if name in measurement.regions]
    size = 11.0, 2.9 * len(names) + 0.35
    figure, axes = placed_axes(len(names), 3, size=size, margins=(0.7, 0.1, 0.85, 0.3), apart=(0.75, 0.8))
    for line, name in enumerate(names):
        pixels, stokes = measurement.regions[name].stokes_pixels, predictions[name].stokes_dn
        lit = pixels[:, pixels[0] > 0.0]
        if not lit.size:
            continue
        step = 1.0 / float(np.median(lit[0]))
        for column, component in enumerate((1, 2)):
            ax = axes[3 * line + column]
            _histogram(ax, lit[component] / lit[0], _ratio_law(stokes, component), step=step, title=name)
            ax.set_xlabel(f"s{component} = S{component}/S0")
        _histogram(axes[3 * line + 2], degree_of_polarization(lit.T), _dolp_law(stokes), step=step, title=name)
        axes[3 * line + 2].set_xlabel("DoLP")
    legend_of_all(figure, axes[0])
    return png(figure)


def scores(comparison: Comparison) -> bytes:
    """Return every row's standard score, and which of them disagree."""
    tested = [row for row in comparison.rows if row.z is not None]
    names = list(dict.fromkeys(row.region for row in tested))
    figure, axes = subplots(1, 1, size=(11.0, 0.9 + 0.55 * len(names)))
    axes[0].axvspan(-2, 2, color="0.92", label="two standard errors")
    for agrees, colour, label in ((True, PREDICTED, "agrees"), (False, MEASURED, "disagrees")):
        chosen = [row for row in tested if row.agrees is agrees]
        heights = [names.index(row.region) for row in chosen]
        values = [row.z or 0.0 for row in chosen]
        if not chosen:
            continue
        axes[0].scatter(values, heights, s=18, c=colour, marker="o" if agrees else "x", label=label, zorder=3)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    farthest = max([5.0, *(1.3 * abs(row.z or 0.0) for row in tested)])
    axes[0].set_xscale("symlog", linthresh=5.0)
    axes[0].set_xlim(-farthest, farthest)
    axes[0].xaxis.set_major_formatter("{x:g}")
    axes[0].set_ylim(-0.6, len(names) - 0.4)
    axes[0].set_xlabel("(measured - predicted) / standard error of both")
    legend_beside(axes[0])
    return png(figure)


def _bars(ax: "Axes", rows: list[Row]) -> None:
    places = np.arange(len(rows))
    ax.bar(places - 0.2, [row.predicted for row in rows], 0.38, color=PREDICTED, label="predicted")
    ax.bar(places + 0.2, [row.measured for row in rows], 0.38, color=MEASURED, label="measured")
    both = [np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0) for row in rows]
    ax.errorbar(places + 0.2, [row.measured for row in rows], yerr=both, fmt="none", ecolor="black", capsize=3)
    ax.set_xticks(places, [angle_of(row.quantity) for row in rows])


def _histogram(ax: "Axes", values: FloatArray, law: Law, *, step: float, title: str) -> None:
    low, high = float(values.min()), float(values.max())
    density, edges = np.histogram(values, bins=_edges(low, high, step), density=True)
    # One artist; a bar each takes longer than all else of the figure.
    ax.stairs(density, edges, fill=True, color=MEASURED, alpha=0.55, label="measured pixels")
    x = np.linspace(low, high, _LAW_POINTS)
    try:
        ax.plot(x, law(x), color=PREDICTED, linewidth=1.8, label="predicted law")
    except (ValueError, ArithmeticError) as error:
        ax.annotate(f"no law: {error}", (0.02, 0.95), xycoords="axes fraction", fontsize=6, va="top", wrap=True)
    ax.set_title(title, fontsize=9)
    ax.set_ylabel("density")
    ax.locator_params(axis="x", nbins=5)


def _edges(low: float, high: float, step: float) -> FloatArray:
    """Return edges of bins that are whole multiples of one count's step wide: others make spikes that are not there."""
    width = step * max(1.0, np.ceil((high - low) / _BINS / step))
    start = np.floor(low / width) - 0.5
    return np.asarray((start + np.arange(int(np.ceil((high - low) / width)) + 3)) * width)


def _ratio_law(stokes: Moments, component: int) -> Law:
    return lambda x: normalized_stokes.distribution(x, stokes.mean, stokes.cov, component=component).density


def _dolp_law(stokes: Moments) -> Law:
    return lambda x: np.asarray(dolp.pdf(x, stokes.mean, stokes.cov))


def budget_bars(budgets: Sequence[RegionBudget]) -> bytes:
    """Return bars of the standard uncertainty by cause, a panel a quantity, a group a region.

    Causes that are too small to be seen in any panel are left out; the tables have them.
    """
    quantities = [q for q in _TITLES if any(q in found.parts for found in budgets)]
    all_causes = dict.fromkeys(cause for found in budgets for parts in found.parts.values() for cause in parts)
    causes = [cause for cause in all_causes if any(_is_seen(budgets, quantity, cause) for quantity in quantities)]
    height = 0.9 + 0.17 * len(budgets) * (len(causes) + 2)
    names = _NAME_INCH * max(len(found.region) for found in budgets) + 0.25
    lines = 0.2 * -(-(len(causes) + 1) // 5)
    size = 2.6 * len(quantities) + names, max(height, 2.4) + lines + 0.6
    margins = (names, 0.2, lines + 0.65, 0.1)
    figure, axes = placed_axes(1, len(quantities), size=size, margins=margins, apart=(0.35, 0.0))
    for ax, quantity in zip(axes, quantities, strict=True):
        _panel(ax, budgets, quantity, causes)
    axes[0].set_yticks(
        [_place(k, len(causes) / 2, causes) for k in range(len(budgets))], [found.region for found in budgets]
    )
    legend_of_all(figure, axes[0])
    return png(figure)


def _is_seen(budgets: Sequence[RegionBudget], quantity: str, cause: str) -> bool:
    return max(found.parts.get(quantity, {}).get(cause, 0.0) for found in budgets) > _limits(budgets, quantity)[0]


def _limits(budgets: Sequence[RegionBudget], quantity: str) -> tuple[float, float]:
    """Return the ends of a panel's axis."""
    most = float(max(np.linalg.norm(list(found.parts.get(quantity, {}).values())) for found in budgets))
    return (float(10.0 ** (np.floor(np.log10(most)) - _SHOWN_DECADES)), 3.0 * most) if most > 0.0 else (1e-12, 1e-9)


def _panel(ax: "Axes", budgets: Sequence[RegionBudget], quantity: str, causes: list[str]) -> None:
    low, high = _limits(budgets, quantity)

    def draw(place: int, values: list[float], label: str, look: tuple[str, str]) -> None:
        at = [_place(k, place, causes) for k in range(len(budgets))]
        widths = [max(value, low) - low for value in values]
        shape: dict[str, Any] = {"left": low, "color": look[0], "hatch": look[1], "edgecolor": "white"}
        ax.barh(at, widths, 0.85, linewidth=0.0, label=label, **shape)

    for place, cause in enumerate(causes, start=1):
        draw(place, [found.parts.get(quantity, {}).get(cause, 0.0) for found in budgets], cause, _LOOKS[cause])
    totals = [float(np.linalg.norm(list(found.parts.get(quantity, {}).values()))) for found in budgets]
    draw(0, totals, "all", ("black", ""))
    ax.set_xscale("log")
    ax.xaxis.set_minor_locator(NullLocator())
    # As text: powers are set as formulas, which takes longer than the rest of the panel.
    ax.xaxis.set_major_formatter(lambda value, _: f"1e{round(np.log10(value))}")
    ax.set_xlim(low, high)
    ax.invert_yaxis()
    ax.set_yticks([])
    ax.set_xlabel(f"std of {_TITLES[quantity]}", fontsize=9)
    ax.tick_params(axis="x", labelsize=8)


def _place(group: int, place: float, causes: list[str]) -> float:
    return group * (len(causes) + 2) + place


def series_figure(
    points: Sequence[SeriesPoint], at: Sequence[float], *, region: str, quantities: Sequence[str], label: str, unit: str
) -> bytes:
    """Return a figure of one region: above, both sides with their errors; below, measured less predicted."""
    shown = [q for q in quantities if all(mean_row(point, region, q) is not None for point in points)]
    figure, axes = subplots(2, max(len(shown), 1), size=(2.7 * max(len(shown), 1) + 0.4, 4.6))
    for column, quantity in enumerate(shown):
        rows = [row for row in (mean_row(point, region, quantity) for point in points) if row is not None]
        upper, lower = axes[column], axes[len(shown) + column]
        _both(upper, at, rows)
        _residuals(lower, at, rows)
        name = QUANTITIES[quantity].label + (f" [{unit}]" if quantity == "s0" else "")
        upper.set_title(f"{region}: {name}", fontsize=9)
        lower.set_xlabel(label, fontsize=9)
    axes[0].set_ylabel("mean of the region")
    axes[len(shown)].set_ylabel("measured - predicted")
    legend_of_all(figure, axes[0])
    return png(figure)


def _both(ax: "Axes", at: Sequence[float], rows: Sequence[Row]) -> None:
    order = np.argsort(at)
    x = np.asarray(at)[order]
    predicted = np.array([rows[k].predicted for k in order])
    if rows[0].quantity == "aolp_deg":
        # From 2 to 179 deg is a way of 3, not of 177.
        predicted = np.unwrap(predicted, period=180.0)
    measured = predicted + [off_prediction(rows[k], rows[k].measured) for k in order]
    error = np.array([rows[k].std_error_inputs or 0.0 for k in order])
    ax.fill_between(x, predicted - error, predicted + error, color=PREDICTED, alpha=0.2, label="its std by the inputs")
    ax.plot(x, predicted, color=PREDICTED, marker="s", markersize=4, linewidth=1.2, label="predicted")
    ax.errorbar(
        x,
        measured,
        yerr=[rows[k].std_error or 0.0 for k in order],
        fmt="o",
        markersize=4,
        color=MEASURED,
        capsize=2,
        label="measured",
    )
    ax.tick_params(labelsize=8)


def _residuals(ax: "Axes", at: Sequence[float], rows: Sequence[Row]) -> None:
    ax.axhline(0.0, color="0.5", linewidth=0.8)
    ax.errorbar(
        at,
        [off_prediction(row, row.measured) for row in rows],
        yerr=[float(np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0)) for row in rows],
        fmt="o",
        markersize=4,
        color=MEASURED,
        capsize=2,
    )
    ax.tick_params(labelsize=8)
