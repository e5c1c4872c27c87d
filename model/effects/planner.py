"""Plan of the effects that a scene calls for: the others are left out within a tolerance, each with its reason."""

from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field

import numpy as np
from scipy.special import chdtri

from model.effects.air_bounds import bound_air
from model.effects.bound import Bound, Disturbance
from model.effects.bound_of_change import bound_of, detection_bound
from model.effects.effect_models import EFFECT_MODELS
from model.effects.names import ALL, Effect
from model.effects.radiance_bounds import RegionBounds, radiance_bounds
from model.effects.sun_light import SunLight, beam_lighting, known_light, sun_light
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.scenario import RegionLight

# Light of the regions where only these effects act.
KnownLight = Callable[[frozenset[Effect]], tuple[RegionLight, ...]]

# Effects of the light before the lens: those that cost time.
LIGHT = frozenset(effect for effect, entry in EFFECT_MODELS.items() if entry.of_light)

_NO_CHOICE: Mapping[Effect, bool] = {}


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision on an effect, and its reason.

    Attributes
    ----------
    effect
        Which.
    acts
        Whether it is computed.
    bound
        How much leaving it out can change.
    reason
        In words.
    forced
        Whether the user decided.
    """

    effect: Effect
    acts: bool
    bound: Bound
    reason: str
    forced: bool = False


@dataclass(frozen=True, kw_only=True)
class EffectPlan:
    """Decisions on all effects of a scene.

    Attributes
    ----------
    decisions
        In the order of their bounds, smallest first.
    tolerance
        That the sum of what is left out had to stay within.
    spent
        Sum of the bounds of what the planner left out.
    """

    decisions: tuple[Decision, ...]
    tolerance: float
    spent: Bound = field(default_factory=Bound)

    @property
    def active(self) -> frozenset[Effect]:
        """Effects that act."""
        return frozenset(one.effect for one in self.decisions if one.acts)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for every result: effects that a user left out and that may matter."""
        return tuple(
            f"{one.effect} is left out by request, though it may change numbers by {in_words(one.bound)}"
            for one in self.decisions
            if one.forced and not one.acts and one.bound.largest > 0.0
        )


def plan(
    scene: LitScene, *, tolerance: float, forced: Mapping[Effect, bool] = _NO_CHOICE, known: KnownLight | None = None
) -> EffectPlan:
    """Return which effects a scene calls for.

    Parameters
    ----------
    scene
        All that the scene is.
    tolerance
        That the sum of the bounds of what is left out may reach in each quantity of `Bound`, 0 or more.
    forced
        Effects that the user switched on (True) or off (False); what is off by request does not count in the sum.
    known
        Gives the light of the regions where the effects of `LIGHT` are left out that are not in its argument. It is
        called once these are decided, for the bounds of the others; None: they are had from limits of the light.

    Raises
    ------
    ValueError
        The tolerance is negative or not a number.

    Notes
    -----
    Effects of the light, which cost time, are decided first; then those of sensor and session. Each group is taken by
    its largest bound, smallest first; bounds of means add, shares of variances add, and so do the bounds made of them.
    """
    if not tolerance >= 0.0:
        raise ValueError(f"tolerance = {tolerance}; allowed is 0 or more")
    limits = light_limits(scene)
    of_light, spent = _decided(effect_bounds(scene, limits, LIGHT), Bound(), tolerance, forced)
    if known is not None and any(one.surface is not None for one in scene.regions):
        left_out = {one.effect for one in of_light if not one.acts}
        margin = sum(one.bound.radiance for one in of_light if not one.acts)
        light = known(ALL - left_out)
        limits = {one.name: known_light(one, margin=margin) for one in light} if np.isfinite(margin) else limits
    others, spent = _decided(effect_bounds(scene, limits, ALL - LIGHT), spent, tolerance, forced)
    decisions = sorted([*of_light, *others], key=lambda one: one.bound.largest)
    return EffectPlan(decisions=tuple(decisions), tolerance=tolerance, spent=spent)


