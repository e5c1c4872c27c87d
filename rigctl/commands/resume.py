"""``rigctl resume``: go on with a session."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.commands.acquire import say_outcome
from rigctl.console.failures import EXIT_INCOMPLETE
from rigctl.console.json_text import Json
from rigctl.console.terminal import print_json, progress, warn
from rigctl.files.choices import Asked
from rigctl.session.control import outliving_terminal

if TYPE_CHECKING:
    from rigctl.jobs.resume import Resumed
    from rigctl.session.reconnect_loop import Outcome


@outliving_terminal()
def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    ask: Annotated[
        Asked,
        typer.Option(help="Where somebody has to cover the lens: ask at the terminal, or hold until `rigctl resume`."),
    ] = Asked.TERMINAL,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Go on with a session that holds, or that was interrupted: by a kill, a power cut, a full disk, a lost device.

    A session that is running and holds is told to go on. Else what is there is verified, whole frames that were not
    acknowledged are adopted, damaged ones are set aside, and it goes on at the first missing step.

    Example: rigctl resume runs/2026-05-04
    """
    from rigctl.jobs.resume import resume

    resumed = resume(run, asks_by_hold=ask is Asked.HOLD)
    if as_json:
        _answer(resumed, run)
    elif resumed.outcome is None:
        progress().print(f"process {resumed.process} is told to go on", markup=False)
    else:
        _say(resumed.outcome, run)


def _answer(resumed: "Resumed", run: Path) -> None:
    """Answer programs: the process that goes on, or how the rest went, with the exit code for it."""
    outcome = resumed.outcome
    content: dict[str, Json] = {"run": str(run), "process": resumed.process}
    if outcome is not None:
        content |= {
            "frames": outcome.frames,
            "planned": outcome.planned,
            "is_finished": outcome.is_finished,
            "was_finished": outcome.was_finished,
            "adopted": [] if outcome.repair is None else [found.file for found in outcome.repair.adopted],
            "set_aside": [] if outcome.repair is None else [found.file for found in outcome.repair.set_aside],
        }
    print_json(content)
    if outcome is not None and not outcome.is_finished:
        raise typer.Exit(EXIT_INCOMPLETE)


def _say(outcome: "Outcome", run: Path) -> None:
    from rigctl.files.rig_file import unset_polarizer
    from rigctl.runs.run_folder import read_run

    repair = outcome.repair
    if repair is not None:
        for finding in repair.adopted:
            progress().print(f"adopted: {finding.file}", markup=False)
        for finding in repair.set_aside:
            progress().print(f"set aside: {finding.file}: {finding.problem}", markup=False)
    for doubt in unset_polarizer(run, placeholder=read_run(run).session.polarizer.placeholder):
        warn(doubt)
    say_outcome(outcome, run)
