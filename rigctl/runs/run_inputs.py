"""The files that a run was made from: kept in it, and read back out of it."""

from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.config import describe
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.runs.run_description import SESSION_FILE
from rigctl.runs.run_folder import INPUTS_FOLDER, Run
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded
from rigctl.storage.durable_file import flush_folder, write_durably


def read_inputs(rig_file: RigFile, files: dict[str, Path]) -> dict[str, bytes]:
    """Return the files that a person wrote, and the scene that a simulated rig looks at, by what they are.

    Raises
    ------
    ConfigError
        One cannot be read.
    """
    scene = {} if rig_file.simulation is None else {"scene": rig_file.simulation.scene}
    try:
        return {what: read_bounded(path, MOST_TEXT_BYTES) for what, path in (files | scene).items()}
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be read: {error.strerror}") from error


def keep_inputs(inputs: Mapping[str, bytes], out: Path) -> None:
    """Write the inputs into the run.

    Raises
    ------
    RunFolderError
        They cannot be written.
    """
    folder = out / INPUTS_FOLDER
    if not inputs:
        return
    try:
        folder.mkdir(exist_ok=True)
        for what, content in inputs.items():
            write_durably(folder / f"{what}.toml", content)
        flush_folder(out)
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written: {error.strerror}") from error


def files_of(run: Run) -> tuple[RigFile, SessionFile]:
    """Return rig and session file as a run holds them.

    Raises
    ------
    RunFolderError, ConfigError
        The run was not made by a session, or what it holds is no such file.
    """
    if not run.session.is_of_session:
        raise RunFolderError(f"{run.path}: was not made by `rigctl acquire`: there is nothing to go on with")
    try:
        rig_file = RigFile.model_validate(run.session_json["rig"])
        session = SessionFile.model_validate(run.session_json["session"])
    except ValidationError as error:
        raise ConfigError(describe(run.path / SESSION_FILE, error)) from error
    kept = run.path / INPUTS_FOLDER / "scene.toml"
    if rig_file.simulation is None or rig_file.simulation.scene.exists() or not kept.exists():
        return rig_file, session
    return rig_file.model_copy(
        update={"simulation": rig_file.simulation.model_copy(update={"scene": kept.resolve()})}
    ), session
