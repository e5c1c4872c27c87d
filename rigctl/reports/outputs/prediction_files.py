"""The files of predictions without a run: of one scene, of a sweep, of tradeoffs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from model.prediction import PairDetection, RegionPrediction
from rigctl.console.json_text import Json
from rigctl.files.choices import RocKind, SnrKind
from rigctl.prediction.accuracy_curves import Curves
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff
from rigctl.prediction.sweep import Sweep
from rigctl.reports.figures.detection_figures import roc_png
from rigctl.reports.figures.prediction_figures import MOST_AXES, counts_png, laws_png, sweep_png
from rigctl.reports.figures.tradeoff_figures import curve_png, digits_png, tradeoff_picture
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.accuracy_tables import curve_json, curve_table
from rigctl.reports.tables.acquisition_tables import tradeoff_csv, tradeoff_json
from rigctl.reports.tables.detection_tables import roc_csv
from rigctl.reports.tables.sweep_tables import sweep_csv, sweep_json
from rigctl.reports.writers.data_files import csv_rows, json_file
from rigctl.reports.writers.output_folder import write_folder


@dataclass(frozen=True, kw_only=True)
class _Number:
    region: str
    quantity: str
    statistic: str
    value: float | None
    remark: str = ""


def write_prediction(
    content: Mapping[str, Json],
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


def write_sweep(found: Sweep, out: Path, *, remarks: Sequence[str], snr: SnrKind = "exact") -> tuple[str, ...]:
    """Write sweep.csv, sweep.json and sweep.png, and roc.csv and roc.png of curves; return what was written."""
    contents = {
        "sweep.csv": sweep_csv(found, remarks=remarks),
        "sweep.json": json_file(sweep_json(found, remarks=remarks)),
    }
    if len(found.axes) <= MOST_AXES:
        contents["sweep.png"] = sweep_png(found, snr=snr, remarks=remarks)
    if found.rocs:
        contents |= {"roc.csv": roc_csv(found.rocs), "roc.png": roc_png(found.rocs, _labels(found))}
    return write_folder(out, contents)


def _labels(found: Sweep) -> tuple[str, ...]:
    points: list[str] = [""]
    for axis in found.axes:
        points = [", ".join(filter(None, (text, f"{axis.key}={value:g}"))) for text in points for value in axis.values]
    return tuple(points)


def write_accuracy_tradeoff(curves: Curves, out: Path) -> None:
    """Write tradeoff.csv, tradeoff.json, tradeoff.png and digits.png."""
    contents = {
        "tradeoff.csv": csv_rows(curve_table(curves)),
        "tradeoff.json": json_file(curve_json(curves), indent=None),
        "tradeoff.png": curve_png(curves),
        "digits.png": digits_png(curves),
    }
    write_folder(out, contents)


def write_acquisition_tradeoff(found: AcquisitionTradeoff, out: Path) -> None:
    """Write acquisition.csv, acquisition.json and acquisition.png."""
    contents = {
        "acquisition.csv": tradeoff_csv(found),
        "acquisition.json": json_file(tradeoff_json(found), indent=None),
        "acquisition.png": tradeoff_picture(found),
    }
    write_folder(out, contents)
