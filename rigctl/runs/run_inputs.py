"""The files that a run was made from: kept in it, and read back out of it."""

import shutil
from pathlib import Path

from pydantic import ValidationError

from rigctl.config import describe
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.runs.run_description import SESSION_FILE
from rigctl.runs.run_folder import Run

INPUTS_FOLDER = "inputs"


def keep_inputs(rig_file: RigFile, files: dict[str, Path], out: Path) -> None:
    """Copy the files that a person wrote into the run, and the scene that a simulated rig looks at."""
    folder = out / INPUTS_FOLDER
    scene = {} if rig_file.simulation is None else {"scene": rig_file.simulation.scene}
    for what, path in (files | scene).items():
        folder.mkdir(exist_ok=True)
        shutil.copyfile(path, folder / f"{what}.toml")


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
