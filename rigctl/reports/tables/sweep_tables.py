"""A sweep as tables for the terminal, as CSV and as JSON."""

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.prediction.performance import SWEPT_RATES
from rigctl.prediction.sweep import Sweep
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.csv_rows import csv_rows

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 1
# At which the table and the plot show detection.
SHOWN_RATE = 1e-3
# More columns fit no terminal.
_MOST_PAIRS_SHOWN = 3
# What the terminal and the plot show; CSV and JSON hold everything.
_SHOWN = (("dolp_pixels", "mean", "DoLP"), ("dolp_snr", "mean", "DoLP SNR"), ("s0", "mean", "S0 DN"))


def sweep_tables(found: Sweep) -> Iterable[Table[int]]:
    """Return a table for each region: DoLP, its signal-to-noise ratio and S0, a row a value; and one of detection."""
    for region in found.regions:
        columns = [(label, found.series(region, quantity, kind)) for quantity, kind, label in _SHOWN]
        yield _table(region, found, columns)
    if 0 < len(found.pairs) <= _MOST_PAIRS_SHOWN:
        columns = [
            (f"{target} on {background}", found.detection((target, background), SHOWN_RATE))
            for target, background in found.pairs
        ]
        yield _table(f"P_D at P_FA {SHOWN_RATE:g}", found, columns)


def _table(title: str, found: Sweep, series: Sequence[tuple[str, FloatArray]]) -> Table[int]:
    columns: tuple[Column[int], ...] = (
        Column(title=found.key, text=lambda row: f"{found.values[row]:g}"),
        *(Column(title=label, text=partial(_cell, values=values)) for label, values in series),
    )
    return Table(title=title, columns=columns, rows=tuple(range(len(found.values))))


def _cell(row: int, values: FloatArray) -> str:
    return "-" if math.isnan(values[row]) else f"{values[row]:.5g}"


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
    columns: tuple[Column[int], ...] = (
        Column(key=found.key, value=lambda row: float(found.values[row])),
        *(Column(key=".".join(name), value=partial(_number, values=found.series(*name))) for name in _names(found)),
        *(
            Column(
                key=f"{pair[0]}_on_{pair[1]}.p_detection.{rate:g}",
                value=partial(_number, values=found.detection(pair, rate)),
            )
            for pair in found.pairs
            for rate in SWEPT_RATES
        ),
    )
    return csv_rows(Table(columns=columns, rows=tuple(range(len(found.values)))))


def _number(row: int, values: FloatArray) -> float:
    return float(values[row])


def _names(found: Sweep) -> Iterable[tuple[str, str, str]]:
    for region in found.regions:
        for quantity, kinds in _quantities(found, region).items():
            yield from ((region, quantity, kind) for kind in kinds)


def _quantities(found: Sweep, region: str) -> dict[str, tuple[str, ...]]:
    """Quantities and statistics that a region has at any value."""
    names: dict[str, dict[str, None]] = {}
    for step in found.quantities:
        for quantity, statistics in step[region].items():
            names.setdefault(quantity, {}).update(dict.fromkeys(statistics))
    return {quantity: tuple(kinds) for quantity, kinds in names.items()}


def _series(found: Sweep, region: str, quantity: str, kind: str) -> list[float | None]:
    return _numbers(found.series(region, quantity, kind))


def _numbers(values: FloatArray) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]