def effect_bounds(
    scene: LitScene, limits: Mapping[str, SunLight], effects: frozenset[Effect] = ALL
) -> dict[Effect, Bound]:
    """Return for each effect how much leaving it out can change.

    Parameters
    ----------
    scene
        All that the scene is.
    limits
        Region to the limits of its light, as `light_limits` gives them.
    effects
        Which.
    """
    regions = {one.name: radiance_bounds(scene, one, limits[one.name]) for one in scene.regions}
    return {
        effect: _bound(scene, regions, _disturbances(effect, scene, regions, limits))
        for effect in Effect
        if effect in effects
    }


def light_limits(scene: LitScene) -> dict[str, SunLight]:
    """Return the limits of each region's light, without solving anything.

    Parameters
    ----------
    scene
        All that the scene is.
    """
    found = {one.name: known_light(_as_given(one)) for one in scene.regions if one.radiance is not None}
    materials = [one for one in scene.regions if one.surface is not None]
    if not materials or scene.air is None:
        return found
    lighting, limits = beam_lighting(scene.air), bound_air(scene.air)
    return found | {one.name: sun_light(scene, one, lighting, limits) for one in materials}


def in_words(bound: Bound) -> str:
    """Return a bound as text."""
    if all(np.isinf(value) for value in astuple(bound)):
        return "any amount"
    names = ("radiance", "ratios", "deviations", "detection")
    parts = [
        f"{name} {'any amount' if np.isinf(value) else format(value, '.1e')}"
        for name, value in zip(names, astuple(bound), strict=True)
        if value > 0.0
    ]
    return ", ".join(parts) or "nothing"


def _decide(effect: Effect, bound: Bound, spent: Bound, tolerance: float, choice: bool | None) -> Decision:
    if choice is not None:
        reason = "switched on by request" if choice else "left out by request"
        return Decision(effect=effect, acts=choice, bound=bound, reason=reason, forced=True)
    if bound.largest == 0.0:
        return Decision(effect=effect, acts=False, bound=bound, reason="is not there")
    total = spent + bound
    if total.largest <= tolerance:
        return Decision(effect=effect, acts=False, bound=bound, reason=f"sum {total.largest:.1e} <= {tolerance:.1e}")
    unknown = "no useful bound" if np.isinf(bound.largest) else f"sum {total.largest:.1e} > {tolerance:.1e}"
    return Decision(effect=effect, acts=True, bound=bound, reason=unknown)


def _decided(
    bounds: Mapping[Effect, Bound], spent: Bound, tolerance: float, forced: Mapping[Effect, bool]
) -> tuple[list[Decision], Bound]:
    decisions = []
    for effect in sorted(bounds, key=lambda one: bounds[one].largest):
        decision = _decide(effect, bounds[effect], spent, tolerance, forced.get(effect))
        decisions.append(decision)
        if not decision.acts and not decision.forced:
            spent = spent + decision.bound
    return decisions, spent


def _as_given(region: LitRegion) -> RegionLight:
    radiance = np.zeros(3) if region.radiance is None else region.radiance
    return RegionLight(
        name=region.name,
        stokes_radiance=radiance,
        texture_rms=region.texture_rms,
        texture_cov=region.texture_cov,
    )


def _disturbances(
    effect: Effect, scene: LitScene, regions: Mapping[str, RegionBounds], lights: Mapping[str, SunLight]
) -> dict[str, Disturbance]:
    bound = EFFECT_MODELS[effect].bound
    return {name: bound(scene, region, lights[name]) for name, region in regions.items()}


def _bound(scene: LitScene, regions: Mapping[str, RegionBounds], found: Mapping[str, Disturbance]) -> Bound:
    worst = Bound()
    for name, region in regions.items():
        worst = worst.worse(bound_of(region, found[name]))
    # The area under the curve is a mean over thresholds: that of its mean distance is covered too.
    eta = max(3.0, float(chdtri(3, min(scene.p_false_alarm)))) if scene.p_false_alarm else 3.0
    for target, background in scene.pairs:
        detection = detection_bound(regions[target], found[target], regions[background], found[background], eta=eta)
        worst = worst.worse(Bound(detection=detection))
    return worst
