"""Planning which effects a scene calls for."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from model.effects.names import EffectPlan, EffectRule
from rigctl.calibrations.noise.noise_file import read_noise_file
from rigctl.errors import ConfigError
from rigctl.files.config import has_any_key
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.scene.effect_choice import with_choices
from rigctl.scene.effect_plan import Tell, Verification, plan_effects, verify_effects
from rigctl.scene.scene_light import SceneLight
from rigctl.scene.scene_reading import scene_of_file
from rigctl.simulated.rendering_costs import RenderingCosts, rendering_costs


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedEffects:
    """Every effect of the model with the decision on it.

    Attributes
    ----------
    plan : EffectPlan
        The decisions.
    verification : Verification or None
        What leaving out each truly changes, where that was asked for.
    remarks : tuple of str
        What is assumed.
    """

    plan: EffectPlan
    verification: Verification | None
    remarks: tuple[str, ...]


def effects_of_rig(path: Path) -> RenderingCosts | None:
    """Return what each effect of a simulated camera's pictures costs; None for a file that is no rig file.

    Raises
    ------
    ConfigError
        The rig file is wrong, or of a rig that is not simulated.
    """
    if not has_any_key(path, "stage", "camera", "simulation"):
        return None
    simulation = load_rig(path).simulation
    if simulation is None:
        raise ConfigError(f"{path}: has no [simulation]: a real camera's pictures go through no effects of ours")
    return rendering_costs(simulation)


def plan_scene_effects(
    scene: Path,
    *,
    tolerance: float = 0.01,
    verify: bool = False,
    switched_on: Sequence[str] = (),
    left_out: Sequence[str] = (),
    noise: Path | None = None,
    rule: EffectRule = "safe",
    tell: Tell | None = None,
) -> PlannedEffects:
    """Return which effects a scene calls for, and why.

    Parameters
    ----------
    scene : Path
        Scene file.
    tolerance : float
        Of a prediction, 1e-9 to 1; effects may take half of it.
    verify : bool
        Evaluate every effect, whether it acts or not, and its time.
    switched_on, left_out : sequence of str
        Names of effects that are forced.
    noise : Path or None
        Noise calibration, in place of the assumed noise.
    rule : {"safe", "estimated", "all"}
        By bounds, by estimates, or without leaving out what is there.
    tell : callable or None
        Told the optical depth of each wavelength before it is solved.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, a number is outside its range, or there is no such effect.
    """
    chosen = with_choices(load_scene(scene), switched_on=switched_on, left_out=left_out)
    record = scene_of_file(chosen, None if noise is None else read_noise_file(noise))
    planned = plan_effects(record, tolerance=tolerance, rule=rule, every_estimate=True, light=SceneLight(tell=tell))
    verification = verify_effects(planned, tell=tell) if verify else None
    return PlannedEffects(plan=planned.plan, verification=verification, remarks=planned.remarks)
