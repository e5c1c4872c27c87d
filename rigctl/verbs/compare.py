"""`rigctl compare`: a run, or several, against the model, with a verdict."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Unpack

from cyclopts import Parameter

from rigctl.console import Json, note, solving_shown, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import (
    CompareOptions,
    FilePath,
    Files,
    Part,
    RegionsPath,
    Result,
    RunPath,
    ScaledOptions,
    ScenePath,
    Writes,
    calibrations_of,
    regions_of,
    scene_file_of,
)

if TYPE_CHECKING:
    from rigctl.comparison.compare import Comparison
    from rigctl.comparison.series import ComparedSeries
    from rigctl.files.regions import Region
    from rigctl.files.scene_file import SceneFile
    from rigctl.measure.diagnose import MeasuredRun
    from rigctl.scene.scene import Scene

_FILES = (
    "comparison.json",
    "comparison.csv",
    "prediction.json",
    "measurement.json",
    "report.html",
    "report.pdf",
    "series.json",
    "series.csv",
    "series.html",
    "series.pdf",
)
# Largest number of disagreements that are printed; the files have all.
_SHOWN = 20
# Keys of a region in a regions file, except its name.
_OUTLINE = ("rectangle", "polygon", "edge_px")


def compare(
    run: RunPath,
    /,
    *more: RunPath | ScenePath,
    scene: ScenePath | None = None,
    regions: RegionsPath | None = None,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_FILES), Parameter(required=True)] = None,
    **options: Unpack[CompareOptions],
) -> "ComparisonResult | SeriesResult":
    """Compare a run with the model; write a report and give a verdict.

    With a scene file, the model predicts the run from the description of the scene. With --regions alone, it predicts
    the noise and the distribution of DoLP from the run's own means. The exit code is 0 if model and measurement agree,
    5 if they disagree, and 4 if that cannot be judged.

    Several runs of the same rig, such as an afternoon, can be compared with one scene file; each has its own sun. The
    report series.html then shows both sides against time, and each run has its own report.

    Numbers of the scene file may be uncertain: { value = 1.2, std = 0.1 } or { range = [1.0, 1.4] }. Their errors then
    count in the verdict, and after a disagreement the report says which input would explain it.

    Numerical settings are chosen so that no numerical error exceeds 0.3 of a standard error. Calibrations that are not
    given are selected from the store next to the rig file.

    Example: rigctl compare runs/panels examples/scene-panels.toml --noise noise.json --out compared

    Parameters
    ----------
    run : path or Run
        Run folder.
    more : path
        More run folders; the scene file may be the last argument.
    scene : path or SceneFile
        Scene file, if it is not the last argument.
    regions : path or sequence of Region
        Regions file: instead of a scene, or with new outlines for the scene's regions.
    out : path
        Folder for report and numbers. Optional in Python.
    **options
        Calibrations, scale and effects, see `CompareOptions`.

    Returns
    -------
    ComparisonResult or SeriesResult
        Of one run, or of several.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the run is unfit for the comparison.
    """
    runs, scene = runs_and_scene(run, more, scene)
    result: ComparisonResult | SeriesResult
    with solving_shown():
        if len(runs) == 1:
            result = ComparisonResult(comparison=compare_run(runs[0], scene=scene, regions=regions, **options))
        else:
            result = SeriesResult(series=_series(runs, scene, regions, options))
    for comparison in result.comparisons:
        _report(comparison)
    if out is not None:
        note_reports(result, Path(out))
    return result


def note_reports(result: Result, out: Path) -> None:
    """Write the files of a result into a folder, and report which of them are for people."""
    written = (out / name for name in result.write(out))
    note(f"report: {', '.join(str(path) for path in written if path.suffix in ('.html', '.pdf'))}", below=True)


def runs_and_scene(
    run: RunPath, more: "Sequence[RunPath | ScenePath]", scene: ScenePath | None
) -> tuple[list[Path], ScenePath | None]:
    """Return run folders and the scene, which may be the last argument: a SceneFile, or the path of a TOML file."""
    from rigctl.files.scene_file import SceneFile

    given: list[Any] = [run, *more]
    if more and scene is None and (isinstance(given[-1], SceneFile) or Path(given[-1]).suffix == ".toml"):
        scene = given.pop()
    return [Path(one) for one in given], scene


def _report(comparison: "Comparison") -> None:
    from rigctl.comparison.checks import refusals
    from rigctl.files.rig_file import PLACEHOLDER

    run = comparison.measurement.run
    comparison.run.calibrations.selected.report()
    if run.session.polarizer.placeholder:
        warn(f"{run.path}: {PLACEHOLDER}")
    if comparison.agrees is None:
        for why in refusals(comparison.checks) or dict.fromkeys(one.reason for one in comparison.regions.values()):
            warn(why)


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparisonResult(Result):
    """A comparison of a run with the model: verdict, tables, and the content of `comparison.json`."""

    comparison: "Comparison"  #: rows, checks, measurement, predictions and origin

    def __repr__(self) -> str:
        found = self.comparison
        return f"<comparison of {found.measurement.run.path}: {_short(found)}{found.run.calibrations.selected}>"

    @property
    def agrees(self) -> bool | None:
        """True if model and measurement agree; None if that cannot be judged."""
        return self.comparison.agrees

    @property
    def comparisons(self) -> "tuple[Comparison, ...]":
        """The comparison of each run."""
        return (self.comparison,)

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty without a store."""
        return self.comparison.run.calibrations.selected.used

    @property
    def exit_code(self) -> int:
        """5 if model and measurement disagree, 4 if that cannot be judged."""
        return _exit_code(self.agrees)

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, and data that were overruled or left out."""
        return self.comparison.remarks

    def content(self) -> Iterable[Part]:
        """Return the verdict, the disagreements and their likely cause; then how the verdict was reached."""
        from rigctl.comparison.checks import ADVICE
        from rigctl.comparison.explain import unstated_lines
        from rigctl.report.comparison import row_table, scores_png, verdict

        found = self.comparison
        yield verdict(found)
        off = sorted(found.disagreements, key=lambda row: -abs(row.z or 0.0))
        if found.agrees is False:
            yield from (ADVICE[cause] for cause in found.points_to)
            yield row_table(off[:_SHOWN])
            inputs = found.attribution
            if inputs is not None and (not found.points_to or (inputs.best is not None and inputs.best.removes)):
                yield f"Likely cause among the inputs: {inputs.remark}"
        yield from unstated_lines(found.unstated, disagrees=found.agrees is False)
        yield from _of_run(found)
        yield from (f"hardly tested: {weak}" for weak in found.weak)
        if found.scale is not None:
            yield found.scale.remark
        if found.accuracy is not None:
            yield found.accuracy.remark
        if any(row.z is not None for row in found.rows):
            yield lambda: scores_png(found)

    def as_json(self) -> dict[str, Json]:
        """Return the content of comparison.json."""
        from rigctl.report.comparison import compared_json

        return compared_json(self.comparison)

    def output_files(self) -> Files:
        """Return numbers and reports."""
        from rigctl.report.comparison import comparison_files

        return comparison_files(self.comparison)

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return every row of comparison.csv as a data frame: predicted, measured, errors, scores, verdict."""
        from rigctl.report.comparison import row_table

        return row_table(self.comparison.rows).data_frame(backend)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesResult(Result):
    """Comparisons of several runs with one scene: verdicts, table, and the content of `series.json`."""

    series: "ComparedSeries"

    @property
    def agrees(self) -> bool | None:
        """True if all runs agree; None if none disagrees, but one cannot be judged."""
        return self.series.agrees

    @property
    def comparisons(self) -> "tuple[Comparison, ...]":
        """The comparison of each run."""
        return self.series.comparisons

    @property
    def exit_code(self) -> int:
        """5 if a run disagrees, 4 if none disagrees, but one cannot be judged."""
        return _exit_code(self.agrees)

    def content(self) -> Iterable[Part]:
        """Return the verdict of each run."""
        from rigctl.comparison.series import name_of

        for comparison in self.comparisons:
            accuracy = comparison.accuracy
            tolerance = "" if accuracy is None else f"; numerical tolerance {accuracy.tolerance:.1e}"
            yield f"{name_of(comparison)}: {_short(comparison)}{tolerance}"

    def as_json(self) -> dict[str, Json]:
        """Return the content of series.json."""
        from rigctl.report.series import series_json

        return series_json(self.series)

    def output_files(self) -> Files:
        """Return numbers and reports of all runs."""
        from rigctl.report.series import series_files

        return series_files(self.series)

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the files of all runs into a folder, and those of each run into a subfolder."""
        from rigctl.comparison.series import name_of

        for comparison in self.comparisons:
            ComparisonResult(comparison=comparison).write(folder / name_of(comparison))
        return super().write(folder)

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return every row of series.csv as a data frame."""
        from rigctl.report.series import series_rows

        return series_rows(self.series).data_frame(backend)


