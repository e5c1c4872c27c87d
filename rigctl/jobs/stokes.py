"""Stokes images of a run: run, regions and calibrations in; images, masks and the numbers of the regions out."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from model.processing.texture import Texture, estimate_texture
from rigctl.comparison.checks import Check, registration_of, run_checks
from rigctl.comparison.verdict import refused_regions
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.console.json_text import Json
from rigctl.files.regions import Region, load_regions
from rigctl.measurement.diagnosed_run import diagnosed
from rigctl.measurement.picked_calibrations import PickedCalibrations, picked_for_run
from rigctl.measurement.run_calibrations import CalibrationPaths, correction_remarks, read_calibrations
from rigctl.measurement.temporal_noise import TemporalNoise, temporal_noise, temporal_variance
from rigctl.reports.outputs.measurement_files import write_stokes
from rigctl.reports.tables.numbers_json import diagnosis_json, measurement_json
from rigctl.runs.run_folder import Run
from rigctl.runs.wholeness import used_run

if TYPE_CHECKING:
    from rigctl.measurement.measurement import Measurement
    from rigctl.measurement.run_diagnosis import RunDiagnosis


@dataclass(frozen=True, kw_only=True)
class StokesRequest:
    """What a run is to be processed with, and where its images go.

    Attributes
    ----------
    run : Path
        Run folder.
    out : Path or None
        Folder for images, pictures and numbers; None: nothing is written.
    regions : Path, list of Region or None
        Regions file, or its content.
    calibrations : CalibrationPaths
        Files of calibrations.
    correct : tuple of str
        Faults that frames are corrected by, as the run itself shows them: "throughput", "dark-level", "shift".
    ignore_exclusions : bool
        Take frames too that people have excluded.
    """

    run: Path
    out: Path | None = None
    regions: Path | list[Region] | None = None
    calibrations: CalibrationPaths = field(default_factory=CalibrationPaths)
    correct: tuple[str, ...] = ()
    ignore_exclusions: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class StokesOfRun:
    """A run as it was measured.

    Attributes
    ----------
    measurement : Measurement
        Its Stokes pictures and regions.
    textures : mapping or None
        Texture of each region; None without a noise calibration, which tells it from noise.
    remarks : tuple of str
        What is doubtful, and what was done to frames.
    diagnosis : RunDiagnosis
        What the run says of its own faults.
    checks : tuple of Check
        Whether it is sound.
    files : tuple of str
        Names of what was written.
    picked : PickedCalibrations or None
        Which calibrations were picked from the store.
    """

    measurement: "Measurement"
    textures: dict[str, Texture] | None
    remarks: tuple[str, ...]
    diagnosis: "RunDiagnosis"
    checks: tuple[Check, ...]
    files: tuple[str, ...] = ()
    picked: PickedCalibrations | None = None

    def as_json(self) -> dict[str, Json]:
        """Return what stokes.json holds."""
        return measurement_json(self.measurement, self.textures) | {
            "unmeasured": self.measurement.unmeasured,
            "diagnosis": diagnosis_json(self.diagnosis),
            "checks": [asdict(check) for check in self.checks],
            "flags": [check.name for check in self.checks if check.verdict == "flagged"],
            "sound": not any(check.verdict == "refused" for check in self.checks),
            **({} if self.picked is None else self.picked.as_json()),
        }

    @property
    def refused(self) -> tuple[str, ...]:
        """Why the run is unsound; empty where it is not."""
        regions = {check.region for check in self.checks if check.region is not None}
        refused = refused_regions(self.checks)
        every = bool(regions) and regions == set(refused)
        return tuple(
            f"{check.name}: {check.text}"
            for check in self.checks
            if check.verdict == "refused" and (check.region is None or every)
        )


def stokes_of_run(request: StokesRequest) -> StokesOfRun:
    """Return the Stokes parameters of a run, once its images are written where that is wanted.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the run is unfit.
    """
    ignore_exclusions = request.ignore_exclusions or are_exclusions_ignored()
    return stokes_of(used_run(request.run, ignore_exclusions=ignore_exclusions), request)


def stokes_of(run: Run, request: StokesRequest) -> StokesOfRun:
    """Return the Stokes parameters of a run that was read already, as `stokes_of_run` does."""
    given_regions = request.regions or []
    regions = load_regions(given_regions) if isinstance(given_regions, Path) else given_regions
    picked = picked_for_run(request.calibrations, run, ("noise", "polarizer", "flat", "registration"))
    given = read_calibrations(picked.paths, run)
    seen = diagnosed(run, regions, given, correct=request.correct)
    measurement, diagnosis = seen.measurement, seen.diagnosis
    checks = run_checks(measurement, registration_of(measurement), diagnosis)
    textures = None if given.noise is None else region_textures(measurement, temporal_noise(given.noise))
    found = StokesOfRun(
        measurement=measurement,
        textures=textures,
        remarks=(*given.doubts, *seen.remarks, *correction_remarks(measurement, regions)),
        diagnosis=diagnosis,
        checks=checks,
        picked=picked,
    )
    if request.out is None:
        return found
    return replace(found, files=write_stokes(measurement, regions, request.out, numbers=found.as_json()))


def region_textures(measurement: "Measurement", noise: TemporalNoise) -> dict[str, Texture]:
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
