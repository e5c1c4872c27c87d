"""Which effects act in a scene: those of the light by their bounds, those of sensor and session where they are stated.

`plan` takes the effects of the light by their largest bound, smallest first, and leaves out as many as stay together
within a tolerance. `acting` removes the others from the record of a scene: what is gone from it is not computed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from model.effects.effect import ALL, EVERYTHING, LIGHT, Bound, Decision, Effect, EffectPlan, EffectRule
from model.scene.field import whole_field
from model.scene.scene import LightParts, LitScene

if TYPE_CHECKING:
    from model.effects.bounds import LightLimits

# A sharper bound of skylight than the general one, from the limits of the light; None where there is none.
SharperBound = Callable[[Mapping[str, "LightLimits"]], Bound | None]

_NO_CHOICE: Mapping[Effect, bool] = {}
_ALL = "every effect acts by request"
# Effects that are decided before the others.
_OF_AIR = frozenset({Effect.SKYLIGHT, Effect.PATH_RADIANCE})
# Of a tolerance, what is below this is 0 to rounding.
_ROUNDING = 1e-15


def plan(
    scene: LitScene,
    *,
    tolerance: float,
    forced: Mapping[Effect, bool] = _NO_CHOICE,
    rule: EffectRule = "safe",
    sharper: SharperBound | None = None,
) -> EffectPlan:
    """Return which effects a scene calls for.

    Parameters
    ----------
    scene : LitScene
        All that the scene is.
    tolerance : float
        Allowed sum of the bounds of the effects that are left out, in each quantity of `Bound`; 0 or more.
    forced : mapping of Effect to bool
        Effects that the user switched on (True) or off (False); those that are off do not count in the sum.
    rule : {"safe", "all"}
        By bounds, or every effect acts; the decisions say in either case what "safe" would leave out.
    sharper : callable or None
        Gives a sharper bound of skylight, called where the general one is above the tolerance; None for none.

    Raises
    ------
    ValueError
        The tolerance is negative or not a number.

    Notes
    -----
    Bounds of means add, shares of variances add, and so do the bounds made of them. Skylight and path radiance are
    decided first: where both are left out, the band counts only with what it changes besides.
    """
    if not tolerance >= 0.0:
        raise ValueError(f"tolerance = {tolerance}; allowed is 0 or more")
    of_light, spent = _of_light(scene, tolerance, forced, sharper)
    decisions = [_by_statement(scene, effect, forced) for effect in Effect if effect not in of_light]
    decisions += of_light.values()
    if rule == "all":
        decisions, spent = [one if one.forced else replace(one, acts=True, reason=_ALL) for one in decisions], Bound()
    order = list(Effect)
    decisions.sort(key=lambda one: (one.bound.largest, order.index(one.effect)))
    return EffectPlan(decisions=tuple(decisions), tolerance=tolerance, spent=spent, rule=rule)


def plan_of_all(
    forced: Mapping[Effect, bool] = _NO_CHOICE, *, tolerance: float = 0.0, scene: LitScene | None = None
) -> EffectPlan:
    """Return the plan in which every effect acts that is not left out by request; no bound is computed."""
    decisions = tuple(
        Decision(
            effect=effect,
            acts=forced.get(effect, True),
            bound=EVERYTHING,
            reason=_by_request(forced[effect]) if effect in forced else _ALL,
            forced=effect in forced,
            is_unstated=scene is not None and _by_statement(scene, effect, forced).is_unstated,
        )
        for effect in Effect
    )
    return EffectPlan(decisions=decisions, tolerance=tolerance, rule="all")


def acting(scene: LitScene, effects: frozenset[Effect]) -> LitScene:
    """Return the scene with all effects left out that do not act."""
    for effect in Effect:
        if effect not in effects:
            scene = EFFECTS[effect].removed(scene)
    return scene


def acting_parts(effects: frozenset[Effect]) -> LightParts:
    """Return the parts of the light that are computed where some effects act."""
    return LightParts(
        field_of_view=Effect.FIELD_OF_VIEW in effects,
        skylight=Effect.SKYLIGHT in effects,
        path_radiance=Effect.PATH_RADIANCE in effects,
        wavelengths=Effect.WAVELENGTHS in effects,
    )


def _by_statement(scene: LitScene, effect: Effect, forced: Mapping[Effect, bool]) -> Decision:
    entry = EFFECTS[effect]
    is_stated = bool(entry.is_stated(scene))  # of numpy's numbers it is one of numpy's, which JSON does not hold
    is_unstated = not is_stated and entry.usual is not None and entry.usual.can_be(scene)
    if effect in forced:
        reason = _by_request(forced[effect])
    elif is_stated:
        reason = entry.reason_stated
    else:
        reason = "not stated" if is_unstated else entry.reason_absent
    return Decision(
        effect=effect,
        acts=forced.get(effect, is_stated),
        bound=EVERYTHING if is_stated else Bound(),
        reason=reason,
        forced=effect in forced,
        acts_by_bound=is_stated or effect in forced,
        is_unstated=is_unstated,
    )


def _of_light(
    scene: LitScene, tolerance: float, forced: Mapping[Effect, bool], sharper: SharperBound | None
) -> tuple[dict[Effect, Decision], Bound]:
    """Decisions on the effects of the light that are there, and the sum of the bounds of those that are left out."""
    from model.effects.bounds import effect_bounds, is_bounded, light_limits

    there = [effect for effect in Effect if effect in LIGHT and EFFECTS[effect].is_stated(scene)]
    if not there or not is_bounded(scene):
        unknown = dict.fromkeys(there, EVERYTHING)
        return _decided(unknown, unknown, Bound(), forced, tolerance)[0], Bound()
    # Noise that is left out by request hides nothing of what the light changes.
    left = acting(scene, ALL - {effect for effect, is_on in forced.items() if not is_on and effect not in LIGHT})
    limits = light_limits(scene)
    bounds = effect_bounds(left, limits)
    general = bounds[Effect.SKYLIGHT]
    if sharper is not None and Effect.SKYLIGHT not in forced and general.detection <= tolerance < general.largest:
        found = sharper(limits)
        if found is not None:
            bounds[Effect.SKYLIGHT] = general.tighter(replace(found, detection=general.detection))
    of_air = {one: bounds[one] for one in there if one in _OF_AIR}
    first, spent = _decided(of_air, of_air, Bound(), forced, tolerance)
    others = {one: bounds[one] for one in there if one not in first}
    counted = dict(others)
    if not any(one.acts or one.forced for one in first.values()):
        # One wavelength misses nothing of light that is not computed.
        dark = {name: one.but_for(*first) for name, one in limits.items()}
        counted |= effect_bounds(left, dark, frozenset({Effect.WAVELENGTHS}))
    rest, spent = _decided(others, counted, spent, forced, tolerance)
    return first | rest, spent


def _decided(
    bounds: Mapping[Effect, Bound],
    counted: Mapping[Effect, Bound],
    spent: Bound,
    forced: Mapping[Effect, bool],
    tolerance: float,
) -> tuple[dict[Effect, Decision], Bound]:
    """Decisions on effects, smallest first, and the sum of what is left out; `counted` is what each adds to it."""
    found = {}
    for effect in sorted(bounds, key=lambda one: (counted[one].largest, one)):
        total = spent + counted[effect]
        size = total.largest if counted[effect].largest > 0.0 else 0.0
        acts = forced.get(effect, bool(size > tolerance))
        if effect in forced:
            reason = _by_request(acts)
        elif size == 0.0:
            reason = "changes nothing"
        elif np.isinf(size):
            reason = "no useful bound"
        else:
            shown = f"{size:.1e}" if size > _ROUNDING * tolerance else "0"
            reason = f"sum {shown} {'>' if acts else '<='} {tolerance:.1e}"
        if not acts and effect not in forced:
            spent = total
        found[effect] = Decision(
            effect=effect,
            acts=acts,
            bound=bounds[effect],
            reason=reason,
            forced=effect in forced,
            acts_by_bound=acts or effect in forced,
        )
    return found, spent


def _by_request(is_on: bool) -> str:
    return "switched on by request" if is_on else "left out by request"


# Each effect: what it changes, how it is removed, whether a scene states it; and its usual size and cost


@dataclass(frozen=True, kw_only=True)
class Usual:
    """The usual range of the input of an effect, and the scene with it where the scene states none."""

    low: float  #: SI; angles in radians
    high: float
    stated: Callable[[LitScene, float], LitScene]
    can_be: Callable[[LitScene], bool] = lambda _: True  #: whether the scene leaves room for the effect
    fits: Callable[[LitScene, float], bool] = lambda _, __: True  #: whether it leaves room for so much of it


@dataclass(frozen=True)
class EffectEntry:
    """An effect: a new one is an entry here and the place that computes it; one of the light has a bound as well."""

    changes: str  #: what it acts on, in words
    removed: Callable[[LitScene], LitScene]  #: gives a scene without it
    is_stated: Callable[[LitScene], bool]  #: whether a scene has it
    usual: Usual | None = None  #: None for an effect that every scene states, or that follows from others
    reason_stated: str = "stated"
    reason_absent: str = "stated as 0"  #: why it is not there where it is neither stated nor has a usual size
    place: str = "model.effects.planner"
    cost: str = "microseconds"


def _without_part(name: str) -> Callable[[LitScene], LitScene]:
    return lambda scene: replace(scene, parts=replace(scene.parts, **{name: False}))


def _without_noise(**values: Any) -> Callable[[LitScene], LitScene]:
    return lambda scene: replace(scene, sensor=replace(scene.sensor, noise=replace(scene.sensor.noise, **values)))


def _without_session(**values: Any) -> Callable[[LitScene], LitScene]:
    return lambda scene: replace(scene, imperfections=replace(scene.imperfections, **values))


def _without_leakage(scene: LitScene) -> LitScene:
    ideal = replace(scene.readout, extinction_ratio=np.inf)
    return replace(scene, sensor=replace(scene.sensor, tau_perpendicular=0.0), readout=ideal)


def _without_texture(scene: LitScene) -> LitScene:
    regions = tuple(
        replace(one, texture_rms=0.0, texture_diagonal=(0.0, 0.0, 0.0), texture_cov=np.zeros((3, 3)))
        for one in scene.regions
    )
    return replace(scene, regions=regions)


def _with_session(name: str) -> Callable[[LitScene, float], LitScene]:
    return lambda scene, value: _without_session(**{name: value})(scene)


def _with_texture(scene: LitScene, rms: float) -> LitScene:
    return replace(scene, regions=tuple(replace(one, texture_rms=rms) for one in scene.regions))


def _with_field(scene: LitScene, width_rad: float) -> LitScene:
    part = whole_field(width_rad=width_rad, height_rad=width_rad)
    return replace(
        scene, regions=tuple(replace(one, part=part if one.surface is not None else None) for one in scene.regions)
    )


def _is_on_ground(scene: LitScene, width_rad: float) -> bool:
    """Return whether a square field of this width lies below the horizon."""
    corner_rad = np.arctan(np.sqrt(2.0) * np.tan(0.5 * width_rad))
    return scene.view is None or bool(scene.view.zenith_rad + corner_rad < 0.5 * np.pi)


def _has_materials(scene: LitScene) -> bool:
    return any(one.surface is not None for one in scene.regions)


def _has_extents(scene: LitScene) -> bool:
    return any(one.part is not None for one in scene.regions)


def _has_texture(scene: LitScene) -> bool:
    return any(one.texture_rms > 0.0 or any(one.texture_diagonal) or np.any(one.texture_cov) for one in scene.regions)


def _from_height(scene: LitScene, height_m: float) -> LitScene:
    return scene if scene.view is None else replace(scene, view=replace(scene.view, height_m=height_m))


_IN_RADIANCE = "in the radiance"

EFFECTS: Mapping[Effect, EffectEntry] = MappingProxyType(
    {
        Effect.FIELD_OF_VIEW: EffectEntry(
            "mean light and its spread over a region",
            _without_part("field_of_view"),
            _has_extents,
            usual=Usual(
                low=np.radians(1.0), high=np.radians(5.0), stated=_with_field, can_be=_has_materials, fits=_is_on_ground
            ),
            reason_absent=_IN_RADIANCE,
            place="model.accuracy.chain",
            cost="a light for each tile",
        ),
        Effect.TEXTURE: EffectEntry(
            "covariance over pixels",
            _without_texture,
            _has_texture,
            usual=Usual(low=0.005, high=0.03, stated=_with_texture),
        ),
        Effect.SKYLIGHT: EffectEntry(
            "mean light",
            _without_part("skylight"),
            _has_materials,
            reason_absent=_IN_RADIANCE,
            place="model.accuracy.chain",
            cost="sky, and an integral over it a view",
        ),
        Effect.PATH_RADIANCE: EffectEntry(
            "mean light",
            _without_part("path_radiance"),
            lambda scene: _has_materials(scene) and scene.sensor_height_m > 0.0,
            usual=Usual(low=1.5, high=30.0, stated=_from_height, can_be=_has_materials),
            reason_absent=_IN_RADIANCE,
            place="model.accuracy.chain",
            cost="one ray a view",
        ),
        Effect.LEAKAGE: EffectEntry(
            "counts, noise of S1 and S2",
            _without_leakage,
            lambda scene: scene.sensor.tau_perpendicular != 0.0 or bool(np.isfinite(scene.readout.extinction_ratio)),
        ),
        Effect.DARK_CURRENT: EffectEntry(
            "temporal noise",
            _without_noise(dark_current_e_per_s=0.0),
            lambda scene: scene.sensor.noise.dark_current_e_per_s > 0.0,
        ),
        Effect.SHOT_NOISE: EffectEntry(
            "temporal noise", _without_noise(shot_noise=False), lambda scene: scene.sensor.noise.shot_noise
        ),
        Effect.READ_NOISE: EffectEntry(
            "temporal noise", _without_noise(read_noise_e=0.0), lambda scene: scene.sensor.noise.read_noise_e > 0.0
        ),
        Effect.QUANTISATION: EffectEntry(
            "temporal noise", _without_noise(quantisation=False), lambda scene: scene.sensor.noise.quantisation
        ),
        Effect.WAVELENGTHS: EffectEntry(
            "light of sky and path",
            _without_part("wavelengths"),
            _has_materials,
            reason_absent=_IN_RADIANCE,
            place="model.accuracy.chain",
            cost="a solution for each",
        ),
        Effect.POLARIZER_ANGLE: EffectEntry(
            "degree of polarization, temporal noise",
            _without_session(polarizer_angle_std_rad=0.0),
            lambda scene: scene.imperfections.polarizer_angle_std_rad > 0.0,
            usual=Usual(low=np.radians(0.02), high=np.radians(0.2), stated=_with_session("polarizer_angle_std_rad")),
        ),
        Effect.MISREGISTRATION: EffectEntry(
            "correlation of texture between frames",
            _without_session(misregistration_pixels=0.0),
            lambda scene: scene.imperfections.misregistration_pixels > 0.0 and _has_texture(scene),
            usual=Usual(low=0.05, high=0.5, stated=_with_session("misregistration_pixels"), can_be=_has_texture),
            reason_absent="no texture to shift",
        ),
        Effect.DRIFT: EffectEntry(
            "mean Stokes parameters",
            _without_session(drift=0.0),
            lambda scene: scene.imperfections.drift != 0.0,
            usual=Usual(low=0.001, high=0.01, stated=_with_session("drift")),
        ),
        Effect.NONUNIFORMITY: EffectEntry(
            "covariance over pixels",
            _without_noise(prnu=0.0, dsnu_e=0.0),
            lambda scene: scene.sensor.noise.prnu > 0.0 or scene.sensor.noise.dsnu_e > 0.0,
        ),
        Effect.SATURATION: EffectEntry(
            "warnings; the share of pixels for which the model is void",
            lambda scene: replace(scene, sensor=replace(scene.sensor, saturates=False)),
            lambda scene: scene.sensor.saturates,
        ),
        Effect.FALLOFF: EffectEntry(
            "counts and their spread over a region",
            _without_session(off_axis_falloff=False),
            lambda scene: scene.imperfections.off_axis_falloff and _has_extents(scene),
            reason_stated="field of view",
            reason_absent="no extent",
            place="model.accuracy.chain",
        ),
        Effect.ADJACENCY: EffectEntry(
            "mean light",
            _without_session(surround_albedo=None),
            lambda scene: scene.imperfections.surround_albedo is not None,
            usual=Usual(low=0.05, high=0.5, stated=_with_session("surround_albedo"), can_be=_has_materials),
            reason_absent=_IN_RADIANCE,
            place="model.accuracy.chain",
        ),
    }
)