def _exit_code(agrees: bool | None) -> int:
    from rigctl.console import EXIT_DATA, EXIT_DISAGREES

    return {True: 0, False: EXIT_DISAGREES, None: EXIT_DATA}[agrees]


def _short(found: "Comparison") -> str:
    if found.agrees is None:
        return "CANNOT BE JUDGED"
    return "agrees" if found.agrees else f"DISAGREES in {len(found.disagreements)} numbers"


def _of_run(found: "Comparison") -> Iterable[str]:
    """Return the faults and checks of the run, and the regions that cannot be judged."""
    from rigctl.comparison.checks import titled_texts, unjudged_lines
    from rigctl.measure.faults import term_text

    yield from (f"the run shows {term_text(term)}" for term in found.run.diagnosis.mentioned)
    shown = ("flagged",) if found.agrees is None else ("flagged", "refused")
    yield from (f"{title}: {text}" for title, text in titled_texts(found.checks, *shown))
    if found.agrees is not None:
        yield from unjudged_lines(found.regions, found.checks)


def compare_run(
    run: Path,
    *,
    scene: ScenePath | None = None,
    regions: RegionsPath | None = None,
    tolerance: float | None = None,
    **options: Unpack[CompareOptions],
) -> "Comparison":
    """Compare one run with the model; without `tolerance`, the first numerical tolerance is chosen here."""
    from rigctl.comparison.compare import compare_with_itself, compare_with_scene

    require_possible(scene, regions, options)
    measured, model = read_scene_run(run, scene, regions, options)
    scale, files = options.get("scale", "absolute"), _used_files(run, scene, regions, measured)
    if model is not None:
        rule = options.get("effects") or "safe"
        return compare_with_scene(
            measured, model, alpha=_alpha(options), scale=scale, rule=rule, tolerance=tolerance, files=files
        )
    if scale != "absolute" or measured.calibrations.radiometric is not None:
        raise ConfigError("--scale and --radiometric are for a comparison with a scene file")
    return compare_with_itself(measured, alpha=_alpha(options), files=files)


