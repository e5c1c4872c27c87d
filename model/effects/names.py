"""Names of effects, bounds of their consequences, and decisions on which of them act."""

from dataclasses import astuple, dataclass, field, fields
from enum import StrEnum
from typing import Literal

import numpy as np

# Names of the effects that a scene may call for beyond light on a surface and an ideal camera


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


# What decides whether an effect is left out: its bound, its estimate where that is the smaller, or nothing.
EffectRule = Literal["safe", "estimated", "all"]

ALL = frozenset(Effect)


# Bounds of the change of a prediction where an effect is left out


@dataclass(frozen=True, kw_only=True)
class Bound:
    """Largest change of what is read off a prediction; each is 0 or more, infinite where nothing is known.

    Attributes
    ----------
    radiance
        Of S0, S1 and S2 over S0, and of each angle's counts over themselves.
    ratios
        Of DoLP, S1/S0 and S2/S0 of the mean, and of the mean of the pixels' DoLP.
    deviations
        Of every standard deviation and of the SNR of DoLP, relative.
    detection
        Of every probability of detection, and of the area under its curve.
    """

    radiance: float = 0.0
    ratios: float = 0.0
    deviations: float = 0.0
    detection: float = 0.0

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
        return Bound(
            radiance=self.radiance + other.radiance,
            ratios=self.ratios + other.ratios,
            deviations=self.deviations + other.deviations,
            detection=self.detection + other.detection,
        )

    def worse(self, other: "Bound") -> "Bound":
        """Return the larger of each."""
        return Bound(
            radiance=max(self.radiance, other.radiance),
            ratios=max(self.ratios, other.ratios),
            deviations=max(self.deviations, other.deviations),
            detection=max(self.detection, other.detection),
        )

    def tighter(self, other: "Bound") -> "Bound":
        """Return the smaller of each."""
        return Bound(
            radiance=min(self.radiance, other.radiance),
            ratios=min(self.ratios, other.ratios),
            deviations=min(self.deviations, other.deviations),
            detection=min(self.detection, other.detection),
        )

    def times(self, factor: float) -> "Bound":
        """Return each multiplied by a factor, 0 or more."""
        return Bound(
            radiance=factor * self.radiance,
            ratios=factor * self.ratios,
            deviations=factor * self.deviations,
            detection=factor * self.detection,
        )

    def holds(self, actual: "Bound", *, rounding: float = 1e-9) -> bool:
        """Return whether an actual change is within the bound, with room for rounding."""
        return all(
            is_within <= limit + rounding for is_within, limit in zip(astuple(actual), astuple(self), strict=True)
        )


# Where nothing is known.
EVERYTHING = Bound(radiance=np.inf, ratios=np.inf, deviations=np.inf, detection=np.inf)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Change of a prediction where an effect is left out, as a coarse evaluation has it; nothing is promised.

    Attributes
    ----------
    value
        The change.
    error
        How far it may be off.
    """

    value: Bound
    error: Bound

    @property
    def most(self) -> Bound:
        """The change with its error."""
        return self.value + self.error


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Largest change of one region where an effect is left out."""

    s0: float = 0.0
    polarised: float = 0.0
    factor: float = 0.0
    share: float = 0.0
    counts: float = 0.0
    share_of_dolp: float | None = None

    @property
    def is_nothing(self) -> bool:
        """True if the effect is not there at all."""
        return not (self.s0 or self.polarised or self.factor or self.share or self.counts)


NOTHING = Disturbance()
UNKNOWN = Disturbance(s0=np.inf, polarised=np.inf)


# Decisions on the effects of a scene: which act, which are left out, and why


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
                f"{one.effect} is left out by request, though it may change numbers by {one.bound.in_words}"
                for one in self.decisions
                if one.forced and not one.acts and one.bound.largest > 0.0
            ),
            *(
                f"{one.effect} is left out by an estimate: it changes numbers by {one.most.in_words}; not guaranteed"
                for one in self.decisions
                if not one.forced and not one.acts and one.acts_by_bound
            ),
        )
