"""A sweep as a table for the terminal, as CSV, as JSON and as a plot."""

import csv
import io
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from rigctl.comparison.sweep import P_FALSE_ALARM, Sweep

SCHEMA_VERSION = 1
# At which the table and the plot show detection.
_SHOWN_RATE = 1e-3
# More columns fit no terminal.
_MOST_PAIRS_SHOWN = 2
# What the terminal and the plot show; CSV and JSON hold everything.
_SHOWN = (("dolp_pixels", "mean", "DoLP"), ("dolp_snr", "mean", "DoLP SNR"), ("s0", "mean", "S0 DN"))


def sweep_table(found: Sweep) -> Table:
    """Return DoLP, its signal-to-noise ratio and S0 of each region, and detection of each pair, a row a value."""
    table = Table(title=f"sweep of {found.key}", title_justify="left", box=None, pad_edge=False)
    table.add_column(found.key, justify="right")
    for region in found.regions:
        for _, _, label in _SHOWN:
            table.add_column(f"{region} {label}", justify="right")
    shown = found.pairs if len(found.pairs) <= _MOST_PAIRS_SHOWN else ()
    for target, background in shown:
        table.add_column(f"P_D {target} on {background}, P_FA {_SHOWN_RATE:g}", justify="right")
    columns = [found.series(region, quantity, kind) for region in found.regions for quantity, kind, _ in _SHOWN]
    columns += [found.detection(pair, _SHOWN_RATE) for pair in shown]
    for row, value in enumerate(found.values):
        table.add_row(f"{value:g}", *("-" if math.isnan(column[row]) else f"{column[row]:.5g}" for column in columns))
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
            | {"p_detection": {f"{rate:g}": _numbers(found.detection(pair, rate)) for rate in P_FALSE_ALARM}}
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
    detected = [(pair, rate) for pair in found.pairs for rate in P_FALSE_ALARM]
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
    from rigctl.reports.figure_style import png, subplots  # half a second, wanted for plots only

    panels = 3 if found.pairs else 2
    figure, axes = subplots(1, panels, size=(5.0 * panels, 4.2))
    degree, ratio = axes[:2]
    for region in found.regions:
        mean, std = (found.series(region, "dolp_pixels", kind) for kind in ("mean", "std"))
        (line,) = degree.plot(found.values, mean, marker=".", label=region)
        degree.fill_between(found.values, mean - std, mean + std, color=line.get_color(), alpha=0.2, linewidth=0)
        ratio.plot(found.values, found.series(region, "dolp_snr", "mean"), marker=".", label=region)
    degree.set_ylabel("DoLP; band: deviation of a pixel")
    ratio.set_ylabel("DoLP SNR")
    for target, background in found.pairs:
        detected = found.detection((target, background), _SHOWN_RATE)
        axes[2].plot(found.values, detected, marker=".", label=f"{target} on {background}")
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