def read_scene_run(
    run: Path, scene: ScenePath | None, regions: RegionsPath | None, options: ScaledOptions
) -> "tuple[MeasuredRun, Scene | None]":
    """Measure a run in the regions of a scene or regions file; return it, and the scene with its noise."""
    from rigctl.measure.diagnose import MEASURED_WITH, measure_run
    from rigctl.measure.frames import calibrations_of_run
    from rigctl.runs.check import run_to_measure
    from rigctl.scene.scene import scene_of_file

    paths = calibrations_of(options)
    model, drawn = _outlined(scene, regions, options)
    record = run_to_measure(run, ignore_exclusions=options.get("ignore_exclusions", False))
    kinds = (*MEASURED_WITH, "radiometric") if options.get("scale") == "panel" else MEASURED_WITH
    given = calibrations_of_run(paths, record, kinds)
    measured = measure_run(record, drawn, given, correct=options.get("correct", ()))
    return measured, None if model is None else scene_of_file(model, given.noise)


def require_possible(scene: ScenePath | None, regions: RegionsPath | None, options: CompareOptions) -> None:
    """Raise ConfigError if neither scene nor regions are given, or if options contradict one another."""
    alpha = _alpha(options)
    if not 0.0 < alpha < 1.0:
        raise ConfigError(f"--alpha: is {alpha:g}; allowed is above 0 and below 1, for instance 0.001")
    if scene is None and regions is None:
        raise ConfigError("give a scene file, or --regions FILE for a comparison without a scene")
    if scene is None and (options.get("effects") or options.get("switched_on") or options.get("left_out")):
        raise ConfigError("--effects, --with and --without: are of a prediction from a scene file; give one")


