"""``rigctl resume``: go on with a session."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.commands.acquire import say_outcome
from rigctl.terminal import progress


def command(run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")]) -> None:
    """Go on with a session that holds, or that was interrupted: by a kill, a power cut, a full disk, a lost device.

    A session that is running and holds is told to go on. Else what is there is verified, whole frames that were not
    acknowledged are adopted, damaged ones are set aside, and it goes on at the first missing step.

    Example: rigctl resume runs/2026-05-04
    """
    from rigctl.jobs.resume import resume

    resumed = resume(run)
    if resumed.outcome is None:
        progress().print(f"process {resumed.process} is told to go on", markup=False)
        return
    repair = resumed.outcome.repair
    if repair is not None:
        for finding in repair.adopted:
            progress().print(f"adopted: {finding.file}", markup=False)
        for finding in repair.set_aside:
            progress().print(f"set aside: {finding.file}: {finding.problem}", markup=False)
    say_outcome(resumed.outcome, run)
