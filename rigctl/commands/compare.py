"""``rigctl compare``: model beside measurement."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.failures import EXIT_DATA, EXIT_DISAGREES
from rigctl.console.options import (
    CalibrationStore,
    Faults,
    FlatFile,
    ForceRegistration,
    PolarizerFile,
    RegistrationFile,
)
from rigctl.console.terminal import print_json, progress, results, solving_shown, warn
from rigctl.files.choices import EffectRule, ScaleKind
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.comparison.compared_run import ComparedRun
    from rigctl.comparison.comparison import Comparison
    from rigctl.jobs.compare import CompareRequest

_SHOWN = 20


def command(
    paths: Annotated[
        list[Path], typer.Argument(metavar="RUN... [SCENE.toml]", help="Run folders; a scene file may stand last.")
    ],
    *,
    scene: Annotated[Path | None, typer.Option(metavar="FILE", help="Scene file, if it does not stand last.")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for report and numbers.")],
    regions: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Regions file: without a scene, or the scene's where they are now."),
    ] = None,
    noise: Annotated[Path | None, typer.Option(metavar="FILE", help="Noise calibration. none: pick none.")] = None,
    scale: Annotated[
        ScaleKind,
        typer.Option(metavar="KIND", help="Of the counts: absolute, by a panel, or free (fitted to the run)."),
    ] = "absolute",
    radiometric: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Radiometric calibration, for --scale panel.")
    ] = None,
    register: RegistrationFile = None,
    force_registration: ForceRegistration = False,
    polarizer: PolarizerFile = None,
    flat: FlatFile = None,
    correct: Faults = None,
    store: CalibrationStore = None,
    rule: Annotated[
        EffectRule | None,
        typer.Option(
            "--effects",
            metavar="RULE",
            help="Leave effects of the light out by bounds (safe, the default), by estimates (estimated), none (all).",
        ),
    ] = None,
    switched_on: Annotated[list[str] | None, typer.Option("--with", metavar="NAME", help="Let an effect act.")] = None,
    left_out: Annotated[
        list[str] | None, typer.Option("--without", metavar="NAME", help="Leave an effect out, whatever its bound.")
    ] = None,
    alpha: Annotated[float, typer.Option(metavar="A", help="Chance of any false disagreement.")] = 1e-3,
    anonymous: Annotated[
        bool, typer.Option("--anonymous", help="Leave serial numbers, ports, site and folders out of the report.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Set a run beside what the model says of it; write report.html, report.pdf and the numbers as JSON and CSV.

    With a scene file the model predicts the run from the radiance of its regions. With --regions it predicts
    deviations and the law of DoLP from the run's own means. Ends with 0 where they agree, with 5 where not.

    --scale absolute takes optics and efficiency from the scene file; panel takes the counts per radiance of a
    radiometric calibration; free fits one factor to S0 of the run, and says it with its error.

    Several runs of one rig, such as an afternoon, share a scene file; each has its own sun: series.html has both sides
    against time and sun, a folder for each run has its own report. A run of another camera, gain or axis is refused.

    Numerical settings are chosen so that no numerical error is above 0.3 of its row's standard error; that and the
    tolerance are printed. Effects of the light are left out within a half of it: by their bounds, with --effects
    estimated by a coarse evaluation, with --effects all none. The report says which the scene calls for.

    Calibrations that are not named are picked from the store beside the rig file, if there is one (`calibrations`).

    Numbers of the scene file may be { value = 1.2, std = 0.1 } or { range = [1.0, 1.4] }: then errors of the inputs
    stand beside those of the measurement, and a disagreement says which input would explain it.

    Example: rigctl compare runs/panels examples/scene-panels.toml --noise noise.json --out compared
    """
    from rigctl.jobs.compare import CompareRequest
    from rigctl.measurement.found_faults import correctable
    from rigctl.measurement.picked_calibrations import calibration_paths

    runs, scene = _runs_and_scene(paths, scene)
    request = CompareRequest(
        scene=scene,
        regions=regions,
        calibrations=calibration_paths(
            {
                "noise": noise,
                "radiometric": radiometric,
                "registration": register,
                "flat": flat,
                "polarizer": polarizer,
            },
            store=store,
            force_registration=force_registration,
        ),
        alpha=alpha,
        scale=scale,
        correct=() if correct is None else correctable(correct),
        anonymous=anonymous,
        rule=rule,
        switched_on=tuple(switched_on or ()),
        left_out=tuple(left_out or ()),
    )
    if len(runs) > 1:
        _compare_many(runs, request, out=out, as_json=as_json)
    else:
        _compare_one(runs[0], request, out=out, as_json=as_json)


def _compare_one(run: Path, request: "CompareRequest", *, out: Path, as_json: bool) -> None:
    from rigctl.jobs.compare import compare_run
    from rigctl.reports.tables.comparison_json import compared_json

    with solving_shown():
        compared = compare_run(run, request, out=out)
    for line in () if compared.picked is None else compared.picked.lines:
        progress().print(line, markup=False)
    if as_json:
        print_json(compared_json(compared))
    else:
        show(compared, out)
    exit_by(compared.comparison.agrees)


