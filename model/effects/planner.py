"""Plan of the effects that a scene calls for: the others are left out within a tolerance, each with its reason."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from functools import partial

import numpy as np

from model.effects.air_bounds import bound_air
from model.effects.bound import EVERYTHING, Bound, Disturbance, Estimate
from model.effects.bound_of_change import bound_of, detection_bound
from model.effects.effect_models import EFFECT_MODELS
from model.effects.names import ALL, Effect, EffectRule
from model.effects.radiance_bounds import RegionBounds, radiance_bounds
from model.effects.sun_light import SunLight, beam_lighting, known_light, sun_light
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.scenario import RegionLight
from model.special_functions import chdtri

# Light of the regions where only these effects act.
KnownLight = Callable[[frozenset[Effect]], tuple[RegionLight, ...]]
# Estimates of effects with these bounds, those that cannot be had left out.
Estimates = Callable[[Mapping[Effect, Bound]], Mapping[Effect, Estimate]]
# A sharper bound of an effect than the general one, from the limits of the light; None where there is none.
SharperBound = Callable[[Mapping[str, SunLight]], Bound | None]
# A bound below this share of the tolerance needs no estimate.
_SMALL = 0.5

# Effects of the light before the lens: those that cost time.
LIGHT = frozenset(effect for effect, entry in EFFECT_MODELS.items() if entry.of_light)
# Of them those that cost most, decided first: where they are left out, one wavelength misses nothing of them.
_OF_AIR = frozenset({Effect.SKYLIGHT, Effect.PATH_RADIANCE})

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
    acts_by_bound, acts_by_estimate
        Whether it is computed by the rule "safe" and by the rule "estimated".
    estimate
        What leaving it out is estimated to change; None where that was not asked for, or nothing can tell.
    """

    effect: Effect
    acts: bool
    bound: Bound
    reason: str
    forced: bool = False
    acts_by_bound: bool = True
    acts_by_estimate: bool = True
    estimate: Estimate | None = None

    @property
    def most(self) -> Bound:
        """The bound, or the estimate with its error where that is smaller."""
        return self.bound if self.estimate is None else self.bound.tighter(self.estimate.most)


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
        Sum of what the planner left out may change: of bounds, or by the rule "estimated" of the smaller of bound and
        estimate.
    rule
        By which it was decided.
    """

    decisions: tuple[Decision, ...]
    tolerance: float
    spent: Bound = field(default_factory=Bound)
    rule: EffectRule = "safe"

    @property
    def active(self) -> frozenset[Effect]:
        """Effects that act."""
        return frozenset(one.effect for one in self.decisions if one.acts)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for every result: what a user left out and may matter, and what was left out by an estimate."""
        return (
            *(
                f"{one.effect} is left out by request, though it may change numbers by {in_words(one.bound)}"
                for one in self.decisions
                if one.forced and not one.acts and one.bound.largest > 0.0
            ),
            *(
                f"{one.effect} is left out by an estimate: it changes numbers by {in_words(one.most)}; not guaranteed"
                for one in self.decisions
                if not one.forced and not one.acts and one.acts_by_bound
            ),
        )


