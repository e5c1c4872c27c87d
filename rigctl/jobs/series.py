"""Comparing many runs of one rig with one scene, such as an afternoon."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from rigctl.comparison.compared_run import ComparedRun, ComparedSeries, used_file
from rigctl.comparison.numerical_accuracy import FIRST_TOLERANCE
from rigctl.comparison.run_geometry import scene_of_run
from rigctl.comparison.series import SeriesPoint, drifts_of, require_one_instrument, trends_over_runs
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.jobs.compare import CompareRequest, compare_run
from rigctl.measurement.measurement import Measurement
from rigctl.reports.outputs.comparison_files import write_series
from rigctl.runs.wholeness import used_run
from rigctl.scene.scene_reading import sun_of_file


def compare_series(run_paths: Sequence[Path], request: CompareRequest, *, out: Path | None = None) -> ComparedSeries:
    """Return many runs beside one scene.

    Parameters
    ----------
    run_paths : sequence of Path
        Run folders, two or more of different names.
    request : CompareRequest
        With a scene file; each run has its own sun. The chance of a false disagreement is that over all runs.
    out : Path or None
        Folder for series.html, series.pdf, the numbers, and a folder of each run.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a run is unfit, or does not belong with the others.
    """
    if not isinstance(request.scene, Path):
        raise ConfigError("several runs are compared with one scene: give a scene file last, or with --scene")
    names = [path.resolve().name for path in run_paths]
    if len(set(names)) < len(names):
        raise ConfigError(f"run folders of a series need different names; found {', '.join(names)}")
    require_one_instrument([used_run(path, ignore_exclusions=are_exclusions_ignored()) for path in run_paths])
    scene = load_scene(request.scene)
    shared = replace(request, alpha=request.alpha / len(run_paths))
    runs = [compare_run(run_paths[0], shared)]
    for path in run_paths[1:]:
        # What the errors of one run asked for, those of its neighbour are likely to ask for too.
        accuracy = runs[-1].accuracy
        runs.append(compare_run(path, shared, tolerance=FIRST_TOLERANCE if accuracy is None else accuracy.tolerance))
    points = tuple(_point(name, run, scene) for name, run in zip(names, runs, strict=True))
    found = ComparedSeries(
        runs=tuple(runs),
        points=points,
        drifts=drifts_of(points),
        trends=trends_over_runs(points),
        alpha=request.alpha,
        scene=used_file(request.scene),
    )
    if out is not None:
        write_series(found, out)
    return found


def _point(name: str, run: ComparedRun, scene: SceneFile) -> SeriesPoint:
    first = run.measurement.grid.records[0][0].start_utc
    return SeriesPoint(
        name=name,
        comparison=run.comparison,
        measurement=run.measurement,
        start=None if first is None else datetime.fromisoformat(first),
        sun_zenith_deg=_sun_zenith_deg(run.measurement, scene),
    )


def _sun_zenith_deg(measurement: Measurement, scene: SceneFile) -> float | None:
    frames = measurement.grid.frames
    elevations = [frame.sun_elevation_deg for frame in frames if frame.sun_elevation_deg is not None]
    if len(elevations) == len(frames):
        return 90.0 - sum(elevations) / len(elevations)
    changed, _ = scene_of_run(scene, measurement.run, frames)
    sun = sun_of_file(changed)
    return None if sun is None else sun.zenith_deg.value
