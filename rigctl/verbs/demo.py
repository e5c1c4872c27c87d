"""`rigctl demo`: the whole job on a simulated rig, from the noise session to the report."""

import shutil
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import note
from rigctl.errors import ConfigError
from rigctl.files.choices import Perturbation
from rigctl.verbs import calibrate
from rigctl.verbs.compare import ComparisonResult, compare_run, note_reports
from rigctl.verbs.options import FilePath, Writes

if TYPE_CHECKING:
    from rigctl.files.rig_file import RigFile

RUN, NOISE_RUN, NOISE = "run", "noise-run", "noise.json"
_EXAMPLES = ("rig-sim.toml", "session-noise.toml", "session.toml", "scene-panels.toml", "regions.toml")
_GIGE_ADDRESS = "sim:gige?pixel_format=Mono12Packed"


def demo(
    *,
    out: Annotated[FilePath, Writes(kind="new")] = Path("rigctl-demo"),
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1,
    perturb: Perturbation | None = None,
    alpha: Annotated[float, Parameter(validator=Number(gt=0.0, lt=1.0))] = 1e-3,
    gige: bool = False,
    lost: Annotated[float, Parameter(validator=Number(gte=0.0, lt=1.0))] = 0.0,
) -> ComparisonResult:
    """Run the whole job on a simulated rig: session, noise calibration, prediction, comparison and report.

    Model and measurement agree (exit code 0), because they differ only by noise. With --perturb, the rig changes after
    its calibration: they disagree (exit code 5), and the report names the likely cause.

    Example: rigctl demo --out /tmp/demo --perturb angle-offset

    Parameters
    ----------
    out : path
        New folder for example files, runs, calibration, prediction and report.
    seed : int
        Seed of the random numbers.
    perturb : {"gain", "angle-offset", "angle-sense", "extinction"}
        Change to the rig between calibration and session.
    alpha : float
        Probability of any false disagreement.
    gige : bool
        Send the pictures as GigE Vision packets (needs libaravis).
    lost : float
        With --gige: share of packets that are lost, 0 to 1.
    """
    from rigctl.files.rig_file import load_rig
    from rigctl.rig.roof import perturbed

    if lost and not gige:
        raise ConfigError(f"--lost: is {lost}; give --gige too")
    folder = Path(out)
    copy_examples(folder)
    rig = seeded(load_rig(folder / "rig-sim.toml"), seed)
    if gige:
        address = f"{_GIGE_ADDRESS}&lost={lost}" if lost else _GIGE_ADDRESS
        rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": address})})
    note("taking dark and flat frames")
    take(rig, folder, session="session-noise.toml", run=NOISE_RUN)
    note("calibrating the sensor's noise from them")
    calibrate.noise(run=folder / NOISE_RUN, out=folder / NOISE)
    if perturb is not None:
        note(f"changing the simulated rig: {perturb}")
        rig = perturbed(rig, perturb)
    note("taking the scene")
    take(rig, folder, session="session.toml", run=RUN)
    note("comparing with the model")
    scene, noise = folder / "scene-panels.toml", folder / NOISE
    found = compare_run(folder / RUN, scene=scene, noise=noise, calibrations="none", alpha=alpha)
    compared = ComparisonResult(comparison=found)
    note_reports(compared, folder)
    return compared


def copy_examples(out: Path) -> None:
    """Copy the example files into an empty or new folder."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"--out: {out} is not empty; give a folder that does not exist yet")
    out.mkdir(parents=True, exist_ok=True)
    with as_file(files("rigctl") / "data" / "examples") as examples:
        for name in _EXAMPLES:
            shutil.copyfile(examples / name, out / name)


def seeded(rig: "RigFile", seed: int) -> "RigFile":
    """Return a simulated rig with another seed."""
    if rig.simulation is None:
        raise ConfigError("--seed: is for a simulated rig")
    return rig.model_copy(update={"simulation": rig.simulation.model_copy(update={"seed": seed})})


def take(rig: "RigFile", out: Path, *, session: str, run: str) -> None:
    """Take one of the example sessions of a demo folder."""
    from rigctl.files.session_file import load_session
    from rigctl.session.take import take_session

    paths = {"rig": out / "rig-sim.toml", "session": out / session}
    take_session(rig, load_session(paths["session"]), out / run, files=paths)
