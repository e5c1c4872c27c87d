"""Writes the Stokes parameters of a run: FITS for programs, pictures for people, JSON for the regions."""

import io
import json
from pathlib import Path

import numpy as np
from astropy.io import fits
from numpy.typing import NDArray

from model.processing.reconstruction import reconstruct
from model.stokes import aolp_rad
from rigctl.durable_file import write_durably
from rigctl.files.regions import Region
from rigctl.measurement.measurement import Measurement
from rigctl.reports import figures
from rigctl.reports.tables_json import measurement_json
from rigctl.version import VERSION


def write_stokes(measurement: Measurement, regions: list[Region], out: Path) -> tuple[str, ...]:
    """Write all that a measurement gives into a folder; return the names of the files.

    Parameters
    ----------
    measurement : Measurement
        What to write.
    regions : list of Region
        Drawn on the pictures.
    out : Path
        Folder; made where it is not there. Files of the same name are replaced.
    """
    out.mkdir(parents=True, exist_ok=True)
    stokes = reconstruct(measurement.plan, measurement.channels)
    unit = measurement.grid.unit
    contents = {
        "stokes.fits": _fits(stokes, unit=unit, what="S0, S1, S2; S1 = horizontal - vertical, S2 = +45 - (-45)"),
        "dolp.fits": _fits(figures.dolp_image(measurement, stokes), unit="", what="DoLP; NaN where it has no meaning"),
        "aolp.fits": _fits(
            np.rad2deg(aolp_rad(np.moveaxis(stokes, 0, -1))), unit="deg", what="AoLP, counter-clockwise, in [0, 180)"
        ),
        "saturated.fits": _fits(measurement.saturated.astype(np.uint8), unit="", what="1: saturated in some frame"),
        "missing.fits": _fits(measurement.missing.astype(np.uint8), unit="", what="1: missing in some frame"),
        "pictures.png": figures.scene_pictures(measurement, regions),
        "aolp.png": figures.aolp_picture(measurement),
        "stokes.json": (json.dumps(measurement_json(measurement), indent=2, allow_nan=False) + "\n").encode(),
    }
    for name, data in contents.items():
        write_durably(out / name, data)
    return tuple(contents)


def _fits(image: NDArray[np.generic], *, unit: str, what: str) -> bytes:
    hdu = fits.PrimaryHDU(image)
    hdu.header["BUNIT"] = (unit, "unit of the samples")
    hdu.header["ROWORDER"] = ("TOP-DOWN", "first row is the top of the picture")
    hdu.header["CONTENT"] = what
    hdu.header["SWVER"] = f"rigctl {VERSION}"
    buffer = io.BytesIO()
    hdu.writeto(buffer, checksum=True)
    return buffer.getvalue()
