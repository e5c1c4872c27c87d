"""``rigctl compare``: model beside measurement."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli import EXIT_DISAGREES
from rigctl.comparison.scale import ScaleKind
from rigctl.reports.compare_run import ComparedRun, compare_run
from rigctl.reports.number_table import row_table
from rigctl.terminal import print_json, results

_SHOWN = 20


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    scene: Annotated[Path | None, typer.Argument(metavar="[SCENE.toml]", help="Scene file.")] = None,
    *,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for report and numbers.")],
    regions: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Regions file: without a scene, or the scene's where they are now."),
    ] = None,
    noise: Annotated[Path | None, typer.Option(metavar="FILE", help="Noise calibration.")] = None,
    scale: Annotated[
        ScaleKind,
        typer.Option(metavar="KIND", help="Of the counts: absolute, by a panel, or free (fitted to the run)."),
    ] = "absolute",
    radiometric: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Radiometric calibration, for --scale panel.")
    ] = None,
    register: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Registration: move frames to lie on one another.")
    ] = None,
    flat: Annotated[Path | None, typer.Option(metavar="FILE", help="Flat fields: divide frames by them.")] = None,
    alpha: Annotated[float, typer.Option(metavar="A", help="Chance of any false disagreement.")] = 1e-3,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Set a run beside what the model says of it; write report.html, comparison.json and the numbers of both sides.

    With a scene file the model predicts the run from the radiance of its regions. With --regions it predicts
    deviations and the law of DoLP from the run's own means. Ends with 0 where they agree, with 5 where not.

    --scale absolute takes optics and efficiency from the scene file; panel takes the counts per radiance of a
    radiometric calibration; free fits one factor to S0 of the run, and says it with its error.

    Example: rigctl compare runs/panels examples/scene-panels.toml --noise noise.json --out compared
    """
    compared = compare_run(
        run,
        scene_path=scene,
        regions_path=regions,
        noise_path=noise,
        alpha=alpha,
        scale=scale,
        radiometric_path=radiometric,
        registration_path=register,
        flat_path=flat,
    )
    compared.write(out)
    if as_json:
        print_json(compared.as_json())
    else:
        show(compared, out)
    if not compared.comparison.agrees:
        raise typer.Exit(EXIT_DISAGREES)


def show(compared: ComparedRun, out: Path) -> None:
    """Print the verdict, what disagrees, and where that points."""
    comparison, console = compared.comparison, results()
    if comparison.scale is not None:
        console.print(comparison.scale.remark)
    for check in comparison.flags:
        console.print(f"flagged, {check.name}: {check.text}", markup=False)
    tests = sum(row.agrees is not None for row in comparison.rows)
    if tests == 0:
        console.print("nothing was tested: " + "; ".join(comparison.not_tested), markup=False)
    elif comparison.agrees:
        console.print(f"model and measurement agree: {tests} numbers tested at alpha = {comparison.alpha:g}")
    else:
        off = sorted(comparison.disagreements, key=lambda row: -abs(row.z or 0.0))
        console.print(f"model and measurement DISAGREE in {len(off)} of {tests} numbers (alpha = {comparison.alpha:g})")
        console.print(row_table(off[:_SHOWN], title=""))
        for cause, advice in zip(comparison.diagnosis.points_to, comparison.diagnosis.advice, strict=True):
            console.print(f"points to {cause}: {advice}", markup=False)
        if comparison.explanation is not None:
            console.print(f"what would explain it: {comparison.explanation.remark}", markup=False)
    console.print(f"report: {out / 'report.html'}, {out / 'report.pdf'}", markup=False)
