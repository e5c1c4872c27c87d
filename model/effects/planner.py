"""Which effects act in a scene: those of the light by their bounds, those of sensor and session where they are stated.

`plan` takes the effects of the light by their largest bound, smallest first, and leaves out as many as stay together
within a tolerance. `acting` removes the others from the record of a scene: what is gone from it is not computed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from model.effects.names import ALL, EVERYTHING, LIGHT, Bound, Decision, Effect, EffectPlan, EffectRule
from model.scene.scene import LightParts, LitScene

if TYPE_CHECKING:
    from model.effects.bounds import LightLimits

# A sharper bound of skylight than the general one, from the limits of the light; None where there is none.
SharperBound = Callable[[Mapping[str, "LightLimits"]], Bound | None]

_NO_CHOICE: Mapping[Effect, bool] = {}
_ALL = "every effect acts by request"
# Of a tolerance, what is below this is 0 to rounding.
_ROUNDING = 1e-15


def plan(
    scene: LitScene,
    *,
    tolerance: float,
    forced: Mapping[Effect, bool] = _NO_CHOICE,
    rule: EffectRule = "safe",
    sharper: SharperBound | None = None,
    asked: bool = True,
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
    asked : bool
        Whether bounds of the light are computed; if not, its effects act unless the user forces one.

    Raises
    ------
    ValueError
        The tolerance is negative or not a number.

    Notes
    -----
    Skylight and path radiance are decided first. Bounds of means add, shares of variances add, and so do the bounds
    made of them. Where skylight and path radiance are left out, the band counts only with what it changes besides.
    """
    if not tolerance >= 0.0:
        raise ValueError(f"tolerance = {tolerance}; allowed is 0 or more")
    decisions, spent = _stated(scene, forced), Bound()
    if asked or LIGHT & forced.keys():
        of_light, spent = _of_light(scene, tolerance, forced, sharper)
        decisions += of_light
    else:
        reason = "costs less than to look for a bound of it"
        decisions += [Decision(effect=one, acts=True, bound=EVERYTHING, reason=reason) for one in LIGHT]
    if rule == "all":
        decisions, spent = [one if one.forced else replace(one, acts=True, reason=_ALL) for one in decisions], Bound()
    order = list(Effect)
    decisions.sort(key=lambda one: (one.bound.largest, order.index(one.effect)))
    return EffectPlan(decisions=tuple(decisions), tolerance=tolerance, spent=spent, rule=rule)


