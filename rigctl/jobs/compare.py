"""Comparing a run with the model: run, scene or regions and calibrations in; the comparison and its report out."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from rigctl.calibrations.store import CalibrationKind
from rigctl.comparison.checks import nothing_tested, registration_of, run_checks
from rigctl.comparison.closed_loop import compare_closed_loop
from rigctl.comparison.compared_run import ComparedRun, EffectsTaken, Provenance, used_file
from rigctl.comparison.comparison import Comparison, compare_with_scene
from rigctl.comparison.numerical_accuracy import FIRST_TOLERANCE, NumericalAccuracy, accuracy_at
from rigctl.comparison.run_prediction import run_predictor
from rigctl.comparison.uncertainty_budget import with_diagnosis, with_registration
from rigctl.comparison.verdict import refused_regions, without_decisions
from rigctl.console.exclusion_option import are_exclusions_ignored
from rigctl.errors import ConfigError
from rigctl.files.choices import EffectRule, ScaleKind
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import SceneFile, scene_file
from rigctl.measurement.diagnosed_run import DiagnosedRun, diagnosed
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.picked_calibrations import picked_for_run
from rigctl.measurement.run_calibrations import CalibrationPaths, RunCalibrations, correction_remarks, read_calibrations
from rigctl.prediction.performance import performance_of
from rigctl.reports.outputs.comparison_files import write_comparison
from rigctl.runs.monitor_readings import monitor_line, monitor_traces
from rigctl.runs.run_events import read_events
from rigctl.runs.run_folder import MANIFEST_FILE
from rigctl.runs.wholeness import used_run
from rigctl.scene.effect_choice import acting_effects, with_choices, without_effects

# What is picked from the store; the last one where counts are scaled by a panel.
_KINDS: tuple[CalibrationKind, ...] = ("noise", "polarizer", "flat", "registration", "radiometric")
# Tolerances that are tried where the first one does not do.
_MOST_TRIED = 3
# What a regions file says of a region beside its name.
_OUTLINE = ("rectangle", "polygon", "edge_px")


@dataclass(frozen=True, kw_only=True)
class CompareRequest:
    """Scene, regions and calibrations that a run, or several, are compared with.

    Attributes
    ----------
    scene, regions : Path or None
        A scene file (or its content) predicts the run, with its outlines where they are now if there are regions too;
        a regions file alone sets the run beside its own moments.
    calibrations : CalibrationPaths
        Files of calibrations.
    alpha : float
        Family-wise error rate: chance of any false disagreement, in (0, 1).
    scale : {"absolute", "panel", "free"}
        What the counts of a prediction are scaled by.
    correct : tuple of str
        Faults that frames are corrected by, as the run itself shows them: "throughput", "dark-level", "shift".
    anonymous : bool
        The report says no serial numbers, ports, site and folders.
    rule : {"safe", "estimated", "all"} or None
        Which effects of the light are left out of the prediction: by bounds (None too), by estimates, or none ("all").
    switched_on, left_out : tuple of str
        Effects that act, or do not, whatever they change.
    """

    scene: Path | SceneFile | None = None
    regions: Path | None = None
    calibrations: CalibrationPaths = field(default_factory=CalibrationPaths)
    alpha: float = 1e-3
    scale: ScaleKind = "absolute"
    correct: tuple[str, ...] = ()
    anonymous: bool = False
    rule: EffectRule | None = None
    switched_on: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def compare_run(
    run_path: Path, request: CompareRequest, *, out: Path | None = None, tolerance: float = FIRST_TOLERANCE
) -> ComparedRun:
    """Return a run beside what the model says of it.

    Parameters
    ----------
    run_path : Path
        Run folder.
    request : CompareRequest
        What it is compared with.
    out : Path or None
        Folder for report.html, report.pdf and the numbers as JSON and CSV.
    tolerance : float
        Numerical tolerance to begin with; a smaller one is taken where the errors of the rows ask for it.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the run is unfit for what is asked.
    """
    require_possible(request)
    scene, regions = _outlined(request)
    run = used_run(run_path, ignore_exclusions=are_exclusions_ignored())
    picked = picked_for_run(request.calibrations, run, _KINDS if request.scale == "panel" else _KINDS[:-1])
    given = read_calibrations(picked.paths, run)
    seen = diagnosed(run, regions, given, correct=request.correct)
    measurement = seen.measurement
    effects, accuracy = None, None
    if scene is None:
        made = _closed_loop(measurement, given, request)
    else:
        made, effects, accuracy = _to_its_errors(measurement, scene, given, request, tolerance)
    comparison = _judged(made, seen, regions)
    beside = (monitor_line(trace) for trace in monitor_traces(read_events(run.path)))
    corrected = correction_remarks(measurement, regions)
    remarks = (*picked.lines, *given.doubts, *seen.remarks, *corrected, *beside, *comparison.remarks)
    found = ComparedRun(
        comparison=replace(comparison, remarks=remarks),
        measurement=measurement,
        regions=regions,
        performance=performance_of(comparison.predictions),
        provenance=_provenance(run_path, request, picked.paths),
        noise=given.noise,
        effects=effects,
        picked=picked,
        accuracy=accuracy,
    )
    if out is not None:
        write_comparison(found, out)
    return found


def require_possible(request: CompareRequest) -> None:
    """Refuse a request that is none, whatever the run: no scene and no regions, or an impossible alpha."""
    if not 0.0 < request.alpha < 1.0:
        raise ConfigError(f"--alpha: is {request.alpha:g}; allowed is above 0 and below 1, for instance 0.001")
    if request.scene is None and request.regions is None:
        raise ConfigError("give a scene file, or --regions FILE for a comparison without a scene")
    if request.scene is None and (request.rule is not None or request.switched_on or request.left_out):
        raise ConfigError("--effects, --with and --without: are of a prediction from a scene file; give one")


def _closed_loop(measurement: Measurement, given: RunCalibrations, request: CompareRequest) -> Comparison:
    if request.scale == "absolute" and given.radiometric is None:
        return compare_closed_loop(measurement, noise=given.noise, alpha=request.alpha)
    raise ConfigError("--scale and --radiometric are for a comparison with a scene file")


def _judged(comparison: Comparison, seen: DiagnosedRun, regions: list[Region]) -> Comparison:
    """Return a comparison with what the run says of itself: its checks, its faults, and what cannot be judged."""
    measurement, diagnosis = seen.measurement, seen.diagnosis
    registered = registration_of(measurement)
    checks = (*run_checks(measurement, registered, diagnosis), *nothing_tested(comparison.rows, comparison.not_tested))
    means = {name: prediction.channels.mean_dn for name, prediction in comparison.predictions.items()}
    budgets = with_registration(comparison.budgets, measurement, regions=regions, found=registered, means=means)
    unjudged = measurement.unmeasured | comparison.unjudged | refused_regions(checks)
    return replace(
        comparison,
        rows=without_decisions(comparison.rows, unjudged),
        checks=checks,
        budgets=with_diagnosis(budgets, diagnosis, measurement),
        unjudged=unjudged,
        run_diagnosis=diagnosis,
    )


def _to_its_errors(
    measurement: Measurement, scene: SceneFile, given: RunCalibrations, request: CompareRequest, tolerance: float
) -> tuple[Comparison, EffectsTaken, NumericalAccuracy]:
    """Return a comparison with a scene whose numerical errors are far below those of its rows, and what it took."""
    run = run_predictor(measurement, scene=scene, noise=given.noise)

    def compared(tried: NumericalAccuracy, coarser: Comparison | None = None) -> tuple[Comparison, NumericalAccuracy]:
        made = compare_with_scene(
            measurement,
            scene=without_effects(scene, tried.left_out),
            noise=given.noise,
            alpha=request.alpha,
            scale=request.scale,
            radiometric=given.radiometric,
            settings=tried.found.result.settings,
            light=run.light,
            coarser=coarser,
        )
        return made, tried.beside(made.rows, made.predictions)

    rule = request.rule or "safe"
    comparison, found = compared(accuracy_at(run, tolerance, rule))
    # Errors of rows are those of the first comparison; a second one is made with what they ask.
    chosen = found
    for _ in range(_MOST_TRIED):
        if chosen.next_tolerance is None:
            break
        finer = accuracy_at(run, chosen.next_tolerance, rule).beside(comparison.rows, comparison.predictions)
        # Where finer settings are not to be had, as of very deep air, a smaller tolerance changes nothing.
        if finer.share >= chosen.share:
            break
        chosen = finer
    if chosen is not found:
        comparison, found = compared(chosen, comparison)
    taken = EffectsTaken(plan=found.effects, taken=acting_effects(scene) - found.left_out)
    return replace(comparison, remarks=(*comparison.remarks, found.remark)), taken, found


def _outlined(request: CompareRequest) -> tuple[SceneFile | None, list[Region]]:
    """Return scene and regions; those of a scene with their outlines of now, where they were found again."""
    drawn = [] if request.regions is None else load_regions(request.regions)
    if request.scene is None:
        return None, drawn
    scene = with_choices(scene_file(request.scene), switched_on=request.switched_on, left_out=request.left_out)
    unknown = sorted({region.name for region in drawn}.difference(region.name for region in scene.regions))
    if unknown:
        raise ConfigError(
            f"--regions: scene {scene.name} has no region {', '.join(unknown)}; there are "
            f"{', '.join(region.name for region in scene.regions)}"
        )
    now = {region.name: {name: getattr(region, name) for name in _OUTLINE} for region in drawn}
    regions = [region.model_copy(update=now.get(region.name, {})) for region in scene.regions]
    return scene.model_copy(update={"regions": regions}), list(regions)


def _provenance(run_path: Path, request: CompareRequest, calibrations: CalibrationPaths) -> Provenance:
    files: dict[str, Path | SceneFile | None] = {
        "scene": request.scene,
        "regions": request.regions,
        **{str(kind): path for kind, path in calibrations.files.items()},
        "manifest": run_path / MANIFEST_FILE,
    }
    return Provenance(
        files={what: used_file(path) for what, path in files.items() if isinstance(path, Path)},
        alpha=request.alpha,
        scale=request.scale,
        anonymous=request.anonymous,
    )
