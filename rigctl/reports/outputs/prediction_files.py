"""The files of a prediction without a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from model.prediction.prediction import RegionPrediction
from model.prediction.region_performance import PairDetection
from rigctl.files.choices import RocKind
from rigctl.reports.figures.prediction_figures import counts_png, laws_png
from rigctl.reports.figures.roc_figure import roc_png
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.roc_tables import roc_csv
from rigctl.reports.writers.csv_rows import csv_rows
from rigctl.reports.writers.json_rows import json_file


@dataclass(frozen=True, kw_only=True)
class _Number:
    region: str
    quantity: str
    statistic: str
    value: float | None
    remark: str = ""


def write_prediction(
    content: Mapping[str, Any],
    predictions: Mapping[str, RegionPrediction],
    rocs: Mapping[RocKind, PairDetection],
    out: Path,
    *,
    remarks: Sequence[str],
) -> tuple[str, ...]:
    """Write prediction.json, prediction.csv, counts.png and laws.png, and roc.csv and roc.png of curves.

    Parameters
    ----------
    content : mapping
        Of prediction.json.
    predictions : mapping
        Region to prediction.
    rocs : mapping
        Kind to curve; empty for none.
    out : Path
        Folder.
    remarks : sequence of str
        All that is to be said, the regions' warnings among it.
    """
    warnings = [f"{name}: {text}" for name, one in predictions.items() for text in one.warnings]
    contents = {
        "prediction.json": json_file(content),
        "prediction.csv": _csv(predictions, remarks),
        "counts.png": counts_png(predictions, warnings=warnings),
        "laws.png": laws_png(predictions, warnings=warnings),
    }
    if rocs:
        curves = {kind: (one,) for kind, one in rocs.items()}
        contents |= {"roc.csv": roc_csv(curves), "roc.png": roc_png(curves)}
    return write_folder(out, contents)


def _csv(predictions: Mapping[str, RegionPrediction], remarks: Sequence[str]) -> bytes:
    """Return a row a number; then a row, without a number, for each thing that is to be said."""
    rows = [
        _Number(region=region, quantity=quantity, statistic=statistic, value=value)
        for region, one in predictions.items()
        for quantity, statistics in one.quantities.items()
        for statistic, value in statistics.items()
    ]
    rows += [_Number(region="", quantity="", statistic="", value=None, remark=text) for text in remarks]
    columns: tuple[Column[_Number], ...] = tuple(
        Column(key=key) for key in ("region", "quantity", "statistic", "value", "remark")
    )
    return csv_rows(Table(columns=columns, rows=tuple(rows)))
