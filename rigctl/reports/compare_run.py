"""A comparison from its files to its files: run, scene or regions, calibration in; report and numbers out."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.comparison.closed_loop import compare_closed_loop
from rigctl.comparison.comparison import Comparison, compare_with_scene
from rigctl.config import sha256_of
from rigctl.durable_file import write_durably
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.measurement.measurement import Measurement, measure
from rigctl.noise.noise_file import read_noise_file
from rigctl.reports.report import render
from rigctl.reports.tables_json import comparison_json, measurement_json, prediction_json
from rigctl.runs.run_folder import MANIFEST_FILE, Run, read_run
from rigctl.version import VERSION


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedRun:
    """A comparison with what it was made from."""

    comparison: Comparison
    measurement: Measurement
    regions: list[Region]
    provenance: dict[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Return the content of comparison.json."""
        return comparison_json(self.comparison, self.measurement, provenance=self.provenance)

    def write(self, out: Path) -> None:
        """Write comparison.json, prediction.json, measurement.json and report.html into a folder."""
        out.mkdir(parents=True, exist_ok=True)
        for name, content in (
            ("prediction.json", prediction_json(self.comparison.predictions, remarks=self.comparison.remarks)),
            ("measurement.json", measurement_json(self.measurement)),
            ("comparison.json", self.as_json()),
        ):
            write_durably(out / name, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
        title = f"{self.measurement.run.path.name} beside the model"
        html = render(self.comparison, self.measurement, self.regions, title=title, provenance=self.provenance)
        write_durably(out / "report.html", html.encode())


def compare_run(
    run_path: Path, *, scene_path: Path | None, regions_path: Path | None, noise_path: Path | None, alpha: float
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
    noise = None if noise_path is None else read_noise_file(noise_path)
    if noise is not None:
        _require_same_camera(noise, run)
    measurement = measure(run, regions=regions, noise=noise)
    if scene is None:
        comparison = compare_closed_loop(measurement, noise=noise, alpha=alpha)
    else:
        comparison = compare_with_scene(measurement, scene=scene, noise=noise, alpha=alpha)
    files = {"scene": scene_path, "regions": regions_path, "noise": noise_path, "manifest": run_path / MANIFEST_FILE}
    return ComparedRun(
        comparison=comparison,
        measurement=measurement,
        regions=regions,
        provenance=_provenance(run, {what: path for what, path in files.items() if path is not None}),
    )


def _regions(scene: SceneFile | None, regions_path: Path | None) -> list[Region]:
    if scene is not None:
        return list(scene.regions)
    return [] if regions_path is None else load_regions(regions_path)


def _require_same_camera(noise: dict[str, Any], run: Run) -> None:
    """Refuse a calibration of another camera or another gain, where both sides say what they are."""
    first = next(record for record in run.frames)
    camera = noise.get("camera") or {}
    pairs = {
        "camera serial number": (camera.get("serial"), first.camera_serial),
        "gain setting [dB]": (camera.get("gain_db"), first.gain_db),
        "bit depth": (camera.get("bit_depth"), first.bit_depth),
    }
    wrong = [
        f"{what}: calibrated {calibrated}, run {used}"
        for what, (calibrated, used) in pairs.items()
        if calibrated is not None and used is not None and calibrated != used
    ]
    if wrong:
        raise DataError("the noise calibration is not of this camera as it was set: " + "; ".join(wrong))


def _provenance(run: Run, files: dict[str, Path]) -> dict[str, Any]:
    return {
        "program": f"rigctl {VERSION}",
        "run": {"path": str(run.path), "created_by": run.created_by, "created_utc": run.created_utc},
        "files": {what: {"path": str(path), "sha256": sha256_of(path)} for what, path in files.items()},
        "session": run.session,
    }
