"""Whole ROC curves as CSV and as JSON, of one prediction or of the points of a grid."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from model.prediction.region_performance import PairDetection
from rigctl.files.choices import RocKind
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.csv_rows import csv_rows

_Row = tuple[int, str, float, float, float]


def roc_json(curves: Mapping[RocKind, Sequence[PairDetection]], shape: tuple[int, ...]) -> dict[str, Any]:
    """Return curves by their kind: arrays in the order of the axes, the false alarm probabilities last.

    Parameters
    ----------
    curves : mapping
        Kind to a curve for each point, the last axis fastest.
    shape : tuple of int
        Points along each axis; empty for a single prediction.
    """
    return {kind: _kind(found, shape) for kind, found in curves.items()}


def _kind(found: Sequence[PairDetection], shape: tuple[int, ...]) -> dict[str, Any]:
    detected = np.array([one.p_detection for one in found]).reshape(*shape, -1)
    return {
        "target": found[0].target,
        "background": found[0].background,
        "p_false_alarm": found[0].p_false_alarm.tolist(),
        "p_detection": _nested(detected),
        "auc": _nested(np.array([one.auc for one in found]).reshape(shape)),
        "warnings": list(dict.fromkeys(text for one in found for text in one.warnings)),
    }


def _nested(values: Any) -> Any:
    if np.ndim(values):
        return [_nested(part) for part in values]
    return None if np.isnan(values) else float(values)


def roc_csv(curves: Mapping[RocKind, Sequence[PairDetection]]) -> bytes:
    """Return curves as CSV: a row a false alarm probability of a point; the point counts the rows of sweep.csv."""
    rows: list[_Row] = [
        (point, kind, float(rate), float(detected), one.auc)
        for kind, found in curves.items()
        for point, one in enumerate(found)
        for rate, detected in zip(one.p_false_alarm, one.p_detection, strict=True)
    ]
    columns: tuple[Column[_Row], ...] = (
        Column(key="point", value=lambda row: row[0]),
        Column(key="kind", value=lambda row: row[1]),
        Column(key="p_false_alarm", value=lambda row: row[2]),
        Column(key="p_detection", value=lambda row: row[3]),
        Column(key="auc", value=lambda row: row[4]),
    )
    return csv_rows(Table(columns=columns, rows=tuple(rows)))


def roc_table(curves: Mapping[RocKind, Sequence[PairDetection]]) -> Table[tuple[str, PairDetection]]:
    """Return the area under each curve of a single prediction, and a few of its points."""
    rows = tuple((kind, found[0]) for kind, found in curves.items())
    pair = rows[0][1]
    columns: tuple[Column[tuple[str, PairDetection]], ...] = (
        Column(title="vector", text=lambda row: row[0], left=True),
        *(Column(title=f"P_D at {rate:g}", text=_at(rate)) for rate in (1e-4, 1e-3, 1e-2, 1e-1)),
        Column(title="area", text=lambda row: f"{row[1].auc:.6g}"),
    )
    return Table(title=f"ROC of {pair.target} on {pair.background}", columns=columns, rows=rows)


def _at(rate: float) -> Any:
    return lambda row: f"{row[1].p_detection[int(np.argmin(np.abs(row[1].p_false_alarm - rate)))]:.5g}"
