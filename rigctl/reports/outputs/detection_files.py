"""Writes what the RX detector found: map, curves and numbers."""

from pathlib import Path

from rigctl.comparison.rx_detection import RxOnRun
from rigctl.reports.figures.detection_figures import roc_plot, statistic_picture
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.tables.detection_tables import detection_json, roc_table
from rigctl.reports.writers.csv_rows import csv_rows
from rigctl.reports.writers.fits_image import fits_image
from rigctl.reports.writers.json_rows import json_file


def write_detection(found: RxOnRun, out: Path, *, background: str, target: str) -> tuple[str, ...]:
    """Write rx.fits, rx.png, roc.csv, roc.png and detection.json into a folder; return their names."""
    contents = {
        "rx.fits": fits_image(found.statistic, unit="", what=f"RX statistic D against {background}; NaN: no meaning"),
        "rx.png": statistic_picture(found, background=background),
        # Lines end here as RFC 4180 has it.
        "roc.csv": csv_rows(roc_table(found), line_end="\r\n"),
        "roc.png": roc_plot(found, background=background, target=target),
        "detection.json": json_file(detection_json(found, background=background, target=target)),
    }
    return write_folder(out, contents)
