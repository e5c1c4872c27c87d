"""Calibrating radiometrically: a run of a panel of known reflectance in; counts per unit of radiance out."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.calibrations.made_for import Measured
from rigctl.calibrations.noise import read_fitting_noise
from rigctl.calibrations.radiometric import SCHEMA_VERSION, Response
from rigctl.calibrations.record import CalibrationFile, header_of, source_of, source_of_run, write_content
from rigctl.compare.panel_response import PanelResponse, panel_response
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.files.rig_file import unset_polarizer
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import Measurement, measure
from rigctl.runs.check import used_run


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


@dataclass(frozen=True, kw_only=True)
class PanelNumbers:
    """The panel, in the order in which the file has it."""

    name: str
    pixels: int
    radiance_w_per_m2_sr: Measured[float]


@dataclass(frozen=True, kw_only=True)
class RadiometricNumbers:
    """What a panel gave, in the order in which the file has it.

    Attributes
    ----------
    panel : PanelNumbers
        The panel and its radiance at the aperture.
    exposure_s, f_number : float
        Of frames and lens.
    response : str
        What a response is, in words.
    response_dn_per_radiance : Response
        Of all angles.
    channels : tuple of ChannelResponse
        Of each.
    channels_agree : bool
        Whether they are one response within their errors.
    over_scene_file : Measured
        Common response over that of the scene file's sensor.
    variance_shares : mapping
        As in `PanelResponse.shares`.
    remarks : tuple of str
        What was assumed, overruled or found.
    """

    panel: PanelNumbers
    exposure_s: float
    f_number: float
    response: str = "counts of a pixel and frame per W m-2 sr-1 of unpolarized light in band, dark level off"
    response_dn_per_radiance: Response
    channels: tuple[ChannelResponse, ...]
    channels_agree: bool
    over_scene_file: Measured[float]
    variance_shares: dict[str, float]
    remarks: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedResponse:
    """A radiometric calibration.

    Attributes
    ----------
    found : PanelResponse
        As the panel gave it.
    file : CalibrationFile
        What was written.
    doubts : tuple of str
        What is doubtful about the noise calibration and the seat of the polarizer.
    """

    found: PanelResponse
    file: CalibrationFile[RadiometricNumbers]
    doubts: tuple[str, ...]


def calibrate_radiometric(request: RadiometricRequest) -> CalibratedResponse:
    """Return the counts per unit of radiance by a panel, once their file is written.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        A file is wrong or cannot be written, or the run is unfit.
    """
    scene, run = load_scene(request.scene), used_run(request.run, ignore_exclusions=are_exclusions_ignored())
    noise, doubts = (None, ()) if request.noise is None else read_fitting_noise(request.noise, run)
    unset = unset_polarizer(run.path, placeholder=run.session.polarizer.placeholder)
    regions = [region for region in scene.regions if region.name == request.panel]
    measurement = measure(run, regions=list(regions), noise=noise)
    found = panel_response(measurement, scene=scene, panel=request.panel, noise=noise)
    files = {"scene": request.scene} | ({} if request.noise is None else {"noise": request.noise})
    file = radiometric_file(found, measurement, files=files, valid_days=request.valid_days)
    write_content(request.out, file.as_json())
    return CalibratedResponse(found=found, file=file, doubts=(*unset, *doubts))


def radiometric_file(
    found: PanelResponse, measurement: Measurement, *, files: Mapping[str, Path], valid_days: float | None = None
) -> CalibrationFile[RadiometricNumbers]:
    """Return the file.

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
    """
    run, records = measurement.run, [record for cycle in measurement.grid.records for record in cycle]
    source = {"run": source_of_run(run)} | {what: source_of(path) for what, path in files.items()}
    return CalibrationFile(
        header=header_of("radiometric", SCHEMA_VERSION, source=source, run=run, records=records, valid_days=valid_days),
        body=RadiometricNumbers(
            panel=PanelNumbers(
                name=found.panel,
                pixels=found.pixels,
                radiance_w_per_m2_sr=Measured(value=found.radiance, std_error=found.radiance_error),
            ),
            exposure_s=found.exposure_s,
            f_number=found.f_number,
            response_dn_per_radiance=_response(found, measurement),
            channels=_channels(found, measurement),
            channels_agree=found.scale.channels_agree,
            over_scene_file=Measured(value=found.scale.common, std_error=found.scale.common_error),
            variance_shares=found.shares,
            remarks=found.remarks,
        ),
    )


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
