"""Plan of the effects that act in a scene: the others are left out within a tolerance, each with its reason."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from model.effects.bounds import EFFECT_MODELS, LightLimits, effect_bounds, known_light, light_limits
from model.effects.names import ALL, EVERYTHING, Bound, Decision, Effect, EffectPlan, EffectRule, Estimate
from model.scene.scene import LightParts, LitScene, RegionLight

# The record of a scene with effects left out: what is gone from it is computed by nobody


def acting(scene: LitScene, effects: frozenset[Effect]) -> LitScene:
    """Return the scene with all effects left out that do not act."""
    if effects >= ALL:
        return scene
    from model.effects.bounds import EFFECT_MODELS

    for effect, entry in EFFECT_MODELS.items():
        if effect not in effects:
            scene = entry.removed(scene)
    return scene


def acting_parts(effects: frozenset[Effect]) -> LightParts:
    """Return the parts of the light that are computed where some effects act.

    Parameters
    ----------
    effects
        That act.
    """
    return LightParts(
        field_of_view=Effect.FIELD_OF_VIEW in effects,
        skylight=Effect.SKYLIGHT in effects,
        path_radiance=Effect.PATH_RADIANCE in effects,
        wavelengths=Effect.WAVELENGTHS in effects,
    )


# Plan of the effects that a scene calls for: the others are left out within a tolerance, each with its reason

# Light of the regions where only these effects act.
KnownLight = Callable[[frozenset[Effect]], tuple[RegionLight, ...]]
# Estimates of effects with these bounds, those that cannot be had left out.
Estimates = Callable[[Mapping[Effect, Bound]], Mapping[Effect, Estimate]]
# A sharper bound of an effect than the general one, from the limits of the light; None where there is none.
SharperBound = Callable[[Mapping[str, LightLimits]], Bound | None]
# A bound below this share of the tolerance needs no estimate.
_SMALL = 0.5

# Effects of the light before the lens: those that cost time.
LIGHT = frozenset(effect for effect, entry in EFFECT_MODELS.items() if entry.of_light)
# Of them those that cost most, decided first: where they are left out, one wavelength misses nothing of them.
_OF_AIR = frozenset({Effect.SKYLIGHT, Effect.PATH_RADIANCE})

_NO_CHOICE: Mapping[Effect, bool] = {}


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
    others += map(_unasked, (one for one in Effect if one not in asked | LIGHT))
    decisions = sorted([*of_light, *others], key=lambda one: one.bound.largest)
    return EffectPlan(decisions=tuple(decisions), tolerance=tolerance, spent=spent.by(rule), rule=rule)


def _unasked(effect: Effect) -> Decision:
    return Decision(effect=effect, acts=True, bound=EVERYTHING, reason="costs less than to look for a bound of it")


def _sharpened(
    bounds: dict[Effect, Bound], limits: Mapping[str, LightLimits], choice: "_Choice", sharper: SharperBound | None
) -> dict[Effect, Bound]:
    """Bounds with that of skylight sharper, where a decision may hang on it; that of detection stays."""
    general = bounds[Effect.SKYLIGHT]
    is_asked = general.detection <= choice.tolerance < general.largest and Effect.SKYLIGHT not in choice.forced
    found = sharper(limits) if sharper is not None and is_asked else None
    if found is None:
        return bounds
    return bounds | {Effect.SKYLIGHT: general.tighter(replace(found, detection=general.detection))}


def _bounds_beside(
    scene: LitScene, forced: Mapping[Effect, bool], limits: Mapping[str, LightLimits], effects: frozenset[Effect]
) -> dict[Effect, Bound]:
    """Bounds of effects beside what is left over: noise that is left out by request hides nothing of other noise."""
    off = frozenset(effect for effect, is_on in forced.items() if not is_on) - LIGHT
    left = scene
    for effect in off:
        left = EFFECT_MODELS[effect].removed(left)
    found = effect_bounds(left, limits, effects - off)
    return found | (effect_bounds(scene, limits, effects & off) if effects & off else {})


def plan_of_all(forced: Mapping[Effect, bool] = _NO_CHOICE, *, tolerance: float = 0.0) -> EffectPlan:
    """Return the plan in which every effect acts that is not left out by request; no bound is looked for.

    Parameters
    ----------
    forced
        Effects that the user switched on (True) or off (False).
    tolerance
        Stated in the plan; nothing is spent of it.
    """
    choice = _Choice(tolerance=tolerance, forced=forced, rule="all")
    found, _ = choice.decided(dict.fromkeys(Effect, EVERYTHING), _Spent())
    return EffectPlan(decisions=tuple(found), tolerance=tolerance, rule="all")


@dataclass(frozen=True, kw_only=True)
class _Spent:
    """Sum of what may change by what is left out, by either rule."""

    by_bound: Bound = field(default_factory=Bound)
    by_estimate: Bound = field(default_factory=Bound)

    def by(self, rule: EffectRule) -> Bound:
        """Return the sum by one rule."""
        return {"safe": self.by_bound, "estimated": self.by_estimate, "all": Bound()}[rule]


@dataclass(frozen=True, kw_only=True)
class _Unlit:
    """What effects change beside skylight and path radiance, for a rule by which these are left out; else nothing."""

    by_bound: Mapping[Effect, Bound] = field(default_factory=dict)
    by_estimate: Mapping[Effect, Bound] = field(default_factory=dict)


_LIT = _Unlit()


def _unlit(
    bounds_of: Callable[[Mapping[str, LightLimits], frozenset[Effect]], dict[Effect, Bound]],
    limits: Mapping[str, LightLimits],
    of_air: Sequence[Decision],
) -> _Unlit:
    by_bound, by_estimate = (
        not any(getattr(one, rule) or one.forced for one in of_air) for rule in ("acts_by_bound", "acts_by_estimate")
    )
    if not (by_bound or by_estimate):
        return _LIT
    dark = {name: replace(one, sky=0.0, sky_polarised=0.0, path=0.0) for name, one in limits.items()}
    found = bounds_of(dark, frozenset({Effect.WAVELENGTHS}))
    return _Unlit(by_bound=found if by_bound else {}, by_estimate=found if by_estimate else {})


@dataclass(frozen=True, kw_only=True)
class _LeftOut:
    """Effects that a rule leaves out, the sums that each reached or would have, and the sum of what is left out."""

    effects: frozenset[Effect]
    sums: Mapping[Effect, float]
    spent: Bound


@dataclass(frozen=True, kw_only=True)
class _Choice:
    """What decides of an effect."""

    tolerance: float
    forced: Mapping[Effect, bool]
    rule: EffectRule
    estimates: Estimates | None = None
    every_estimate: bool = False

    def decided(
        self, bounds: Mapping[Effect, Bound], spent: _Spent, *, unlit: _Unlit = _LIT
    ) -> tuple[list[Decision], _Spent]:
        """Return decisions by both rules, and what they spend."""
        by_bound = self._left_out({**bounds, **unlit.by_bound}, spent.by_bound)
        found = self._estimated(bounds, by_bound.effects)
        most = {one: bound.tighter(found[one].most) if one in found else bound for one, bound in bounds.items()}
        by_estimate = self._left_out({**most, **unlit.by_estimate}, spent.by_estimate)
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

    def _estimated(self, bounds: Mapping[Effect, Bound], left_out: frozenset[Effect]) -> Mapping[Effect, Estimate]:
        """Return estimates, where any are wanted: of effects that their bounds let act, and of others beside them."""
        undecided = {one for one, bound in bounds.items() if bound.largest > 0.0} - left_out - self.forced.keys()
        if self.estimates is None or not (undecided or self.every_estimate):
            return {}
        least = 0.0 if self.every_estimate else _SMALL * self.tolerance
        return self.estimates({one: bound for one, bound in bounds.items() if bound.largest > least})

    def _left_out(self, most: Mapping[Effect, Bound], spent: Bound) -> _LeftOut:
        effects, sums = set(), {}
        for effect in sorted(most.keys() - self.forced.keys(), key=lambda one: (most[one].largest, one)):
            total = spent + most[effect]
            sums[effect] = total.largest if most[effect].largest > 0.0 else 0.0
            if sums[effect] <= self.tolerance:
                effects.add(effect)
                spent = total
        return _LeftOut(effects=frozenset(effects), sums=sums, spent=spent)

    def _reason(self, effect: Effect, used: _LeftOut) -> str:
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
