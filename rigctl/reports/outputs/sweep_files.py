"""The files of a sweep."""

from collections.abc import Sequence
from pathlib import Path

from rigctl.prediction.sweep import Sweep
from rigctl.reports.figures.sweep_figure import sweep_png
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.tables.sweep_tables import sweep_csv, sweep_json
from rigctl.reports.writers.json_rows import json_file


def write_sweep(found: Sweep, out: Path, *, remarks: Sequence[str]) -> None:
    """Write sweep.csv, sweep.json and sweep.png."""
    contents = {
        "sweep.csv": sweep_csv(found),
        "sweep.json": json_file(sweep_json(found) | {"remarks": list(remarks)}),
        "sweep.png": sweep_png(found),
    }
    write_folder(out, contents)
