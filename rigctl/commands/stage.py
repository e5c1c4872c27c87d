"""``rigctl stage``: what a rotation stage does by itself."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, progress, results, warn
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.devices.characterise import Characterisation, Side
    from rigctl.jobs.stage import CharacterisedStage, CharacteriseRequest

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def stage() -> None:
    """Measure a rotation stage by itself.

    Example: rigctl stage characterise examples/rig-sim.toml examples/session.toml --out stage.json
    """


@app.command("characterise")
def characterise_command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file; only its stage is opened.")],
    session: Annotated[
        Path | None, typer.Argument(metavar="[SESSION.toml]", help="Session file: its angles are visited.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.json", help="File to write, for the rig file.")] = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw errors and settling.")] = None,
    repeats: Annotated[int, typer.Option(metavar="N", min=2, max=1000, help="Visits from each side.")] = 3,
    watch_s: Annotated[float, typer.Option(metavar="S", min=0.1, max=60.0, help="How long to watch each.")] = 1.0,
    band_deg: Annotated[float, typer.Option(metavar="DEG", min=0.0, max=5.0, help="What counts as rest.")] = 0.01,
    as_json_too: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Visit the session's angles from both sides; tell readback error, backlash and the time until the stage rests.

    Name the file in the rig file, and every move of a session waits until the stage rests:

        [stage]
        characterisation = "stage.json"

    Play between encoder and polarizer does not show in readings.

    Example: rigctl stage characterise examples/rig-sim.toml examples/session.toml --out stage.json --plot stage.png
    """
    from rigctl.jobs.stage import CharacteriseRequest

    request = CharacteriseRequest(
        rig=rig, session=session, out=out, plot=plot, repeats=repeats, band_deg=band_deg, watch_s=watch_s
    )
    measured = _measured(request)
    if as_json_too:
        print_json(asdict(measured.file))
    else:
        _print(measured.result)


def _measured(request: "CharacteriseRequest") -> "CharacterisedStage":
    from rich.progress import Progress

    from rigctl.jobs.stage import characterise_stage

    with Progress(console=progress(), transient=True) as bar:
        task = bar.add_task("visits", total=None)

        def advance(visits: int) -> None:
            bar.update(task, advance=1, total=visits)

        return characterise_stage(request, progress=advance, warn=warn)


def _angle_table(result: "Characterisation") -> Table[float]:
    columns: tuple[Column[float], ...] = (
        Column(title="angle [deg]", text=lambda angle_deg: f"{angle_deg:.3f}"),
        Column(title="from below [deg]", text=lambda angle_deg: _mean_error(result, angle_deg, "forward")),
        Column(title="from above [deg]", text=lambda angle_deg: _mean_error(result, angle_deg, "backward")),
        Column(title="backlash [deg]", text=lambda angle_deg: f"{result.backlash_at_deg(angle_deg):+.4f}"),
        Column(title="at rest after [s]", text=lambda angle_deg: f"{_settle_s(result, angle_deg):.2f}"),
    )
    return Table(columns=columns, rows=tuple(result.angles_deg))


def _mean_error(result: "Characterisation", angle_deg: float, side: "Side") -> str:
    return f"{result.errors_deg(angle_deg, side).mean():+.4f}"


def _settle_s(result: "Characterisation", angle_deg: float) -> float:
    return max(visit.settle_s for visit in result.visits if visit.angle_deg == angle_deg)


def _print(result: "Characterisation") -> None:
    console = results()
    console.print(terminal_table(_angle_table(result)))
    identity = result.identity
    console.print(f"stage           {identity.model} {identity.serial_number}", markup=False)
    console.print(f"largest error   {result.largest_error_deg:.4f} deg", markup=False)
    console.print(f"repeatability   {result.repeatability_deg:.4f} deg (standard deviation)", markup=False)
    backlash = f"{result.backlash_deg:+.4f} ± {result.backlash_std_error_deg:.4f} deg"
    console.print(f"backlash        {backlash} (from above less from below)", markup=False)
    rest = (
        f"{result.settle_s:.2f} s" if result.is_settled else f"not within {result.watch_s:g} s: use a longer --watch-s"
    )
    console.print(f"at rest after   {rest}, within {result.band_deg:g} deg", markup=False)
