"""The files of tradeoffs: of accuracy against time of the computation, and against time of the session."""

import json
from pathlib import Path

from rigctl.comparison.accuracy_curves import Curves
from rigctl.comparison.acquisition_tradeoff import AcquisitionTradeoff
from rigctl.durable_file import write_durably
from rigctl.reports.figures.acquisition_figure import tradeoff_picture
from rigctl.reports.tables.acquisition_tables import tradeoff_csv, tradeoff_json
from rigctl.reports.tables.tradeoff_tables import curve_csv, curve_json, curve_png


def write_accuracy_tradeoff(curves: Curves, out: Path) -> None:
    """Write tradeoff.csv, tradeoff.json and tradeoff.png."""
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "tradeoff.csv", curve_csv(curves))
    write_durably(out / "tradeoff.json", (json.dumps(curve_json(curves), allow_nan=False) + "\n").encode())
    write_durably(out / "tradeoff.png", curve_png(curves))


def write_acquisition_tradeoff(found: AcquisitionTradeoff, out: Path) -> None:
    """Write acquisition.csv, acquisition.json and acquisition.png."""
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "acquisition.csv", tradeoff_csv(found))
    write_durably(out / "acquisition.json", (json.dumps(tradeoff_json(found), allow_nan=False) + "\n").encode())
    write_durably(out / "acquisition.png", tradeoff_picture(found))
