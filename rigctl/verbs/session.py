"""Sessions: take one, go on with it, hold it, stop it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from rigctl.console.json_text import Json
from rigctl.console.terminal import note, warn
from rigctl.errors import RunFolderError
from rigctl.verbs.options import RunPath, path_of
from rigctl.verbs.result import Part, Result

if TYPE_CHECKING:
    from rigctl.session.control import Request
    from rigctl.session.reconnect_loop import Outcome

#: Where somebody has to cover the lens: ask at the terminal, or hold until `rigctl resume`.
Ask: TypeAlias = Literal["terminal", "hold"]


def resume(run: RunPath, /, *, ask: Ask = "terminal") -> "SessionResult":
    """Go on with a session that holds, or that was interrupted: by a kill, a power cut, a full disk, a lost device.

    A session that is running and holds is told to go on. Otherwise the run is verified, whole frames that were not
    acknowledged are adopted, damaged ones are set aside, and the session goes on at the first missing step.

    Example: rigctl resume runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.
    ask : {"terminal", "hold"}
        Where somebody has to cover the lens: ask at the terminal, or hold until `rigctl resume`.

    Returns
    -------
    SessionResult
        The process that was told to go on, or how the rest of the session went.

    Raises
    ------
    ConfigError, DeviceError, RunFolderError
        The run was not made by a session, its devices are others now, one fails, or the folder cannot be written.
    """
    from rigctl.runs.run_lock import writing_process
    from rigctl.session.control import ask_process, outliving_terminal

    folder = path_of(run)
    with outliving_terminal():
        process = writing_process(folder)
        if process is not None:
            ask_process(folder, process, "go on")
            return SessionResult(path=folder, process=process)
        from rigctl.files.rig_file import unset_polarizer
        from rigctl.runs.run_folder import read_run
        from rigctl.session.take_session import resume_session

        outcome = resume_session(folder, asks_by_hold=ask == "hold")
    if outcome.repair is not None:
        for finding in outcome.repair.adopted:
            note(f"adopted: {finding.file}")
        for finding in outcome.repair.set_aside:
            note(f"set aside: {finding.file}: {finding.problem}")
    for doubt in unset_polarizer(folder, placeholder=read_run(folder).session.polarizer.placeholder):
        warn(doubt)
    return SessionResult(path=folder, outcome=outcome)


def hold(run: RunPath, /) -> "Asked":
    """Ask the session that writes into a run to hold, between two frames. `rigctl resume` goes on.

    Example: rigctl hold runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.

    Raises
    ------
    RunFolderError
        No session writes into this run.
    """
    return _ask_running(path_of(run), "hold")


def stop(run: RunPath, /) -> "Asked":
    """Ask the session that writes into a run to stop, between two frames. `rigctl resume` goes on.

    Example: rigctl stop runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.

    Raises
    ------
    RunFolderError
        No session writes into this run.
    """
    return _ask_running(path_of(run), "stop")


def _ask_running(run: Path, request: "Request") -> "Asked":
    from rigctl.runs.run_lock import writing_process
    from rigctl.session.control import ask_process

    process = writing_process(run) if run.is_dir() else None
    if process is None:
        raise RunFolderError(f"{run}: no session writes into this run; look at `rigctl status {run}`")
    ask_process(run, process, request)
    return Asked(path=run, process=process, request=request)


@dataclass(frozen=True, kw_only=True)
class Asked(Result):
    """A request to the session that writes into a run."""

    path: Path
    process: int  #: that writes into the run
    request: str

    def content(self) -> Iterable[Part]:
        """Return the request in words."""
        yield f"process {self.process} is asked to {self.request} after this frame"

    def as_json(self) -> dict[str, Json]:
        """Return run, process and request."""
        return {"run": str(self.path), "process": self.process, "request": self.request}


@dataclass(frozen=True, kw_only=True)
class SessionResult(Result):
    """How a session went, or the process that was told to go on with it."""

    path: Path  #: run folder
    process: int | None = None  #: that goes on; None where the session has ended
    outcome: "Outcome | None" = None  #: frames taken and planned; None while the session runs

    @property
    def exit_code(self) -> int:
        """75 where the session ended before its last frame, as schedulers understand it."""
        from rigctl.console.failures import EXIT_INCOMPLETE

        return 0 if self.outcome is None or self.outcome.is_finished else EXIT_INCOMPLETE

    def content(self) -> Iterable[Part]:
        """Return the number of frames, and how to go on."""
        outcome = self.outcome
        if outcome is None:
            yield f"process {self.process} is told to go on"
        elif outcome.was_finished:
            yield f"nothing to do: this session is finished, {outcome.frames} frames in {self.path}"
        elif outcome.is_finished:
            yield f"{outcome.frames} frames in {self.path}"
        else:
            yield f"{outcome.frames} of {outcome.planned} frames in {self.path}; rigctl resume {self.path} goes on"

    def as_json(self) -> dict[str, Json]:
        """Return the process that goes on, or frames, and what was adopted and set aside before."""
        content: dict[str, Json] = {"run": str(self.path), "process": self.process}
        outcome = self.outcome
        if outcome is None:
            return content
        return content | {
            "frames": outcome.frames,
            "planned": outcome.planned,
            "is_finished": outcome.is_finished,
            "was_finished": outcome.was_finished,
            "adopted": [] if outcome.repair is None else [found.file for found in outcome.repair.adopted],
            "set_aside": [] if outcome.repair is None else [found.file for found in outcome.repair.set_aside],
        }
