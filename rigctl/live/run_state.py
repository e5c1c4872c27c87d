"""State of a session, as far as its run folder tells."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rigctl.live.live_status import LiveStatus, read_status
from rigctl.runs.run_events import TALLY_EVENT, RunEvent, read_events
from rigctl.runs.run_folder import read_contents
from rigctl.runs.run_lock import writing_process

State = Literal["running", "holding", "waiting", "finished", "stopped", "interrupted"]
_LAST_EVENTS = 5
_BYTES_PER_MB = 1e6
# Remarks on the side: they tell nothing of how a session stands.
_ASIDE = ("interlock", TALLY_EVENT, "disk is short")
_STATES: dict[str, State] = {"hold": "holding", "waiting": "waiting"}


@dataclass(frozen=True, kw_only=True)
class RunState:
    """State of a session.

    Attributes
    ----------
    run : str
        The folder.
    state : str
        "running", "holding" or "waiting" (for a round) where a process writes into it; else "finished", "stopped"
        on request, or "interrupted".
    process : int or None
        The process that writes into it.
    frames : int
        How many frames are durable.
    disk_free_mb : float
        What is free on the disk of the run [MB].
    live : LiveStatus or None
        What the session last said of itself: frames planned, remaining time, numbers per angle.
    events : tuple of RunEvent
        The last few.
    """

    run: str
    state: State
    process: int | None
    frames: int
    disk_free_mb: float
    live: LiveStatus | None
    events: tuple[RunEvent, ...]


def state_of(path: Path) -> RunState:
    """Return where the session of a run folder stands.

    Raises
    ------
    RunFolderError
        It is no run folder, or its events cannot be read.
    """
    contents = read_contents(path)
    process = writing_process(path)
    events = read_events(path)
    return RunState(
        run=str(path),
        state=session_state(process, [event.event for event in events]),
        process=process,
        frames=len(contents.frames),
        disk_free_mb=shutil.disk_usage(path).free / _BYTES_PER_MB,
        live=read_status(path),
        events=tuple(events[-_LAST_EVENTS:]),
    )


def session_state(process: int | None, events: list[str]) -> State:
    """Return how a session stands by the process that writes into its run, if any, and the names of its events."""
    last = next((name for name in reversed(events) if name not in _ASIDE), "")
    if process is not None:
        return _STATES.get(last, "running")
    if last == "finished":
        return "finished"
    return "stopped" if last == "stopped" else "interrupted"
