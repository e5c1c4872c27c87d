"""The file that a radiometric calibration is kept in: ``radiometric.json``."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from rigctl.calibrations.content_file import read_content
from rigctl.calibrations.fitness import require_fit
from rigctl.calibrations.made_for import MadeFor, made_for, read_made_for
from rigctl.comparison.panel_response import PanelResponse
from rigctl.config import sha256_of
from rigctl.measurement.measurement import Measurement
from rigctl.runs.run_folder import MANIFEST_FILE
from rigctl.utc_time import utc_text
from rigctl.version import VERSION

SCHEMA_VERSION = 1
# For how long it is trusted where it does not say so itself: lenses and filters gather dust. A choice.
VALID_DAYS = 90.0


def radiometric_json(
    found: PanelResponse,
    measurement: Measurement,
    *,
    files: Mapping[str, Path],
    valid_days: float | None = None,
    utc_ns: Callable[[], int] = time.time_ns,
) -> dict[str, Any]:
    """Return the content of the file.

    Parameters
    ----------
    found : PanelResponse
        The calibration.
    measurement : Measurement
        What it was made from.
    files : mapping
        What else it was made from, such as {"scene": path}.
    valid_days : float or None
        For how long it holds; None leaves that to whoever reads it.
    utc_ns : callable
        The clock that dates it [ns].
    """
    run, records = measurement.run, [record for cycle in measurement.grid.records for record in cycle]
    frames = len(records)
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "radiometric",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(utc_ns()),
        "source": {"run": {"path": str(run.path), "sha256": sha256_of(run.path / MANIFEST_FILE)}}
        | {what: {"path": str(path), "sha256": sha256_of(path)} for what, path in files.items()},
        "made_for": made_for(run, records).as_json() | {"valid_days": valid_days},
        "panel": {
            "name": found.panel,
            "pixels": found.pixels,
            "radiance_w_per_m2_sr": {"value": found.radiance, "std_error": found.radiance_error},
        },
        "exposure_s": found.exposure_s,
        "f_number": found.f_number,
        "response": "counts of a pixel and frame per W m-2 sr-1 of unpolarized light in band, dark level off",
        "response_dn_per_radiance": _response(found, found.scale.common, found.scale.common_error, frames),
        "channels": [
            {
                "name": name,
                "polarizer_angle_deg": float(np.degrees(angle)) % 180.0,
                "response_dn_per_radiance": _response(found, ratio, error, frames // len(found.channel_names)),
            }
            for name, angle, ratio, error in zip(
                found.channel_names,
                found.polarizer_angles_rad.tolist(),
                found.scale.channel.tolist(),
                found.scale.channel_error.tolist(),
                strict=True,
            )
        ],
        "channels_agree": found.scale.channels_agree,
        "over_scene_file": {"value": found.scale.common, "std_error": found.scale.common_error},
        "variance_shares": found.shares,
        "remarks": list(found.remarks),
    }


def _response(found: PanelResponse, ratio: float, error: float, frames: int) -> dict[str, Any]:
    unit = found.modelled_dn_per_radiance
    return {"value": ratio * unit, "std_error": error * unit, "n": frames}


def read_radiometric_file(path: Path) -> dict[str, Any]:
    """Return the content of a radiometric calibration, once all that the program uses has been found right.

    Raises
    ------
    DataError
        The file cannot be read, is no radiometric calibration, or is of another version: every problem at once.
    """
    return read_content(path, _Content, made_by="a radiometric calibration is made by `rigctl calibrate radiometric`")


def require_radiometric_fits(content: Mapping[str, Any], used: MadeFor) -> tuple[str, ...]:
    """Return what is doubtful about using a radiometric calibration for frames, in words.

    Raises
    ------
    DataError
        It is of another camera, gain, bit depth or binning.
    """
    return require_fit("radiometric calibration", read_made_for(content, valid_days=VALID_DAYS), used)


class _Part(BaseModel):
    # Keys that are not known are for those who put them there.
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Response(_Part):
    value: Annotated[float, Field(gt=0)]
    std_error: Annotated[float, Field(ge=0)]
    n: Annotated[int, Field(ge=1)]


class _Content(_Part):
    schema_version: Annotated[int, Field(ge=SCHEMA_VERSION, le=SCHEMA_VERSION)]
    kind: Literal["radiometric"]
    made_for: MadeFor
    exposure_s: Annotated[float, Field(gt=0)]
    f_number: Annotated[float, Field(gt=0)]
    response_dn_per_radiance: _Response
