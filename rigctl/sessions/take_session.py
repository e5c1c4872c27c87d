"""One session from its files to its run folder, with a progress bar."""

from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from rigctl.config import sha256_of
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.acquisition import acquire
from rigctl.sessions.plan import Step, plan_steps
from rigctl.sessions.rig import Rig, open_rig
from rigctl.terminal import progress as progress_console

# What decides the numbers in a run; their versions go into it.
_PACKAGES = ("rigctl", "numpy", "pyserial")


def take_session(rig_file: RigFile, session: SessionFile, out: Path, *, files: dict[str, Path]) -> int:
    """Take a session; return the number of frames.

    Parameters
    ----------
    rig_file, session
        What to take, and with which devices.
    out : Path
        Run folder to make.
    files : dict
        What the two were read from; names and hashes go into the run.

    Raises
    ------
    ConfigError, DeviceError, RunFolderError
        The rig cannot be, a device fails, or the folder cannot be written.
    """
    steps = plan_steps(session)
    with open_rig(rig_file, session_name=session.name) as rig:
        description = _describe(rig, rig_file, session, files)
        with RunWriter.create(out, description) as writer:
            _acquire_with_bar(rig, rig_file, steps, writer, title=session.name)
    return len(steps)


def _acquire_with_bar(rig: Rig, rig_file: RigFile, steps: tuple[Step, ...], writer: RunWriter, *, title: str) -> None:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=progress_console(), transient=True) as bar:
        task = bar.add_task(title, total=len(steps))
        acquire(rig, rig_file, steps, writer, progress=lambda _: bar.advance(task))


def _describe(rig: Rig, rig_file: RigFile, session: SessionFile, files: dict[str, Path]) -> dict[str, Any]:
    """Return all that a reader of the run must know of how it came about, as JSON can hold it."""
    return {
        "origin": rig.origin,
        "rig": rig_file.model_dump(mode="json"),
        "session": session.model_dump(mode="json"),
        "files": {what: {"name": path.name, "sha256": sha256_of(path)} for what, path in files.items()},
        "stage": vars(rig.stage_identity),
        "camera": vars(rig.camera_identity),
        "versions": {package: version(package) for package in _PACKAGES},
    }
