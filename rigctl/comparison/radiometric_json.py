"""The content of a radiometric calibration, from what a panel gave."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.calibrations.made_for import made_for
from rigctl.calibrations.radiometric_file import SCHEMA_VERSION
from rigctl.comparison.panel_response import PanelResponse
from rigctl.config import sha256_of
from rigctl.measurement.measurement import Measurement
from rigctl.runs.run_folder import MANIFEST_FILE
from rigctl.utc_time import utc_text
from rigctl.version import VERSION


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