def plan_of_all(forced: Mapping[Effect, bool] = _NO_CHOICE, *, tolerance: float = 0.0) -> EffectPlan:
    """Return the plan in which every effect acts that is not left out by request; no bound is computed."""
    decisions = tuple(
        Decision(
            effect=effect,
            acts=forced.get(effect, True),
            bound=EVERYTHING,
            reason=_by_request(forced[effect]) if effect in forced else _ALL,
            forced=effect in forced,
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


def _stated(scene: LitScene, forced: Mapping[Effect, bool]) -> list[Decision]:
    """Decisions on the effects of sensor and session, which act where the scene states them."""
    found = []
    for effect, entry in EFFECTS.items():
        if entry.is_stated is None:
            continue
        is_stated = bool(entry.is_stated(scene))  # of numpy's numbers it is one of numpy's, which JSON does not hold
        found.append(
            Decision(
                effect=effect,
                acts=forced.get(effect, is_stated),
                bound=EVERYTHING if is_stated else Bound(),
                reason=_by_request(forced[effect]) if effect in forced else "stated" if is_stated else "not stated",
                forced=effect in forced,
                acts_by_bound=is_stated or effect in forced,
            )
        )
    return found


def _of_light(
    scene: LitScene, tolerance: float, forced: Mapping[Effect, bool], sharper: SharperBound | None
) -> tuple[list[Decision], Bound]:
    """Decisions on the effects of the light, and the sum of the bounds of those that are left out."""
    from model.effects.bounds import effect_bounds, light_limits

    # Noise that is left out by request hides nothing of what the light changes.
    left = acting(scene, ALL - {effect for effect, is_on in forced.items() if not is_on and effect not in LIGHT})
    limits = light_limits(scene)
    bounds = effect_bounds(left, limits)
    general = bounds[Effect.SKYLIGHT]
    if sharper is not None and Effect.SKYLIGHT not in forced and general.detection <= tolerance < general.largest:
        found = sharper(limits)
        if found is not None:
            bounds[Effect.SKYLIGHT] = general.tighter(replace(found, detection=general.detection))
    of_air = {effect: bounds.pop(effect) for effect in (Effect.SKYLIGHT, Effect.PATH_RADIANCE)}
    first, spent = _decided(of_air, of_air, Bound(), forced, tolerance)
    counted = dict(bounds)
    if not any(one.acts or one.forced for one in first):
        # One wavelength misses nothing of light that is not computed.
        dark = {name: replace(one, sky=0.0, sky_polarised=0.0, path=0.0) for name, one in limits.items()}
        counted |= effect_bounds(left, dark, frozenset({Effect.WAVELENGTHS}))
    others, spent = _decided(bounds, counted, spent, forced, tolerance)
    return first + others, spent


def _decided(
    bounds: Mapping[Effect, Bound],
    counted: Mapping[Effect, Bound],
    spent: Bound,
    forced: Mapping[Effect, bool],
    tolerance: float,
) -> tuple[list[Decision], Bound]:
    """Decisions on some effects, smallest first, and the sum of what is left out; `counted` is what each adds to it."""
    found = []
    for effect in sorted(bounds, key=lambda one: (counted[one].largest, one)):
        total = spent + counted[effect]
        size = total.largest if counted[effect].largest > 0.0 else 0.0
        acts = forced.get(effect, bool(size > tolerance))
        if effect in forced:
            reason = _by_request(acts)
        elif size == 0.0:
            reason = "is not there"
        elif np.isinf(size):
            reason = "no useful bound"
        else:
            shown = f"{size:.1e}" if size > _ROUNDING * tolerance else "0"
            reason = f"sum {shown} {'>' if acts else '<='} {tolerance:.1e}"
        if not acts and effect not in forced:
            spent = total
        found.append(
            Decision(
                effect=effect,
                acts=acts,
                bound=bounds[effect],
                reason=reason,
                forced=effect in forced,
                acts_by_bound=acts or effect in forced,
            )
        )
    return found, spent


def _by_request(is_on: bool) -> str:
    return "switched on by request" if is_on else "left out by request"


# What each effect changes, what computing it costs, and how it is removed


@dataclass(frozen=True, kw_only=True)
class EffectEntry:
    """An effect: a new one is an entry here and the place that computes it; one of the light has a bound as well."""

    changes: str
    removed: Callable[[LitScene], LitScene]
    is_stated: Callable[[LitScene], bool] | None = None  #: None for effects of the light, which have a bound
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


def _has_texture(scene: LitScene) -> bool:
    return any(one.texture_rms > 0.0 or any(one.texture_diagonal) or np.any(one.texture_cov) for one in scene.regions)


EFFECTS: Mapping[Effect, EffectEntry] = MappingProxyType(
    {
        Effect.FIELD_OF_VIEW: EffectEntry(
            changes="mean light and its spread over a region",
            removed=_without_part("field_of_view"),
            place="model.accuracy.chain",
            cost="a light for each tile",
        ),
        Effect.TEXTURE: EffectEntry(
            changes="covariance over pixels",
            removed=_without_texture,
            is_stated=_has_texture,
        ),
        Effect.SKYLIGHT: EffectEntry(
            changes="mean light",
            removed=_without_part("skylight"),
            place="model.accuracy.chain",
            cost="sky, and an integral over it a view",
        ),
        Effect.PATH_RADIANCE: EffectEntry(
            changes="mean light",
            removed=_without_part("path_radiance"),
            place="model.accuracy.chain",
            cost="one ray a view",
        ),
        Effect.LEAKAGE: EffectEntry(
            changes="counts, noise of S1 and S2",
            removed=_without_leakage,
            is_stated=lambda scene: (
                scene.sensor.tau_perpendicular != 0.0 or bool(np.isfinite(scene.readout.extinction_ratio))
            ),
        ),
        Effect.DARK_CURRENT: EffectEntry(
            changes="temporal noise",
            removed=_without_noise(dark_current_e_per_s=0.0),
            is_stated=lambda scene: scene.sensor.noise.dark_current_e_per_s > 0.0,
        ),
        Effect.SHOT_NOISE: EffectEntry(
            changes="temporal noise",
            removed=_without_noise(shot_noise=False),
            is_stated=lambda scene: scene.sensor.noise.shot_noise,
        ),
        Effect.READ_NOISE: EffectEntry(
            changes="temporal noise",
            removed=_without_noise(read_noise_e=0.0),
            is_stated=lambda scene: scene.sensor.noise.read_noise_e > 0.0,
        ),
        Effect.QUANTISATION: EffectEntry(
            changes="temporal noise",
            removed=_without_noise(quantisation=False),
            is_stated=lambda scene: scene.sensor.noise.quantisation,
        ),
        Effect.WAVELENGTHS: EffectEntry(
            changes="light of sky and path",
            removed=_without_part("wavelengths"),
            place="model.accuracy.chain",
            cost="a solution for each",
        ),
        Effect.POLARIZER_ANGLE: EffectEntry(
            changes="degree of polarization, temporal noise",
            removed=_without_session(polarizer_angle_std_rad=0.0),
            is_stated=lambda scene: scene.imperfections.polarizer_angle_std_rad > 0.0,
        ),
        Effect.MISREGISTRATION: EffectEntry(
            changes="correlation of texture between frames",
            removed=_without_session(misregistration_pixels=0.0),
            is_stated=lambda scene: scene.imperfections.misregistration_pixels > 0.0 and _has_texture(scene),
        ),
        Effect.DRIFT: EffectEntry(
            changes="mean Stokes parameters",
            removed=_without_session(drift=0.0),
            is_stated=lambda scene: scene.imperfections.drift != 0.0,
        ),
        Effect.NONUNIFORMITY: EffectEntry(
            changes="covariance over pixels",
            removed=_without_noise(prnu=0.0, dsnu_e=0.0),
            is_stated=lambda scene: scene.sensor.noise.prnu > 0.0 or scene.sensor.noise.dsnu_e > 0.0,
        ),
        Effect.SATURATION: EffectEntry(
            changes="warnings; the share of pixels for which the model is void",
            removed=lambda scene: replace(scene, sensor=replace(scene.sensor, saturates=False)),
            is_stated=lambda scene: scene.sensor.saturates,
        ),
        Effect.FALLOFF: EffectEntry(
            changes="counts and their spread over a region",
            removed=_without_session(off_axis_falloff=False),
            is_stated=lambda scene: (
                scene.imperfections.off_axis_falloff and any(one.part is not None for one in scene.regions)
            ),
            place="model.accuracy.chain",
        ),
        Effect.ADJACENCY: EffectEntry(
            changes="mean light",
            removed=_without_session(surround_albedo=None),
            place="model.accuracy.chain",
        ),
    }
)
