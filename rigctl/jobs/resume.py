"""Going on with a session: one that holds is told to, one that was interrupted is taken to its end."""

from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import RunFolderError
from rigctl.runs.run_lock import writing_process
from rigctl.session.control import Request, ask_process
from rigctl.session.reconnect_loop import Outcome


@dataclass(frozen=True, kw_only=True)
class Resumed:
    """Result: the process that was told to go on, or how the rest of the session went."""

    process: int | None = None
    outcome: Outcome | None = None


def resume(run: Path, *, asks_by_hold: bool = False) -> Resumed:
    """Go on with a session.

    Parameters
    ----------
    run : Path
        Run folder.
    asks_by_hold : bool
        Where hands are needed, hold until somebody says to go on; else ask at the terminal.

    Raises
    ------
    ConfigError, DeviceError, RunFolderError
        The run was not made by a session, its devices are others now, one fails, or the folder cannot be written.
    """
    process = writing_process(run)
    if process is not None:
        ask_process(run, process, "go on")
        return Resumed(process=process)
    from rigctl.session.take_session import resume_session  # devices and their libraries: not to send a request

    return Resumed(outcome=resume_session(run, asks_by_hold=asks_by_hold))


def ask_running(run: Path, request: Request) -> int:
    """Leave a request for the session that writes into a run; return its process.

    Raises
    ------
    RunFolderError
        No process writes into this run.
    """
    process = writing_process(run) if run.is_dir() else None
    if process is None:
        raise RunFolderError(f"{run}: no session writes into this run; look at `rigctl status {run}`")
    ask_process(run, process, request)
    return process
