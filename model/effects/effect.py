"""Effects of the model: their names, bounds of what leaving one out changes, and decisions on which of them act.

An effect is a part of the physics that a prediction can do without: skylight, the field of view, read noise. Those of
the light before the lens cost time, so that a plan leaves them out where a bound shows that nobody would notice. Those
of sensor and session cost microseconds: they act where the scene states them.
"""

from collections.abc import Callable
from dataclasses import astuple, dataclass, field, fields
from enum import StrEnum
from typing import Literal

import numpy as np


class Effect(StrEnum):
    """Effects that can be left out of a prediction, each on its own."""

    FIELD_OF_VIEW = "field of view"
    TEXTURE = "texture"
    SKYLIGHT = "skylight"
    PATH_RADIANCE = "path radiance"
    LEAKAGE = "leakage"
    DARK_CURRENT = "dark current"
    SHOT_NOISE = "shot noise"
    READ_NOISE = "read noise"
    QUANTISATION = "quantisation"
    WAVELENGTHS = "wavelengths"
    POLARIZER_ANGLE = "polarizer angle"
    MISREGISTRATION = "misregistration"
    DRIFT = "drift"
    NONUNIFORMITY = "non-uniformity"
    SATURATION = "saturation"
    FALLOFF = "off-axis falloff"
    ADJACENCY = "adjacency"


#: What decides whether an effect of the light is left out: its bound, or nothing.
EffectRule = Literal["safe", "all"]

ALL = frozenset(Effect)
#: Effects of the light before the lens: those that cost time.
LIGHT = frozenset({Effect.FIELD_OF_VIEW, Effect.SKYLIGHT, Effect.PATH_RADIANCE, Effect.WAVELENGTHS, Effect.ADJACENCY})


@dataclass(frozen=True, kw_only=True)
class Bound:
    """Largest change of what is read off a prediction; each is 0 or more, infinite where nothing is known."""

    radiance: float = 0.0  #: of S0, S1 and S2 over S0, and of each angle's counts over themselves
    ratios: float = 0.0  #: of DoLP, S1/S0 and S2/S0 of the mean, and of the mean of the pixels' DoLP
    deviations: float = 0.0  #: of every standard deviation and of the SNR of DoLP, relative
    detection: float = 0.0  #: of every probability of detection, and of the area under its curve

    @property
    def largest(self) -> float:
        """The largest of the four."""
        return max(self.radiance, self.ratios, self.deviations, self.detection)

    @property
    def in_words(self) -> str:
        """What changes by how much, as text."""
        if all(np.isinf(value) for value in astuple(self)):
            return "any amount"
        parts = [
            f"{one.name} {'any amount' if np.isinf(value) else format(value, '.1e')}"
            for one, value in zip(fields(self), astuple(self), strict=True)
            if value > 0.0
        ]
        return ", ".join(parts) or "nothing"

    def __add__(self, other: "Bound") -> "Bound":
        """Return the sums, which bound what two effects change together."""
        return self._with(other, lambda one, more: one + more)

    def worse(self, other: "Bound") -> "Bound":
        """Return the larger of each."""
        return self._with(other, max)

    def tighter(self, other: "Bound") -> "Bound":
        """Return the smaller of each."""
        return self._with(other, min)

    def times(self, factor: float) -> "Bound":
        """Return each multiplied by a factor, 0 or more."""
        return self._with(self, lambda one, _: factor * one)

    def _with(self, other: "Bound", of: Callable[[float, float], float]) -> "Bound":
        names = (one.name for one in fields(self))
        return Bound(**dict(zip(names, map(of, astuple(self), astuple(other)), strict=True)))

    def holds(self, actual: "Bound", *, rounding: float = 1e-9) -> bool:
        """Return whether an actual change is within the bound, with room for rounding."""
        return all(
            is_within <= limit + rounding for is_within, limit in zip(astuple(actual), astuple(self), strict=True)
        )


# Where nothing is known.
EVERYTHING = Bound(radiance=np.inf, ratios=np.inf, deviations=np.inf, detection=np.inf)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision on an effect, and its reason."""

    effect: Effect
    acts: bool  #: whether it is computed
    bound: Bound  #: most that leaving it out can change; 0 if not stated, infinite for stated ones behind the lens
    reason: str
    forced: bool = False  #: whether the user decided
    acts_by_bound: bool = True  #: whether it is computed by the rule "safe"
    is_unstated: bool = False  #: whether it may be there though the scene says nothing of it
    #: Evaluated changes. An effect that acts is taken away; one that is not stated is added, at both ends of its usual
    #: range. Empty where none was evaluated.
    changes: tuple[Bound, ...] = ()

    @property
    def answer(self) -> Literal["acts", "left out", "not stated"]:
        """What was decided."""
        if self.is_unstated and not self.forced:
            return "not stated"
        return "acts" if self.acts else "left out"

    @property
    def change(self) -> Bound:
        """The larger of the evaluated changes, or the bound."""
        found = Bound()
        for one in self.changes:
            found = found.worse(one)
        return found if self.changes else self.bound


@dataclass(frozen=True, kw_only=True)
class EffectPlan:
    """Decisions on all effects of a scene."""

    decisions: tuple[Decision, ...]  #: in the order of their bounds, smallest first
    tolerance: float  #: allowed sum of the bounds of the effects that are left out
    spent: Bound = field(default_factory=Bound)  #: sum of the bounds of the effects that the planner left out
    rule: EffectRule = "safe"

    @property
    def active(self) -> frozenset[Effect]:
        """Effects that act."""
        return frozenset(one.effect for one in self.decisions if one.acts)

    @property
    def asked(self) -> frozenset[Effect]:
        """All effects but those that are left out by request."""
        return ALL - {one.effect for one in self.decisions if one.forced and not one.acts}

    def unstated_above(self, tolerance: float) -> "tuple[Decision, ...]":
        """Return the effects that nobody stated and that usually change a number by more, the largest first."""
        found = [one for one in self.decisions if one.answer == "not stated" and one.change.largest > tolerance]
        return tuple(sorted(found, key=lambda one: -one.change.largest))

    @property
    def remarks(self) -> tuple[str, ...]:
        """A remark for each stated effect that a user left out."""
        return tuple(
            f"{one.effect} is left out by request, though it may change numbers by {one.bound.in_words}"
            for one in self.decisions
            if one.forced and not one.acts and one.bound.largest > 0.0
        )
