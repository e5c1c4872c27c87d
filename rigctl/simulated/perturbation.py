"""Changes of a simulated rig or roof on purpose, against what its files state, to show what a comparison finds."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from model.atmosphere.layers import AerosolKind
from rigctl.errors import ConfigError
from rigctl.files.choices import PERTURBATIONS, Perturbation, RoofChange
from rigctl.files.rig_file import RigFile
from rigctl.files.simulation_sections import SimulatedCamera, SimulatedPolarizer
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.scene.parameters import get, parameters, with_value
from rigctl.scene.scene_record import Scene

# Sizes, each far above what the demo resolves and of the size that goes unnoticed on a roof.
GAIN_FACTOR = 1.05
OFFSET_DEG = 2.0
EXTINCTION_RATIO = 25.0
# Sizes, such as go unnoticed on a roof.
VISIBILITY_FACTOR = 0.7
DHR_FACTOR = 1.2
TILT_DEG = 3.0
# A thin cloud that draws in and is gone.
CLOUD_SHARE, CLOUD_S = 0.2, 45.0

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


@dataclass(frozen=True, kw_only=True)
class ChangedRoof:
    """A scene that was changed, and how, in words."""

    scene: Scene
    text: str


def changed_roof(scene: Scene, what: RoofChange) -> ChangedRoof:
    """Return a scene with one thing changed; of "drift" the scene stays, and `cloud_factor` dims it.

    Parameters
    ----------
    scene : Scene
        With regions that are given by a material.
    what : str
        "visibility": 0.7 times as far, or the optical depth of the aerosol over 0.7 where that is stated; "aerosol":
        of another kind, spheres unless it is that; "dhr": 1.2 times that of the first material; "tilt": its region
        tilted by 3 deg more; "drift": the light falls by 20 % within 45 s, and is back.

    Raises
    ------
    ConfigError
        The scene has nothing to change.
    """
    changes: dict[RoofChange, Callable[[Scene], ChangedRoof]] = {
        "visibility": _visibility,
        "aerosol": _aerosol,
        "dhr": lambda roof: _of_first(roof, "dhr", lambda value: min(1.0, value * DHR_FACTOR)),
        "tilt": lambda roof: _of_first(roof, "tilt_deg", lambda value: value + TILT_DEG),
        "drift": lambda roof: ChangedRoof(
            scene=roof, text=f"drift: the light falls by {CLOUD_SHARE:.0%} within {CLOUD_S:g} s, and is back"
        ),
    }
    return changes[what](scene)


def cloud_factor(elapsed_ns: int) -> float:
    """Return by what the light is multiplied under "drift", at a time since the clock's begin [ns]."""
    share = (elapsed_ns / NS_PER_S % CLOUD_S) / CLOUD_S
    return 1.0 - CLOUD_SHARE * share


def _visibility(scene: Scene) -> ChangedRoof:
    known = {parameter.key for parameter in parameters(scene)}
    if "atmosphere.visibility_km" in known:
        return _changed(scene, "visibility", "atmosphere.visibility_km", lambda value: value * VISIBILITY_FACTOR)
    if "atmosphere.aerosol_optical_depth" in known:
        return _changed(
            scene, "visibility", "atmosphere.aerosol_optical_depth", lambda value: value / VISIBILITY_FACTOR
        )
    raise ConfigError("--perturb visibility: the scene states neither visibility_km nor aerosol_optical_depth")


def _aerosol(scene: Scene) -> ChangedRoof:
    air = scene.atmosphere
    if air is None or air.table is not None:
        raise ConfigError("--perturb aerosol: the sky of the scene is a table, not an aerosol")
    other = AerosolKind.DEPOLARIZING if air.aerosol is AerosolKind.SPHERES else AerosolKind.SPHERES
    changed = replace(scene, atmosphere=air.model_copy(update={"aerosol": other}))
    return ChangedRoof(scene=changed, text=f"aerosol: atmosphere.aerosol {other}, not {air.aerosol}")


def _of_first(scene: Scene, name: str, change: Callable[[float], float]) -> ChangedRoof:
    region = next(region.name for region in scene.regions if region.material is not None)
    return _changed(scene, name.removesuffix("_deg"), f"regions.{region}.{name}", change)


def _changed(scene: Scene, name: str, key: str, change: Callable[[float], float]) -> ChangedRoof:
    before = get(scene, key).value
    after = change(before)
    return ChangedRoof(scene=with_value(scene, key, after), text=f"{name}: {key} {after:g}, not {before:g}")
