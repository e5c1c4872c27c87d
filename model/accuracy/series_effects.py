"""Effects that a series of neighbouring scenes leaves out: decided for those that are judged, shared between them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from model.effects.decisions import EffectPlan
from model.effects.names import ALL, Effect, EffectRule
from model.effects.planner import LIGHT
from model.scene.lit_scene import LitScene

# What an estimate between judged scenes may be, over the largest of theirs.
_MARGIN = 1.5


@dataclass(frozen=True, kw_only=True)
class TakenEffects:
    """Effects that act in one scene of a series.

    Attributes
    ----------
    acting
        Those that act.
    left_out
        Those that a rule left out, and no request.
    spent
        What that may change, in the units of the tolerance.
    """

    acting: frozenset[Effect] = ALL
    left_out: frozenset[Effect] = frozenset()
    spent: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SeriesEffects:
    """How the effects of a series are decided.

    Attributes
    ----------
    acting
        Those that are not left out by request.
    rule
        By bounds, by estimates, or none is left out.
    planned
        Gives the plan of a scene by this rule; None for the rule "all".

    Notes
    -----
    Only effects of the light are left out, which cost time; those behind the lens cost microseconds.
    """

    acting: frozenset[Effect] = ALL
    rule: EffectRule = "all"
    planned: Callable[[LitScene], EffectPlan] | None = None

    def of(self, scene: LitScene) -> TakenEffects:
        """Return the effects of a scene by a plan of its own."""
        if self.planned is None or self.rule == "all":
            return TakenEffects(acting=self.acting)
        plan = self.planned(scene)
        there = {one.effect for one in plan.decisions if one.bound.largest > 0.0}
        left_out = (LIGHT & self.acting & there) - plan.active
        return self._without(left_out, spent=plan.spent.largest if left_out else 0.0)

    def between(self, scene: LitScene, neighbours: Sequence[TakenEffects]) -> TakenEffects:
        """Return the effects of a scene between others: what all of these leave out.

        Parameters
        ----------
        scene
            To be evaluated.
        neighbours
            As `of` or this gave them.

        Notes
        -----
        Bounds are held to the scene itself, for they are promises; estimates are taken from its neighbours, with a
        margin.
        """
        left_out = frozenset.intersection(*(one.left_out for one in neighbours))
        if not left_out:
            return TakenEffects(acting=self.acting)
        if self.rule == "safe":
            own = self.of(scene)
            return self._without(left_out & own.left_out, spent=own.spent)
        return self._without(left_out, spent=_MARGIN * max(one.spent for one in neighbours))

    def _without(self, left_out: frozenset[Effect], *, spent: float) -> TakenEffects:
        return TakenEffects(acting=self.acting - left_out, left_out=left_out, spent=spent if left_out else 0.0)
