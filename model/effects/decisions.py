"""Decisions on the effects of a scene: which act, which are left out, and why."""

from dataclasses import dataclass, field

from model.effects.bound import Bound, Estimate
from model.effects.names import Effect, EffectRule


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
