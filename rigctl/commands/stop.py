"""``rigctl stop``: ask a running session to stop between two frames."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.commands.request import request_of_running


def command(run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")]) -> None:
    """Ask the session that writes into a run to stop, between two frames. `rigctl resume` goes on.

    Example: rigctl stop runs/2026-05-04
    """
    request_of_running(run, "stop")
