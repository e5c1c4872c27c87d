"""Asks something of a session that runs in another process."""

from pathlib import Path
from typing import Literal

from rigctl.console.terminal import progress


def request_of_running(run: Path, request: Literal["hold", "stop"]) -> None:
    """Leave a request for the session that writes into a run, and say so."""
    from rigctl.jobs.resume import ask_running

    process = ask_running(run, request)
    progress().print(f"process {process} is asked to {request} after this frame", markup=False)
