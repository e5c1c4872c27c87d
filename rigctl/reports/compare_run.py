"""A comparison from its files to its files: run, scene or regions, calibration in; report and numbers out."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rigctl.comparison.checks import require_sound, run_checks
from rigctl.comparison.closed_loop import compare_closed_loop
from rigctl.comparison.comparison import Comparison, compare_with_scene
from rigctl.comparison.run_registration import registration_of, with_registration
from rigctl.comparison.scale import ScaleKind
from rigctl.config import sha256_of
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.measurement.measurement import Measurement
from rigctl.reports.blocks import Report, Table
from rigctl.reports.compare_content import compare_report
from rigctl.reports.compare_context import calibration_table, effects_block, machine
from rigctl.reports.pdf import pdf
from rigctl.reports.report import render
from rigctl.reports.rows_csv import rows_csv
from rigctl.reports.run_calibrations import CalibrationPaths, RunCalibrations, correction_remarks, read_calibrations
from rigctl.reports.tables_json import comparison_json, measurement_json, prediction_json
from rigctl.runs.run_folder import MANIFEST_FILE, Run, read_run
from rigctl.scene.effect_choice import acting_effects
from rigctl.scene.effect_plan import plan_effects
from rigctl.version import VERSION

# Of a prediction: at this an effect is said to be called for or not. A comparison takes all of them all the same.
_EFFECTS_TOLERANCE = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedRun:
    """A comparison with what it was made from."""

    comparison: Comparison
    measurement: Measurement
    regions: list[Region]
    provenance: dict[str, Any]
    calibration: Table | None = None
    effects: Table | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the content of comparison.json."""
        return comparison_json(self.comparison, self.measurement, provenance=self.provenance)

    def write(self, out: Path) -> None:
        """Write comparison.json, comparison.csv, prediction.json, measurement.json, report.html and report.pdf."""
        out.mkdir(parents=True, exist_ok=True)
        for name, content in (
            ("prediction.json", prediction_json(self.comparison.predictions, remarks=self.comparison.remarks)),
            ("measurement.json", measurement_json(self.measurement)),
            ("comparison.json", self.as_json()),
        ):
            write_durably(out / name, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
        write_durably(out / "comparison.csv", rows_csv(self.comparison.rows).encode())
        report = self.report()
        write_durably(out / "report.html", render(report).encode())
        write_durably(out / "report.pdf", pdf(report))

    def report(self) -> Report:
        """Return what the report says."""
        return compare_report(
            self.comparison,
            self.measurement,
            self.regions,
            title=f"{self.measurement.run.path.name} beside the model",
            provenance=self.provenance,
            calibration=self.calibration,
            effects=self.effects,
        )


def compare_run(
    run_path: Path,
    *,
    scene_path: Path | None,
    regions_path: Path | None,
    noise_path: Path | None,
    alpha: float,
    scale: ScaleKind = "absolute",
    radiometric_path: Path | None = None,
    registration_path: Path | None = None,
    flat_path: Path | None = None,
    polarizer_path: Path | None = None,
) -> ComparedRun:
    """Return a run beside what the model says of it.

    Parameters
    ----------
    run_path : Path
        Run folder.
    scene_path, regions_path : Path or None
        One of them: a scene file predicts the run; a regions file sets the run beside its own moments.
    noise_path : Path or None
        Noise calibration.
    alpha : float
        Chance of any false disagreement, in (0, 1).
    scale : {"absolute", "panel", "free"}
        What the counts of a prediction are scaled by.
    radiometric_path : Path or None
        Radiometric calibration, for "panel".
    registration_path : Path or None
        Registration by which frames are moved to lie on one another.
    flat_path : Path or None
        Flat fields that frames are divided by.
    polarizer_path : Path or None
        Polarizer calibration, by whose throughput frames are divided.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the run is unfit for what is asked.
    """
    if not 0.0 < alpha < 1.0:
        raise ConfigError(f"--alpha: is {alpha:g}; allowed is above 0 and below 1, for instance 0.001")
    if (scene_path is None) == (regions_path is None):
        raise ConfigError("give a scene file, or --regions FILE for a comparison without a scene")
    scene = None if scene_path is None else load_scene(scene_path)
    regions = _regions(scene, regions_path)
    run = read_run(run_path)
    paths = CalibrationPaths(
        noise=noise_path,
        radiometric=radiometric_path,
        registration=registration_path,
        flat=flat_path,
        polarizer=polarizer_path,
    )
    given = read_calibrations(paths, run)
    measurement = given.measure(run, regions)
    registered = registration_of(measurement)
    checks = run_checks(measurement, registered)
    require_sound(checks, run=str(run_path))
    comparison = _comparison(measurement, scene, given, alpha, scale)
    budgets = with_registration(
        comparison.budgets,
        measurement,
        regions=regions,
        found=registered,
        means={name: found.channels.mean_dn for name, found in comparison.predictions.items()},
    )
    files = {"scene": scene_path, "regions": regions_path, **vars(paths), "manifest": run_path / MANIFEST_FILE}
    used = {what: path for what, path in files.items() if path is not None}
    said = (*given.doubts, *correction_remarks(measurement, regions), *comparison.remarks)
    return ComparedRun(
        comparison=replace(comparison, remarks=said, checks=checks, budgets=budgets),
        measurement=measurement,
        regions=regions,
        provenance=_provenance(run, used, {"alpha": alpha, "scale": scale}),
        calibration=calibration_table(given.noise),
        effects=None if scene is None else _effects(scene, given.noise),
    )


def _comparison(
    measurement: Measurement, scene: SceneFile | None, given: RunCalibrations, alpha: float, scale: ScaleKind
) -> Comparison:
    if scene is not None:
        return compare_with_scene(
            measurement, scene=scene, noise=given.noise, alpha=alpha, scale=scale, radiometric=given.radiometric
        )
    if scale == "absolute" and given.radiometric is None:
        return compare_closed_loop(measurement, noise=given.noise, alpha=alpha)
    raise ConfigError("--scale and --radiometric are for a comparison with a scene file")


def _effects(scene: SceneFile, noise: dict[str, Any] | None) -> Table:
    planned = plan_effects(scene, noise, tolerance=_EFFECTS_TOLERANCE)
    return effects_block(planned.plan, acting_effects(scene))


def _regions(scene: SceneFile | None, regions_path: Path | None) -> list[Region]:
    drawn = [] if regions_path is None else load_regions(regions_path)
    return drawn if scene is None else _outlines_of(scene, drawn)


def _outlines_of(scene: SceneFile, drawn: list[Region]) -> list[Region]:
    """Return the scene's regions, with their outlines of now where they were found again."""
    unknown = sorted({region.name for region in drawn}.difference(region.name for region in scene.regions))
    if unknown:
        raise ConfigError(
            f"scene {scene.name} has no region {', '.join(unknown)}; there are "
            f"{', '.join(region.name for region in scene.regions)}"
        )
    now = {region.name: region for region in drawn}
    return [now.get(region.name, region) for region in scene.regions]


def _provenance(run: Run, files: dict[str, Path], settings: dict[str, Any]) -> dict[str, Any]:
    return {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": {what: {"path": str(path), "sha256": sha256_of(path)} for what, path in files.items()},
        "settings": settings,
        "machine": machine(),
        "session": run.session,
    }
