"""A sweep as a table for the terminal, as CSV, as JSON and as a plot."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from rigctl.comparison.performance import SWEPT_RATES
from rigctl.comparison.sweep import Sweep

SCHEMA_VERSION = 1
# At which the table and the plot show detection.
_SHOWN_RATE = 1e-3
# More columns fit no terminal.
_MOST_PAIRS_SHOWN = 3
# What the terminal and the plot show; CSV and JSON hold everything.
_SHOWN = (("dolp_pixels", "mean", "DoLP"), ("dolp_snr", "mean", "DoLP SNR"), ("s0", "mean", "S0 DN"))


def sweep_tables(found: Sweep) -> Iterable[Table]:
    """Return a table for each region: DoLP, its signal-to-noise ratio and S0, a row a value; and one of detection."""
    for region in found.regions:
        columns = [(label, found.series(region, quantity, kind)) for quantity, kind, label in _SHOWN]
        yield _table(region, found, columns)
    if 0 < len(found.pairs) <= _MOST_PAIRS_SHOWN:
        columns = [
            (f"{target} on {background}", found.detection((target, background), _SHOWN_RATE))
            for target, background in found.pairs
        ]
        yield _table(f"P_D at P_FA {_SHOWN_RATE:g}", found, columns)


def _table(title: str, found: Sweep, columns: Sequence[tuple[str, NDArray[np.float64]]]) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column(found.key, justify="right")
    for label, _ in columns:
        table.add_column(label, justify="right")
    for row, value in enumerate(found.values):
        cells = ("-" if math.isnan(column[row]) else f"{column[row]:.5g}" for _, column in columns)
        table.add_row(f"{value:g}", *cells)
    return table


def sweep_json(found: Sweep) -> dict[str, Any]:
    """Return a sweep as JSON holds it; null where a number does not exist."""
    return {
        "schema_version": SCHEMA_VERSION,
        "key": found.key,
        "values": found.values.tolist(),
        "regions": {
            region: {
                quantity: {kind: _series(found, region, quantity, kind) for kind in kinds}
                for quantity, kinds in _quantities(found, region).items()
            }
            for region in found.regions
        },
        "detection": [
            {"target": pair[0], "background": pair[1]}
            | {"p_detection": {f"{rate:g}": _numbers(found.detection(pair, rate)) for rate in SWEPT_RATES}}
            for pair in found.pairs
        ],
    }


def sweep_csv(found: Sweep) -> bytes:
    """Return a sweep as CSV: a row a value, a column a number; empty where it does not exist."""
    columns = [
        (region, quantity, kind)
        for region in found.regions
        for quantity, kinds in _quantities(found, region).items()
        for kind in kinds
    ]
    detected = [(pair, rate) for pair in found.pairs for rate in SWEPT_RATES]
    series = [found.series(*column) for column in columns] + [found.detection(*column) for column in detected]
    names = [f"{target}_on_{background}.p_detection.{rate:g}" for (target, background), rate in detected]
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([found.key, *(".".join(column) for column in columns), *names])
    for row, value in enumerate(found.values):
        writer.writerow(
            [repr(float(value)), *("" if math.isnan(one[row]) else repr(float(one[row])) for one in series)]
        )
    return text.getvalue().encode()


def sweep_png(found: Sweep) -> bytes:
    """Return DoLP with its deviation, DoLP SNR and detection of all regions over the value that was swept."""
    # Half a second, wanted for plots only.
    from rigctl.reports.figures.figure_style import LINE_STYLES, png, subplots

    panels = 3 if found.pairs else 2
    figure, axes = subplots(1, panels, size=(5.0 * panels, 4.2))
    degree, ratio = axes[:2]
    for region, style in zip(found.regions, cycle(LINE_STYLES)):
        mean, std = (found.series(region, "dolp_pixels", kind) for kind in ("mean", "std"))
        (line,) = degree.plot(found.values, mean, style, marker=".", label=region)
        degree.fill_between(found.values, mean - std, mean + std, color=line.get_color(), alpha=0.2, linewidth=0)
        ratio.plot(found.values, found.series(region, "dolp_snr", "mean"), style, marker=".", label=region)
    degree.set_ylabel("DoLP; band: deviation of a pixel")
    ratio.set_ylabel("DoLP SNR")
    for (target, background), style in zip(found.pairs, cycle(LINE_STYLES)):
        detected = found.detection((target, background), _SHOWN_RATE)
        axes[2].plot(found.values, detected, style, marker=".", label=f"{target} on {background}")
        axes[2].set_ylabel(f"P_D at P_FA {_SHOWN_RATE:g}")
        axes[2].legend(fontsize=8)
    for ax in axes:
        ax.set_xlabel(found.key)
        ax.set_ylim(bottom=0.0)
    if found.pairs:
        axes[2].set_ylim(0.0, 1.05)
    ratio.legend(fontsize=8)
    return png(figure)


def _quantities(found: Sweep, region: str) -> dict[str, tuple[str, ...]]:
    """Quantities and statistics that a region has at any value."""
    names: dict[str, dict[str, None]] = {}
    for step in found.quantities:
        for quantity, statistics in step[region].items():
            names.setdefault(quantity, {}).update(dict.fromkeys(statistics))
    return {quantity: tuple(kinds) for quantity, kinds in names.items()}


def _series(found: Sweep, region: str, quantity: str, kind: str) -> list[float | None]:
    return _numbers(found.series(region, quantity, kind))


def _numbers(values: NDArray[np.float64]) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]
