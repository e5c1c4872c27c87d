"""Calibrating radiometrically: a run of a panel of known reflectance in; counts per unit of radiance out."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.calibrations.content_file import write_content
from rigctl.calibrations.made_for import made_for
from rigctl.calibrations.noise.noise_file import read_fitting_noise
from rigctl.calibrations.radiometric_file import SCHEMA_VERSION
from rigctl.comparison.panel_response import PanelResponse, panel_response
from rigctl.config import sha256_of
from rigctl.files.scene_file import load_scene
from rigctl.measurement.measurement import Measurement, measure
from rigctl.runs.run_folder import MANIFEST_FILE, read_run
from rigctl.utc_time import utc_text
from rigctl.version import VERSION


@dataclass(frozen=True, kw_only=True)
class RadiometricRequest:
    """The run, its panel, and what is to be written.

    Attributes
    ----------
    run : Path
        Run folder with the panel in its pictures.
    panel : str
        Region of the scene file that is the panel.
    scene : Path
        Scene file: what the panel is made of, and the light.
    out : Path
        Calibration file.
    noise : Path or None
        Noise calibration of the camera.
    valid_days : float or None
        For how long the calibration holds.
    """

    run: Path
    panel: str
    scene: Path
    out: Path
    noise: Path | None = None
    valid_days: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedResponse:
    """A radiometric calibration, the content of its file, and what is doubtful about the noise calibration."""

    found: PanelResponse
    content: dict[str, Any]
    doubts: tuple[str, ...]


def calibrate_radiometric(request: RadiometricRequest) -> CalibratedResponse:
    """Return the counts per unit of radiance by a panel, once their file is written.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        A file is wrong or cannot be written, or the run is unfit.
    """
    scene, run = load_scene(request.scene), read_run(request.run)
    noise, doubts = (None, ()) if request.noise is None else read_fitting_noise(request.noise, run)
    regions = [region for region in scene.regions if region.name == request.panel]
    measurement = measure(run, regions=list(regions), noise=noise)
    found = panel_response(measurement, scene=scene, panel=request.panel, noise=noise)
    files = {"scene": request.scene} | ({} if request.noise is None else {"noise": request.noise})
    content = radiometric_json(found, measurement, files=files, valid_days=request.valid_days)
    write_content(request.out, content)
    return CalibratedResponse(found=found, content=content, doubts=doubts)


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