def plan(
    scene: LitScene,
    *,
    tolerance: float,
    forced: Mapping[Effect, bool] = _NO_CHOICE,
    known: KnownLight | None = None,
    rule: EffectRule = "safe",
    estimates: Estimates | None = None,
    every_estimate: bool = False,
    sharper: SharperBound | None = None,
    asked: frozenset[Effect] = ALL,
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
    rule
        By bounds ("safe"), by estimates where these are smaller ("estimated"), or without a decision ("all").
    estimates
        Estimates effects, first those of `LIGHT`, then the others; None for no estimates.
    every_estimate
        Whether effects are estimated too that their bounds let be left out.
    sharper
        Gives a sharper bound of skylight, asked for where the general one is above the tolerance; None for none.
    asked
        Effects that may be left out; no bound is looked for of others, which act.

    Raises
    ------
    ValueError
        The tolerance is negative or not a number.

    Notes
    -----
    Effects of the light, which cost time, are decided first, skylight and path radiance before the others of them; then
    those of sensor and session. Each group is taken by its largest bound, smallest first; bounds of means add, shares
    of variances add, and so do the bounds made of them. Where skylight and path radiance are left out, of the others
    only what they change beside that counts in the sum.
    """
    if not tolerance >= 0.0:
        raise ValueError(f"tolerance = {tolerance}; allowed is 0 or more")
    choice = _Choice(tolerance=tolerance, forced=forced, rule=rule, estimates=estimates, every_estimate=every_estimate)
    asked |= forced.keys()
    if not asked:
        return EffectPlan(decisions=tuple(map(_unasked, Effect)), tolerance=tolerance, rule=rule)
    bounds_of, limits = partial(_bounds_beside, scene, forced), light_limits(scene)
    of_air, spent = choice.decided(_sharpened(bounds_of(limits, _OF_AIR), limits, choice, sharper), _Spent())
    of_band, spent = choice.decided(bounds_of(limits, LIGHT - _OF_AIR), spent, unlit=_unlit(bounds_of, limits, of_air))
    of_light = [*of_air, *of_band]
    if known is not None and any(one.surface is not None for one in scene.regions):
        left_out = [one for one in of_light if not one.acts]
        margin = sum((one.bound if rule == "safe" else one.most).radiance for one in left_out)
        light = known(ALL - {one.effect for one in left_out})
        limits = {one.name: known_light(one, margin=margin) for one in light} if np.isfinite(margin) else limits
    others, spent = choice.decided(bounds_of(limits, asked - LIGHT), spent)
    others += map(_unasked, ALL - LIGHT - asked)
    decisions = sorted([*of_light, *others], key=lambda one: one.bound.largest)
    used = {"safe": spent.by_bound, "estimated": spent.by_estimate, "all": Bound()}[rule]
    return EffectPlan(decisions=tuple(decisions), tolerance=tolerance, spent=used, rule=rule)


def _unasked(effect: Effect) -> Decision:
    return Decision(effect=effect, acts=True, bound=EVERYTHING, reason="costs less than to look for a bound of it")


def _sharpened(
    bounds: dict[Effect, Bound], limits: Mapping[str, SunLight], choice: "_Choice", sharper: SharperBound | None
) -> dict[Effect, Bound]:
    """Bounds with that of skylight sharper, where a decision may hang on it; that of detection stays."""
    general = bounds[Effect.SKYLIGHT]
    is_asked = general.detection <= choice.tolerance < general.largest and Effect.SKYLIGHT not in choice.forced
    found = sharper(limits) if sharper is not None and is_asked else None
    if found is None:
        return bounds
    return bounds | {Effect.SKYLIGHT: general.tighter(replace(found, detection=general.detection))}


def _bounds_beside(
    scene: LitScene, forced: Mapping[Effect, bool], limits: Mapping[str, SunLight], effects: frozenset[Effect]
) -> dict[Effect, Bound]:
    """Bounds of effects beside what is left over: noise that is left out by request hides nothing of other noise."""
    off = frozenset(effect for effect, is_on in forced.items() if not is_on) - LIGHT
    left = scene
    for effect in off:
        left = EFFECT_MODELS[effect].removed(left)
    found = effect_bounds(left, limits, effects - off)
    return found | (effect_bounds(scene, limits, effects & off) if effects & off else {})


def plan_of_all(forced: Mapping[Effect, bool] = _NO_CHOICE, *, tolerance: float = 0.0) -> EffectPlan:
    """Return the plan in which every effect acts that is not left out by request; no bound is looked for."""
    choice = _Choice(tolerance=tolerance, forced=forced, rule="all")
    found, _ = choice.decided(dict.fromkeys(Effect, EVERYTHING), _Spent())
    return EffectPlan(decisions=tuple(found), tolerance=tolerance, rule="all")


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
    limits = bound_air(scene.air)
    lighting = beam_lighting(scene.air, limits)
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


@dataclass(frozen=True, kw_only=True)
class _Spent:
    """Sum of what may change by what is left out, by either rule."""

    by_bound: Bound = field(default_factory=Bound)
    by_estimate: Bound = field(default_factory=Bound)


@dataclass(frozen=True, kw_only=True)
class _Unlit:
    """What effects change beside skylight and path radiance, for a rule by which these are left out; else nothing."""

    by_bound: Mapping[Effect, Bound] = field(default_factory=dict)
    by_estimate: Mapping[Effect, Bound] = field(default_factory=dict)


def _unlit(
    bounds_of: Callable[[Mapping[str, SunLight], frozenset[Effect]], dict[Effect, Bound]],
    limits: Mapping[str, SunLight],
    of_air: Sequence[Decision],
) -> _Unlit:
    by_bound, by_estimate = (
        not any(getattr(one, rule) or one.forced for one in of_air) for rule in ("acts_by_bound", "acts_by_estimate")
    )
    if not (by_bound or by_estimate):
        return _Unlit()
    dark = {name: replace(one, sky=0.0, sky_polarised=0.0, path=0.0) for name, one in limits.items()}
    found = bounds_of(dark, frozenset({Effect.WAVELENGTHS}))
    return _Unlit(by_bound=found if by_bound else {}, by_estimate=found if by_estimate else {})


@dataclass(frozen=True, kw_only=True)
class _Choice:
    """What decides of an effect."""

    tolerance: float
    forced: Mapping[Effect, bool]
    rule: EffectRule
    estimates: Estimates | None = None
    every_estimate: bool = False

    def decided(
        self, bounds: Mapping[Effect, Bound], spent: _Spent, *, unlit: "_Unlit | None" = None
    ) -> tuple[list[Decision], _Spent]:
        """Return decisions by both rules, and what they spend."""
        beside = _Unlit() if unlit is None else unlit
        by_bound = self._left_out({**bounds, **beside.by_bound}, spent.by_bound)
        there = frozenset(one for one in bounds if bounds[one].largest > 0.0)
        undecided = there - by_bound.effects - self.forced.keys()
        found: Mapping[Effect, Estimate] = {}
        if self.estimates is not None and (undecided or self.every_estimate):
            least = 0.0 if self.every_estimate else _SMALL * self.tolerance
            found = self.estimates({one: bounds[one] for one in there if bounds[one].largest > least})
        most = {one: bound.tighter(found[one].most) if one in found else bound for one, bound in bounds.items()}
        by_estimate = self._left_out({**most, **beside.by_estimate}, spent.by_estimate)
        used = by_estimate if self.rule == "estimated" else by_bound
        decisions = [
            Decision(
                effect=effect,
                acts=self.forced.get(effect, self.rule == "all" or effect not in used.effects),
                bound=bound,
                reason=self._reason(effect, used),
                forced=effect in self.forced,
                acts_by_bound=effect not in by_bound.effects,
                acts_by_estimate=effect not in by_estimate.effects,
                estimate=found.get(effect),
            )
            for effect, bound in bounds.items()
        ]
        return decisions, _Spent(by_bound=by_bound.spent, by_estimate=by_estimate.spent)

    def _left_out(self, most: Mapping[Effect, Bound], spent: Bound) -> "_LeftOut":
        effects, sums = set(), {}
        for effect in sorted(most.keys() - self.forced.keys(), key=lambda one: (most[one].largest, one)):
            total = spent + most[effect]
            sums[effect] = total.largest if most[effect].largest > 0.0 else 0.0
            if sums[effect] <= self.tolerance:
                effects.add(effect)
                spent = total
        return _LeftOut(effects=frozenset(effects), sums=sums, spent=spent)

    def _reason(self, effect: Effect, used: "_LeftOut") -> str:
        if effect in self.forced:
            return "switched on by request" if self.forced[effect] else "left out by request"
        if self.rule == "all":
            return "every effect acts by request"
        total = used.sums[effect]
        if total == 0.0:
            return "is not there"
        if np.isinf(total):
            return "no useful bound"
        return f"sum {total:.1e} {'<=' if effect in used.effects else '>'} {self.tolerance:.1e}"


@dataclass(frozen=True, kw_only=True)
class _LeftOut:
    """Effects that a rule leaves out, the sums that each reached or would have, and the sum of what is left out."""

    effects: frozenset[Effect]
    sums: Mapping[Effect, float]
    spent: Bound


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
