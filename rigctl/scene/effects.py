"""Planning of effects: those that a scene calls for, and what leaving the others out truly changes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from model.accuracy.effect_check import CheckedEffect, chain_time_s, check_effects, skylight_bound
from model.accuracy.plan import optical_depth
from model.accuracy.predict import SMALLEST
from model.effects.bounds import may_be_small
from model.effects.names import ALL, Effect, EffectPlan, EffectRule
from model.effects.planner import plan, plan_of_all
from rigctl.errors import as_config_error
from rigctl.scene.light import SceneLight, lit_scene, readout_of, sensor_of, settings_of
from rigctl.scene.scene import forced_effects

if TYPE_CHECKING:
    from model.accuracy.chain import LightStore, Settings
    from model.scene.scene import LitScene, Readout
    from rigctl.scene.scene import Scene

# Told the optical depth of each wavelength before it is solved.
Tell = Callable[[float], None]

# Share of a tolerance that may go to effects that are left out; numerical settings have the rest.
SHARE = 0.5
# Optical depth below which the sky may be left out.
_THIN = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedScene:
    """A scene with the decisions on its effects."""

    scene: "LitScene"  #: What was planned.
    settings: "Settings"
    plan: EffectPlan  #: The decisions.
    remarks: tuple[str, ...]  #: What is assumed.


@dataclass(frozen=True, kw_only=True, eq=False)
class Verification:
    """All effects, evaluated one at a time, whether they act or not."""

    checked: tuple[CheckedEffect, ...]  #: One for each.
    #: Time of the whole chain with all effects and with those that act, nothing being kept from before [s].
    all_s: float
    planned_s: float

    @property
    def violations(self) -> tuple[CheckedEffect, ...]:
        """Those that changed more than their bound."""
        return tuple(one for one in self.checked if not one.holds)


def plan_effects(
    scene: "Scene",
    *,
    tolerance: float,
    rule: EffectRule = "safe",
    readout: "Readout | None" = None,
    exposure_s: float | None = None,
) -> PlannedScene:
    """Return which effects a scene calls for at a tolerance, of which these may take one half."""
    settings = settings_of(scene)
    sensor = sensor_of(scene, scene.exposure_s if exposure_s is None else exposure_s)
    lit = lit_scene(scene, sensor=sensor, readout=readout_of(scene) if readout is None else readout)
    with as_config_error(f"scene {scene.name}"):
        found = plan(
            lit,
            tolerance=SHARE * tolerance,
            forced=forced_effects(scene),
            rule=rule,
            sharper=partial(skylight_bound, lit),
        )
    return PlannedScene(scene=lit, settings=settings, plan=found, remarks=(*scene.remarks, *found.remarks))


def plan_for_prediction(
    lit: "LitScene",
    *,
    tolerance: float,
    forced: Mapping[Effect, bool],
    rule: EffectRule,
    is_of_many: bool,
) -> EffectPlan:
    """Return which effects a scene calls for where finding that out must cost less than what it saves.

    Of one scene in daylight an estimate costs more than what it may leave out: the sky is solved either way. So does a
    bound, but of a narrow band or field. Effects other than those of the light are not estimated: they cost nothing.
    """
    # The least tolerance has nothing to share.
    share = SHARE * tolerance if tolerance * (1.0 - SHARE) >= SMALLEST else 0.0
    if rule == "all":
        return plan_of_all(forced, tolerance=share)

    depth = optical_depth(lit)
    pays = is_of_many or depth < _THIN
    return plan(
        lit,
        tolerance=share,
        forced=forced,
        sharper=partial(skylight_bound, lit),
        asked=pays or may_be_small(lit, depth=depth, tolerance=share),
    )


def verify_effects(planned: PlannedScene, *, tell: Tell | None = None) -> Verification:
    """Return what leaving out each effect truly changes, whether it acts or not."""
    bounds = {one.effect: one.bound for one in planned.plan.decisions}

    def empty() -> "LightStore":
        return SceneLight(is_kept_between_runs=False, tell=tell).lights

    def time_s(effects: frozenset[Effect]) -> float:
        return chain_time_s(planned.scene, planned.settings, effects, make_store=empty)

    with as_config_error("--verify"):
        return Verification(
            checked=check_effects(planned.scene, planned.settings, bounds, make_store=empty),
            all_s=time_s(ALL),
            planned_s=time_s(planned.plan.active),
        )
