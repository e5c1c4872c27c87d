"""The files of tradeoffs: of accuracy against time of the computation, and against time of the session."""

from pathlib import Path

from rigctl.prediction.accuracy_curves import Curves
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff
from rigctl.reports.figures.acquisition_figure import tradeoff_picture
from rigctl.reports.figures.tradeoff_figure import curve_png, digits_png
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.tables.acquisition_tables import tradeoff_csv, tradeoff_json
from rigctl.reports.tables.tradeoff_tables import curve_json, curve_table
from rigctl.reports.writers.csv_rows import csv_rows
from rigctl.reports.writers.json_rows import json_file


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
