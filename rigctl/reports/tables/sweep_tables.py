"""A sweep as tables for the terminal, as CSV and as JSON."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.console.json_text import Json
from rigctl.files.choices import SnrKind
from rigctl.prediction.performance import SWEPT_RATES
from rigctl.prediction.sweep import Sweep
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.detection_tables import roc_json
from rigctl.reports.writers.data_files import csv_rows

FloatArray = NDArray[np.float64]

SCHEMA_VERSION = 2
# At which the table and the plot show detection.
SHOWN_RATE = 1e-3
# More columns fit no terminal.
_MOST_PAIRS_SHOWN = 3
EXACT_SNR = ("dolp_snr", "mean", "DoLP SNR")
FIRST_ORDER_SNR = ("dolp_snr", "first_order", "DoLP SNR (first order)")


def shown_snr(kind: SnrKind) -> tuple[tuple[str, str, str], ...]:
    """Return quantity, statistic and label of the DoLP SNR that tables and plots show."""
    by_kind = {"exact": (EXACT_SNR,), "first-order": (FIRST_ORDER_SNR,), "both": (EXACT_SNR, FIRST_ORDER_SNR)}
    return by_kind[kind]


def sweep_tables(found: Sweep, *, snr: SnrKind = "exact") -> Iterable[Table[int]]:
    """Return a table for each region: DoLP, its signal-to-noise ratio and S0, a row a point; and one of detection."""
    shown = (("dolp_pixels", "mean", "mean DoLP of pixels"), *shown_snr(snr), ("s0", "mean", "S0 DN"))
    for region in found.regions:
        columns = [(label, found.series(region, quantity, kind)) for quantity, kind, label in shown]
        yield _table(region, found, columns, about=(f"{region}: ",))
    if 0 < len(found.pairs) <= _MOST_PAIRS_SHOWN:
        names = [f"{target} on {background}" for target, background in found.pairs]
        columns = [(name, found.detection(pair, SHOWN_RATE)) for name, pair in zip(names, found.pairs, strict=True)]
        yield _table(f"P_D at P_FA {SHOWN_RATE:g}", found, columns, about=tuple(f"{name}: " for name in names))


def warning_lines(found: Sweep) -> Iterable[str]:
    """Return what is to be said of points of a sweep, each text once with the points that it is of."""
    places: dict[str, list[tuple[int, ...]]] = {}
    for one in found.warnings:
        places.setdefault(one.message, []).append(one.index)
    for message, indices in places.items():
        first = _point_text(found, indices[0])
        more = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
        yield f"warning at {first}{more}: {message}"


def _point_text(found: Sweep, index: tuple[int, ...]) -> str:
    return ", ".join(f"{axis.key} = {axis.values[k]:g}" for axis, k in zip(found.axes, index, strict=True))


def _table(title: str, found: Sweep, series: Sequence[tuple[str, FloatArray]], *, about: tuple[str, ...]) -> Table[int]:
    warned = {
        int(np.ravel_multi_index(one.index, found.shape)) for one in found.warnings if one.message.startswith(about)
    }
    columns: tuple[Column[int], ...] = (
        *_axis_columns(found),
        *(Column(title=label, text=partial(_cell, values=values.ravel())) for label, values in series),
    )
    if warned:
        # Words stand below the tables; a row says that there are some.
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
    """Return a sweep as JSON holds it: arrays in the order of the axes, null with a reason where there is no number."""
    one = {"key": found.key, "values": found.values.tolist()} if len(found.axes) == 1 else {}
    content = {
        "schema_version": SCHEMA_VERSION,
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
        "warnings": [{"index": list(point.index), "message": point.message} for point in found.warnings],
        "reasons": [
            {"index": list(point.index), "number": point.number, "reason": point.reason} for point in found.missing
        ],
        "remarks": list(remarks),
    }
    return content | ({"roc": roc_json(found.rocs, found.shape)} if found.rocs else {})


def sweep_csv(found: Sweep, *, remarks: Sequence[str] = ()) -> bytes:
    """Return a sweep as CSV: a row a point, a column a number; empty where it does not exist.

    The last columns hold in words what is to be said: of the point, why numbers are missing, and in the first row what
    is to be said of all.
    """
    warnings = _by_row(found, ((one.index, one.message) for one in found.warnings))
    reasons = _by_row(found, ((one.index, f"{one.number}: {one.reason}") for one in found.missing))
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
    return csv_rows(Table(columns=columns, rows=tuple(range(math.prod(found.shape)))))


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
    """Return nested lists in the order of the axes; null where there is no number."""
    if values.ndim > 1:
        return [_numbers(part) for part in values]
    return [None if np.isnan(value) else float(value) for value in values]
