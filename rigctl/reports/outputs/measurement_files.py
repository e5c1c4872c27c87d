"""The files of what a run measured: Stokes parameters, and detection on them."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rigctl.console.json_text import Json
from rigctl.reports.figures.measurement_figures import aolp_picture, residual_picture, scene_pictures
from rigctl.reports.writers.data_files import fits_image, json_file
from rigctl.reports.writers.output_folder import write_folder

if TYPE_CHECKING:
    from rigctl.comparison.rx_detection import RxOnRun
    from rigctl.files.regions import Region
    from rigctl.measurement.measurement import Measurement


def write_stokes(
    measurement: "Measurement", regions: list["Region"], out: Path, *, numbers: Mapping[str, Json]
) -> tuple[str, ...]:
    """Write all that a measurement gives into a folder; return the names of the files.

    Parameters
    ----------
    measurement : Measurement
        What to write.
    regions : list of Region
        Drawn on the pictures.
    out : Path
        Folder; made where it is not there. Files of the same name are replaced.
    numbers : mapping
        What stokes.json is to hold.
    """
    images, unit = measurement.images, measurement.grid.unit
    contents = {
        "stokes.fits": fits_image(
            images.stokes, unit=unit, what="S0, S1, S2; S1 = horizontal - vertical, S2 = +45 - (-45)"
        ),
        "dolp.fits": fits_image(images.dolp, unit="", what="DoLP; NaN where it has no meaning"),
        "aolp.fits": fits_image(images.aolp_deg, unit="deg", what="AoLP, counter-clockwise, in [0, 180)"),
        "saturated.fits": fits_image(measurement.saturated.astype(np.uint8), unit="", what="1: saturated in a frame"),
        "missing.fits": fits_image(measurement.missing.astype(np.uint8), unit="", what="1: missing in a frame"),
        "pictures.png": scene_pictures(images, regions, unit=unit),
        "aolp.png": aolp_picture(images),
        **({} if images.residual is None else {"residual.png": residual_picture(images.residual)}),
        "stokes.json": json_file(numbers),
    }
    return write_folder(out, contents)


def write_detection(found: "RxOnRun", out: Path, *, background: str, target: str) -> tuple[str, ...]:
    """Write rx.fits, rx.png, roc.csv, roc.png and detection.json into a folder; return their names."""
    from rigctl.reports.figures.detection_figures import roc_plot, statistic_picture
    from rigctl.reports.tables.detection_tables import detection_json, measured_roc_table
    from rigctl.reports.writers.data_files import csv_rows

    contents = {
        "rx.fits": fits_image(found.statistic, unit="", what=f"RX statistic D against {background}; NaN: no meaning"),
        "rx.png": statistic_picture(found, background=background),
        # Lines end here as RFC 4180 has it.
        "roc.csv": csv_rows(measured_roc_table(found), line_end="\r\n"),
        "roc.png": roc_plot(found, background=background, target=target),
        "detection.json": json_file(detection_json(found, background=background, target=target)),
    }
    return write_folder(out, contents)
