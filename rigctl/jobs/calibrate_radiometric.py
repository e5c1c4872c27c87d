"""Calibrating radiometrically: a run of a panel of known reflectance in; counts per unit of radiance out."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.calibrations.content_file import write_content
from rigctl.calibrations.made_for import made_for
from rigctl.calibrations.noise.noise_file import read_fitting_noise
from rigctl.calibrations.radiometric_file import SCHEMA_VERSION, Response
from rigctl.comparison.panel_response import PanelResponse, panel_response
from rigctl.files.config import sha256_of
from rigctl.files.scene_file import load_scene
from rigctl.measurement.measurement import Measurement, measure
from rigctl.numbers.utc_time import utc_text
from rigctl.runs.run_folder import MANIFEST_FILE
from rigctl.runs.wholeness import used_run
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


@dataclass(frozen=True, kw_only=True)
class ChannelResponse:
    """Response at one polarizer angle, in the order in which its file has it."""

    name: str
    polarizer_angle_deg: float
    response_dn_per_radiance: Response


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedResponse:
    """A radiometric calibration.

    Attributes
    ----------
    found : PanelResponse
        As the panel gave it.
    response : Response
        Of all angles [DN per W m-2 sr-1].
    channels : tuple of ChannelResponse
        Of each.
    content : dict
        What its file holds.
    doubts : tuple of str
        What is doubtful about the noise calibration.
    """

    found: PanelResponse
    response: Response
    channels: tuple[ChannelResponse, ...]
    content: dict[str, Any]
    doubts: tuple[str, ...]


def calibrate_radiometric(request: RadiometricRequest) -> CalibratedResponse:
    """Return the counts per unit of radiance by a panel, once their file is written.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        A file is wrong or cannot be written, or the run is unfit.
    """
    scene, run = load_scene(request.scene), used_run(request.run)
    noise, doubts = (None, ()) if request.noise is None else read_fitting_noise(request.noise, run)
    regions = [region for region in scene.regions if region.name == request.panel]
    measurement = measure(run, regions=list(regions), noise=noise)
    found = panel_response(measurement, scene=scene, panel=request.panel, noise=noise)
    files = {"scene": request.scene} | ({} if request.noise is None else {"noise": request.noise})
    content = radiometric_json(found, measurement, files=files, valid_days=request.valid_days)
    write_content(request.out, content)
    return CalibratedResponse(
        found=found,
        response=_response(found, measurement),
        channels=_channels(found, measurement),
        content=content,
        doubts=doubts,
    )


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
        "response_dn_per_radiance": asdict(_response(found, measurement)),
        "channels": [asdict(channel) for channel in _channels(found, measurement)],
        "channels_agree": found.scale.channels_agree,
        "over_scene_file": {"value": found.scale.common, "std_error": found.scale.common_error},
        "variance_shares": found.shares,
        "remarks": list(found.remarks),
    }


def _response(found: PanelResponse, measurement: Measurement) -> Response:
    scale, frames = found.scale, measurement.grid.cycles * measurement.grid.angles
    return _of_ratio(found, scale.common, scale.common_error, frames)


def _channels(found: PanelResponse, measurement: Measurement) -> tuple[ChannelResponse, ...]:
    return tuple(
        ChannelResponse(
            name=name,
            polarizer_angle_deg=float(np.degrees(angle)) % 180.0,
            response_dn_per_radiance=_of_ratio(found, ratio, error, measurement.grid.cycles),
        )
        for name, angle, ratio, error in zip(
            found.channel_names,
            found.polarizer_angles_rad.tolist(),
            found.scale.channel.tolist(),
            found.scale.channel_error.tolist(),
            strict=True,
        )
    )


def _of_ratio(found: PanelResponse, ratio: float, error: float, frames: int) -> Response:
    unit = found.modelled_dn_per_radiance
    return Response(value=ratio * unit, std_error=error * unit, n=frames)
