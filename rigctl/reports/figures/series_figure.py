"""Both sides of many runs against time or sun, and their residuals."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from model.prediction.quantity_table import QUANTITIES
from rigctl.comparison.rows import Row, off_prediction
from rigctl.comparison.series import SeriesPoint, mean_row
from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, png, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
    return png(figure)


def _both(ax: "Axes", at: Sequence[float], rows: Sequence[Row]) -> None:
    order = np.argsort(at)
    x = np.asarray(at)[order]
    predicted = np.array([rows[k].predicted for k in order])
    error = np.array([rows[k].std_error_inputs or 0.0 for k in order])
    ax.fill_between(x, predicted - error, predicted + error, color=PREDICTED, alpha=0.2, label="its std by the inputs")
    ax.plot(x, predicted, color=PREDICTED, marker="s", markersize=4, linewidth=1.2, label="predicted")
    ax.errorbar(
        at,
        [row.measured for row in rows],
        yerr=[row.std_error or 0.0 for row in rows],
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