def _alpha(options: CompareOptions) -> float:
    return options.get("alpha", 1e-3)


def _outlined(
    scene: ScenePath | None, regions: RegionsPath | None, options: ScaledOptions
) -> "tuple[SceneFile | None, list[Region]]":
    """Return scene and regions; outlines in the regions file replace those of the scene."""
    from rigctl.scene.scene import with_choices

    drawn = regions_of(regions)
    if scene is None:
        return None, drawn
    content = with_choices(
        scene_file_of(scene),
        switched_on=tuple(options.get("switched_on") or ()),
        left_out=tuple(options.get("left_out") or ()),
    )
    unknown = sorted({region.name for region in drawn}.difference(region.name for region in content.regions))
    if unknown:
        raise ConfigError(
            f"--regions: scene {content.name} has no region {', '.join(unknown)}; there are "
            f"{', '.join(region.name for region in content.regions)}"
        )
    now = {region.name: {name: getattr(region, name) for name in _OUTLINE} for region in drawn}
    outlined = [region.model_copy(update=now.get(region.name, {})) for region in content.regions]
    return content.model_copy(update={"regions": outlined}), list(outlined)


def _used_files(
    run: Path, scene: ScenePath | None, regions: RegionsPath | None, measured: "MeasuredRun"
) -> "dict[str, dict[str, Json]]":
    from rigctl.base.durable import source_of
    from rigctl.runs.folder import MANIFEST_FILE

    named = {str(kind): path for kind, path in measured.calibrations.selected.paths.files.items()}
    files = {"scene": scene, "regions": regions, **named, "manifest": run / MANIFEST_FILE}
    return {what: source_of(Path(path)) for what, path in files.items() if isinstance(path, str | Path)}


def _series(
    runs: Sequence[Path], scene: ScenePath | None, regions: RegionsPath | None, options: CompareOptions
) -> "ComparedSeries":
    """Compare several runs of a rig with one scene; alpha is the probability of a false disagreement in any run."""
    from rigctl.base.durable import source_of
    from rigctl.comparison.series import ComparedSeries, drifts_of, require_one_instrument, trends_over_runs
    from rigctl.runs.check import run_to_measure

    if not isinstance(scene, str | Path):
        raise ConfigError("several runs are compared with one scene: give a scene file last, or with --scene")
    names = [path.resolve().name for path in runs]
    if len(set(names)) < len(names):
        raise ConfigError(f"run folders of a series need different names; found {', '.join(names)}")
    ignored = options.get("ignore_exclusions", False)
    require_one_instrument([run_to_measure(path, ignore_exclusions=ignored) for path in runs])
    alpha = _alpha(options)
    shared: CompareOptions = {**options, "alpha": alpha / len(runs)}
    found: list[Comparison] = []
    for path in runs:
        # The next run is likely to need the same tolerance.
        accuracy = found[-1].accuracy if found else None
        tolerance = None if accuracy is None else accuracy.tolerance
        found.append(compare_run(path, scene=scene, regions=regions, tolerance=tolerance, **shared))
    return ComparedSeries(
        comparisons=tuple(found),
        drifts=drifts_of(found),
        trends=trends_over_runs(found),
        alpha=alpha,
        scene=source_of(Path(scene)),
    )
