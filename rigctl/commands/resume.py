"""``rigctl resume``: go on with a session."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.commands.acquire import say_outcome
from rigctl.runs.run_lock import writing_process
from rigctl.session.control import ask_process
from rigctl.session.take_session import resume_session
from rigctl.terminal import progress


def command(run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")]) -> None:
    """Go on with a session that holds, or that was interrupted: by a kill, a power cut, a full disk, a lost device.

    A session that is running and holds is told to go on. Else what is there is verified, whole frames that were not
    acknowledged are adopted, damaged ones are set aside, and it goes on at the first missing step.

    Example: rigctl resume runs/2026-05-04
    """
    process = writing_process(run)
    if process is not None:
        ask_process(run, process, "go on")
        progress().print(f"process {process} is told to go on", markup=False)
        return
    outcome = resume_session(run)
    if outcome.repair is not None:
        for finding in outcome.repair.adopted:
            progress().print(f"adopted: {finding.file}", markup=False)
        for finding in outcome.repair.set_aside:
            progress().print(f"set aside: {finding.file}: {finding.problem}", markup=False)
    say_outcome(outcome, run)
