"""Planning of effects: needed ones, changes by leaving others out, and effects that are not stated."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import degrees
from typing import TYPE_CHECKING

from model.accuracy.effect_check import CheckedEffect, chain_time_s, check_effects, skylight_bound, with_changes
from model.accuracy.plan import NUMERICAL_SETTINGS, WAVELENGTHS, settings_at
from model.accuracy.predict import SMALLEST
from model.effects.effect import Effect, EffectPlan, EffectRule
from model.effects.planner import EFFECTS, plan, plan_of_all
from rigctl.errors import as_config_error
from rigctl.scene.light import SceneLight, lit_scene, settings_of
from rigctl.scene.scene import forced_effects

if TYPE_CHECKING:
    from model.accuracy.chain import LightStore, Settings
    from model.scene.scene import LitScene, Readout
    from rigctl.scene.scene import Scene

# Called with the optical depth of each wavelength before it is solved.
Tell = Callable[[float], None]

# Share of a tolerance for effects that are left out; numerical settings have the rest.
SHARE = 0.5
# Levels at which sizes of effects are evaluated: two digits, in a second.
_ROUGH = dict.fromkeys(NUMERICAL_SETTINGS, 1) | {WAVELENGTHS: 2}


@dataclass(frozen=True, kw_only=True)
class Statement:
    """Line of a scene file for an effect, and its usual range in words."""

    table: str
    line: str  #: with the upper end of the range
    words: str


def statement_of(effect: Effect) -> Statement:
    """Return the line to add to a scene file that does not state an effect."""
    usual = EFFECTS[effect].usual
    if usual is None:
        raise ValueError(f"{effect}: every scene states it")
    table, key, words, scale = _STATEMENTS[effect]
    low, high = scale(usual.low), scale(usual.high)
    return Statement(table=table, line=key.format(f"{high:g}"), words=words.format(f"{low:g}", f"{high:g}"))


def _same(value: float) -> float:
    return value


# Table of the scene file, line, words for the range, and unit in the file.
_STATEMENTS: dict[Effect, tuple[str, str, str, Callable[[float], float]]] = {
    Effect.FIELD_OF_VIEW: (
        "[field_of_view]",
        'width_deg = {0}, height_deg = {0}, and extent = "field" in [[regions]]',
        "{} to {} deg",
        degrees,
    ),
    Effect.TEXTURE: ("[[regions]]", "texture_rms = {}", "rms {} to {}", _same),
    Effect.PATH_RADIANCE: ("[geometry]", "camera_height_m = {}", "{} to {} m", _same),
    Effect.POLARIZER_ANGLE: ("[errors]", "polarizer_angle_std_deg = {}", "{} to {} deg", degrees),
    Effect.MISREGISTRATION: ("[errors]", "misregistration_px = {}", "{} to {} px", _same),
    Effect.DRIFT: ("[errors]", "illumination_drift = {}", "{} to {}", _same),
    Effect.ADJACENCY: ("[errors]", "surround_albedo = {}", "albedo {}-{}", _same),
}


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
    #: Time of the whole chain with all effects and with those that act, without cached results [s].
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
    """Return the effects that a scene needs at a tolerance, half of which is for omitted effects."""
    settings = settings_of(scene)
    lit = lit_scene(scene, readout=readout, exposure_s=exposure_s)
    with as_config_error(f"scene {scene.name}"):
        found = plan(
            lit,
            tolerance=SHARE * tolerance,
            forced=forced_effects(scene),
            rule=rule,
            sharper=partial(skylight_bound, lit),
        )
    return PlannedScene(scene=lit, settings=settings, plan=found, remarks=(*scene.remarks, *found.remarks))


def with_sizes(planned: PlannedScene, *, tell: Tell | None = None) -> PlannedScene:
    """Return a planned scene with the size of every effect that acts or is not stated, to about two digits."""
    settings = settings_at(_ROUGH, SHARE * 1e-3, face_m=planned.scene.sensor_height_m)
    store = SceneLight(is_kept_between_runs=False, tell=tell).lights
    with as_config_error("effects"):
        return replace(planned, plan=with_changes(planned.scene, planned.plan, settings, store=store))


def plan_for_prediction(
    lit: "LitScene", *, tolerance: float, forced: Mapping[Effect, bool], rule: EffectRule
) -> EffectPlan:
    """Return the effects of a scene at a tolerance, which is for numerical settings alone by the rule "all"."""
    # The smallest tolerance is not shared.
    share = SHARE * tolerance if tolerance * (1.0 - SHARE) >= SMALLEST else 0.0
    if rule == "all":
        return plan_of_all(forced, tolerance=share, scene=lit)
    return plan(lit, tolerance=share, forced=forced, sharper=partial(skylight_bound, lit))


def verify_effects(planned: PlannedScene, *, tell: Tell | None = None) -> Verification:
    """Return the true change without each effect, whether it acts or not."""

    def empty() -> "LightStore":
        return SceneLight(is_kept_between_runs=False, tell=tell).lights

    def time_s(effects: frozenset[Effect]) -> float:
        return chain_time_s(planned.scene, planned.settings, effects, make_store=empty)

    plan = planned.plan
    leaves_out = any(one.answer == "left out" and not one.forced and one.bound.largest > 0.0 for one in plan.decisions)
    with as_config_error("--verify"):
        all_s = time_s(plan.asked)
        return Verification(
            checked=check_effects(planned.scene, planned.settings, plan, make_store=empty),
            all_s=all_s,
            planned_s=time_s(plan.active) if leaves_out else all_s,
        )
