"""``rigctl demo``: the whole job on a simulated rig."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress
from rigctl.errors import ConfigError
from rigctl.files.choices import PERTURBATIONS


def command(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to make.")] = Path("rigctl-demo"),
    seed: Annotated[int, typer.Option(metavar="N", help="Of all that is random.")] = 1,
    perturb: Annotated[
        str | None,
        typer.Option(metavar="|".join(PERTURBATIONS), help="Change the rig between calibration and run."),
    ] = None,
    alpha: Annotated[float, typer.Option(metavar="A", help="Chance of any false disagreement.")] = 1e-3,
    gige: Annotated[
        bool, typer.Option("--gige", help="Pictures as GigE Vision packets over this machine's network (libaravis).")
    ] = False,
    lost: Annotated[
        float, typer.Option(metavar="SHARE", help="With --gige: share of packets that are lost, 0 to below 1.")
    ] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Run the whole job on a simulated rig: session, noise calibration, prediction, comparison, report.

    The simulated truth differs from what the model is told by nothing but noise, so both agree (exit code 0). With
    --perturb the rig changes after its calibration; they disagree (5), and the report says where that points.

    Example: rigctl demo --out /tmp/demo --perturb angle-offset
    """
    from rigctl.jobs.demo import run_demo
    from rigctl.verbs.compare import ComparisonResult

    if perturb is not None and perturb not in PERTURBATIONS:
        raise ConfigError(f"--perturb: is {perturb!r}; allowed are {', '.join(PERTURBATIONS)}")
    if not 0.0 <= lost < 1.0 or (lost and not gige):
        raise ConfigError(f"--lost: is {lost}; allowed is 0 to below 1, with --gige")
    console = progress()
    compared = run_demo(
        out,
        seed=seed,
        perturbation=perturb,
        alpha=alpha,
        say=lambda text: console.print(text, markup=False),
        gige=gige,
        lost_share=lost,
    )
    result = ComparisonResult(comparison=compared)
    if as_json:
        print_json(result.as_json())
    else:
        result.show()
        console.print(f"report: {out / 'report.html'}, {out / 'report.pdf'}", markup=False)
    if result.exit_code:
        raise typer.Exit(result.exit_code)
