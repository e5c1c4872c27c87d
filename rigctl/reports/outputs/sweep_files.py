"""The files of a sweep."""

from collections.abc import Sequence
from pathlib import Path

from rigctl.files.choices import SnrKind
from rigctl.prediction.sweep import Sweep
from rigctl.reports.figures.roc_figure import roc_png
from rigctl.reports.figures.sweep_figure import MOST_AXES, sweep_png
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.tables.roc_tables import roc_csv
from rigctl.reports.tables.sweep_tables import sweep_csv, sweep_json
from rigctl.reports.writers.json_rows import json_file


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