def _runs_and_scene(paths: list[Path], scene: Path | None) -> tuple[list[Path], Path | None]:
    if scene is None and len(paths) > 1 and paths[-1].suffix == ".toml":
        return paths[:-1], paths[-1]
    return paths, scene


def _compare_many(runs: list[Path], request: "CompareRequest", *, out: Path, as_json: bool) -> None:
    from rigctl.jobs.series import compare_series
    from rigctl.reports.tables.series_tables import series_json

    with solving_shown():
        series = compare_series(runs, request, out=out)
    if as_json:
        print_json(series_json(series))
    else:
        for point, run in zip(series.points, series.runs, strict=True):
            accuracy = "" if run.accuracy is None else f"; numerical tolerance {run.accuracy.tolerance:.1e}"
            results().print(f"{point.name}: {_in_short(point.comparison)}{accuracy}", markup=False)
        results().print(f"report: {out / 'series.html'}, {out / 'series.pdf'}", markup=False)
    exit_by(series.agrees)


def exit_by(agrees: bool | None) -> None:
    """End with the exit code of a verdict: nothing where both sides agree."""
    if agrees is not True:
        raise typer.Exit(EXIT_DATA if agrees is None else EXIT_DISAGREES)


def _in_short(comparison: "Comparison") -> str:
    off = len(comparison.disagreements)
    if comparison.agrees is None:
        return "CANNOT BE JUDGED"
    return "agrees" if off == 0 else f"DISAGREES in {off} numbers"


def _why_not(comparison: "Comparison") -> tuple[str, ...]:
    from rigctl.comparison.verdict import refusals

    return refusals(comparison.checks) or tuple(dict.fromkeys(found.reason for found in comparison.regions.values()))


def show(compared: "ComparedRun", out: Path) -> None:
    """Print what the run shows of itself, the verdict, what disagrees, and where that points."""
    from rigctl.comparison.verdict import not_judged, reservations
    from rigctl.files.rig_file import PLACEHOLDER

    comparison, console = compared.comparison, results()
    run = compared.measurement.run
    if run.session.polarizer.placeholder:
        warn(f"{run.path}: {PLACEHOLDER}")
    if comparison.scale is not None:
        console.print(comparison.scale.remark)
    _show_run(comparison)
    if compared.accuracy is not None:
        console.print(compared.accuracy.remark, markup=False)
    for weak in comparison.weak:
        console.print(f"hardly tested: {weak}", markup=False)
    tests = sum(row.agrees is not None for row in comparison.rows)
    held_with = reservations(comparison.checks, comparison.regions)
    reserved = f", with reservations ({held_with})" if held_with else ""
    if comparison.agrees is None:
        for why in _why_not(comparison):
            warn(why)
        console.print(not_judged(comparison.checks), markup=False)
    elif tests == 0:
        console.print(f"nothing was tested{reserved}", markup=False)
    elif comparison.agrees:
        text = f"model and measurement agree{reserved}: {tests} numbers tested at alpha = {comparison.alpha:g}"
        console.print(text + _beside_themselves(comparison, tests), markup=False)
    else:
        _show_disagreements(comparison, tests)
    console.print(f"report: {out / 'report.html'}, {out / 'report.pdf'}", markup=False)


def _beside_themselves(comparison: "Comparison", tests: int) -> str:
    """Return how many numbers of a closed loop are no tests, in words."""
    left_out = len(comparison.rows) - tests
    if comparison.kind != "closed loop" or not left_out:
        return ""
    return f"; {left_out} that stand beside themselves are not counted"


def _show_run(comparison: "Comparison") -> None:
    from rigctl.comparison.verdict import said_of, unjudged_lines
    from rigctl.measurement.fault_terms import term_text

    console = results()
    if comparison.run_diagnosis is not None:
        for term in comparison.run_diagnosis.named:
            console.print(f"the run shows {term_text(term)}", markup=False)
    shown = ("flagged",) if comparison.agrees is None else ("flagged", "refused")
    for title, text in said_of(comparison.checks, *shown):
        console.print(f"{title}: {text}", markup=False)
    if comparison.agrees is None:
        return
    for line in unjudged_lines(comparison.regions, comparison.checks):
        console.print(line, markup=False)


def _show_disagreements(comparison: "Comparison", tests: int) -> None:
    from rigctl.reports.tables.row_table import row_table

    console = results()
    off = sorted(comparison.disagreements, key=lambda row: -abs(row.z or 0.0))
    beside = _beside_themselves(comparison, tests)
    console.print(
        f"model and measurement DISAGREE in {len(off)} of {tests} numbers (alpha = {comparison.alpha:g}){beside}",
        markup=False,
    )
    console.print(terminal_table(row_table(off[:_SHOWN])))
    for cause, advice in zip(comparison.diagnosis.points_to, comparison.diagnosis.advice, strict=True):
        console.print(f"points to {cause}: {advice}", markup=False)
    if comparison.attribution is not None:
        console.print(f"what would explain it: {comparison.attribution.remark}", markup=False)
