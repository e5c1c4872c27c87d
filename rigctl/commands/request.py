"""Asks something of a session that runs in another process."""

from pathlib import Path

from rigctl.errors import RunFolderError
from rigctl.runs.run_lock import writing_process
from rigctl.session.control import Request, ask_process
from rigctl.terminal import progress


def request_of_running(run: Path, request: Request) -> None:
    """Leave a request for the session that writes into a run.

    Raises
    ------
    RunFolderError
        No process writes into this run.
    """
    process = writing_process(run) if run.is_dir() else None
    if process is None:
        raise RunFolderError(f"{run}: no session writes into this run; look at `rigctl status {run}`")
    ask_process(run, process, request)
    progress().print(f"process {process} is asked to {request} after this frame", markup=False)
