"""Stokes images of a run: run, regions and calibrations in; images, masks and the numbers of the regions out."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from model.processing.texture import Texture, estimate_texture
from rigctl.files.regions import load_regions
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.run_calibrations import CalibrationPaths, correction_remarks, read_calibrations
from rigctl.measurement.temporal_noise import TemporalNoise, temporal_noise, temporal_variance
from rigctl.reports.outputs.stokes_files import write_stokes
from rigctl.reports.tables.comparison_json import measurement_json
from rigctl.runs.run_folder import read_run


@dataclass(frozen=True, kw_only=True)
class StokesRequest:
    """What a run is to be processed with, and where its images go.

    Attributes
    ----------
    run : Path
        Run folder.
    out : Path
        Folder for images, pictures and numbers.
    regions : Path or None
        Regions file.
    calibrations : CalibrationPaths
        Files of calibrations.
    """

    run: Path
    out: Path
    regions: Path | None = None
    calibrations: CalibrationPaths = field(default_factory=CalibrationPaths)


@dataclass(frozen=True, kw_only=True, eq=False)
class StokesOfRun:
    """A run as it was measured.

    Attributes
    ----------
    measurement : Measurement
        Its Stokes pictures and regions.
    textures : dict or None
        Texture of each region; None without a noise calibration, which tells it from noise.
    content : dict
        What stokes.json holds.
    files : tuple of str
        Names of what was written.
    remarks : tuple of str
        What is doubtful, and what was done to frames.
    """

    measurement: Measurement
    textures: dict[str, Texture] | None
    content: dict[str, Any]
    files: tuple[str, ...]
    remarks: tuple[str, ...]


def stokes_of_run(request: StokesRequest) -> StokesOfRun:
    """Return the Stokes parameters of a run, once its images are written.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the run is unfit.
    """
    regions = [] if request.regions is None else load_regions(request.regions)
    run = read_run(request.run)
    given = read_calibrations(request.calibrations, run)
    measurement = given.measure(run, regions)
    textures = None if given.noise is None else region_textures(measurement, temporal_noise(given.noise))
    content = measurement_json(measurement, textures)
    return StokesOfRun(
        measurement=measurement,
        textures=textures,
        content=content,
        files=write_stokes(measurement, regions, request.out, numbers=content),
        remarks=(*given.doubts, *correction_remarks(measurement, regions)),
    )


def region_textures(measurement: Measurement, noise: TemporalNoise) -> dict[str, Texture]:
    """Return the texture of each region's Stokes parameters [grid.unit^2]; the fixed pattern stays in it.

    Parameters
    ----------
    measurement : Measurement
        With regions.
    noise : TemporalNoise
        Of the camera that took the run.

    Raises
    ------
    DataError
        The exposure is not known.
    """
    inverse = measurement.plan.inverse
    found = {}
    for name, region in measurement.regions.items():
        variance = temporal_variance(measurement, region, noise.values)
        found[name] = estimate_texture(
            region.stokes_pixels_mean,
            (inverse * variance) @ inverse.T,
            repeats=measurement.grid.cycles,
            pattern_cov=np.zeros((3, 3)),
        )
    return found
