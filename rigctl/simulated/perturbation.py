"""Changes of the demo's simulated rig between calibration and run, to show that the report finds them."""

from collections.abc import Callable

from rigctl.errors import ConfigError
from rigctl.files.choices import PERTURBATIONS, Perturbation
from rigctl.files.rig_file import RigFile, SimulatedCamera, SimulatedPolarizer

# Sizes, each far above what the demo resolves and of the size that goes unnoticed on a roof.
GAIN_FACTOR = 1.05
OFFSET_DEG = 2.0
EXTINCTION_RATIO = 25.0

_POLARIZER: dict[str, Callable[[SimulatedPolarizer], dict[str, float]]] = {
    "angle-offset": lambda truth: {"offset_deg": truth.offset_deg + OFFSET_DEG},
    "angle-sense": lambda truth: {"sense": -truth.sense},
    "extinction": lambda _: {"extinction_ratio": EXTINCTION_RATIO},
}


def perturbed(rig: RigFile, what: Perturbation) -> RigFile:
    """Return the rig with one thing of its simulated truth changed; what the rig file states stays as it is.

    Parameters
    ----------
    rig : RigFile
        A simulated rig.
    what : str
        "gain": 5 % more counts per electron; "angle-offset": the axis turned by 2 deg; "angle-sense": the stage
        turns the other way; "extinction": an extinction ratio of 25.

    Raises
    ------
    ConfigError
        The rig is not simulated, or there is no such perturbation.
    """
    if rig.simulation is None:
        raise ConfigError("only a simulated rig can be perturbed")
    if what not in PERTURBATIONS:
        raise ConfigError(f"--perturb: is {what!r}; allowed are {', '.join(PERTURBATIONS)}")
    truth = rig.simulation
    changed: dict[str, SimulatedCamera | SimulatedPolarizer]
    if what == "gain":
        gain = truth.camera.gain_dn_per_e * GAIN_FACTOR
        changed = {"camera": truth.camera.model_copy(update={"gain_dn_per_e": gain})}
    else:
        changed = {"polarizer": truth.polarizer.model_copy(update=_POLARIZER[what](truth.polarizer))}
    return rig.model_copy(update={"simulation": truth.model_copy(update=changed)})
