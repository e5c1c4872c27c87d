"""The whole job on a simulated rig: take the noise session, calibrate, take the scene, predict, compare, report."""

import shutil
from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path

from rigctl.comparison.comparison import Comparison
from rigctl.errors import ConfigError
from rigctl.files.choices import Perturbation
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.files.session_file import load_session
from rigctl.jobs.calibrate_noise import NoiseRequest, calibrate_noise
from rigctl.session.take_session import take_session
from rigctl.simulated.perturbation import perturbed
from rigctl.verbs.compare import ComparisonResult, compare_run

EXAMPLES = ("rig-sim.toml", "session-noise.toml", "session.toml", "scene-panels.toml", "regions.toml")
RUN, NOISE_RUN, NOISE = "run", "noise-run", "noise.json"
GIGE_ADDRESS = "sim:gige?pixel_format=Mono12Packed"

Say = Callable[[str], None]


def run_demo(
    out: Path,
    *,
    seed: int,
    perturbation: Perturbation | None,
    alpha: float,
    say: Say,
    gige: bool = False,
    lost_share: float = 0.0,
) -> Comparison:
    """Run the whole job into a folder; return the comparison, which is written there too.

    Parameters
    ----------
    out : Path
        Folder; it must not hold anything yet. Afterwards it holds the example files, `run`, `noise-run`,
        `noise.json`, `prediction.json`, `measurement.json`, `comparison.json` and `report.html`.
    seed : int
        Of all that is random in the simulated rig, >= 0.
    perturbation : str or None
        What changes in the rig between calibration and run.
    alpha : float
        Chance of any false disagreement.
    say : callable
        Told what is being done.
    gige : bool
        Pictures come as GigE Vision packets over this machine's own network.
    lost_share : float
        Share of these packets that are lost on their way, 0 to below 1.

    Raises
    ------
    ConfigError
        The folder holds something.
    """
    copy_examples(out)
    rig = seeded(load_rig(out / "rig-sim.toml"), seed)
    if gige:
        address = f"{GIGE_ADDRESS}&lost={lost_share}" if lost_share else GIGE_ADDRESS
        rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"address": address})})
    say("taking dark and flat frames")
    take(rig, out, session="session-noise.toml", run=NOISE_RUN)
    say("calibrating the sensor's noise from them")
    calibrate_noise(NoiseRequest(run=out / NOISE_RUN, out=out / NOISE))
    if perturbation is not None:
        say(f"changing the simulated rig: {perturbation}")
        rig = perturbed(rig, perturbation)
    say("taking the scene")
    take(rig, out, session="session.toml", run=RUN)
    say("comparing with the model")
    compared = compare_run(
        out / RUN, scene=out / "scene-panels.toml", noise=out / NOISE, calibrations="none", alpha=alpha
    )
    ComparisonResult(comparison=compared).write(out)
    return compared


def copy_examples(out: Path) -> None:
    """Copy the example files into a folder that holds nothing yet."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"--out: {out} holds something already; name a folder that does not exist yet")
    out.mkdir(parents=True, exist_ok=True)
    with as_file(files("rigctl") / "data" / "examples") as examples:
        for name in EXAMPLES:
            shutil.copyfile(examples / name, out / name)


def seeded(rig: RigFile, seed: int) -> RigFile:
    """Return a simulated rig with another seed."""
    if rig.simulation is None or seed < 0:
        raise ConfigError(f"--seed: is {seed}; allowed is 0 and above, for a simulated rig")
    return rig.model_copy(update={"simulation": rig.simulation.model_copy(update={"seed": seed})})


def take(rig: RigFile, out: Path, *, session: str, run: str) -> None:
    """Take one of the example sessions of a demo folder."""
    paths = {"rig": out / "rig-sim.toml", "session": out / session}
    take_session(rig, load_session(paths["session"]), out / run, files=paths)
