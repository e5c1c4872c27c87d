"""Writes the Stokes parameters of a run: FITS for programs, pictures for people, JSON for the regions."""

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.files.regions import Region
from rigctl.measurement.measurement import Measurement
from rigctl.reports.figures import comparison_figures
from rigctl.reports.outputs.folder import write_folder
from rigctl.reports.writers.fits_image import fits_image
from rigctl.reports.writers.json_rows import json_file


def write_stokes(
    measurement: Measurement, regions: list[Region], out: Path, *, numbers: dict[str, Any]
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
    numbers : dict
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
        "pictures.png": comparison_figures.scene_pictures(images, regions, unit=unit),
        "aolp.png": comparison_figures.aolp_picture(images),
        **({} if images.residual is None else {"residual.png": comparison_figures.residual_picture(images.residual)}),
        "stokes.json": json_file(numbers),
    }
    return write_folder(out, contents)
