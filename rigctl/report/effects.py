"""Effects of a scene as JSON, and as the table of a comparison's report."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from model.effects.planner import EFFECTS
from rigctl.base.numbers import NOTHING, size
from rigctl.report.document import Column, Table
from rigctl.scene.effects import statement_of

if TYPE_CHECKING:
    from model.accuracy.effect_check import CheckedEffect
    from model.effects.effect import Bound, Decision, Effect, EffectPlan
    from rigctl.comparison.compare import NumericalAccuracy
    from rigctl.console import Json
    from rigctl.scene.effects import Verification


def taken_table(found: NumericalAccuracy) -> Table[Decision]:
    """Return each effect of the model: taken here or not, the most that leaving it out can change, and why."""
    columns: tuple[Column[Decision], ...] = (
        Column(title="effect", text=lambda one: one.effect.value, left=True),
        Column(title="taken here", text=lambda one: _taken(one, found.taken), left=True),
        Column(title="of DoLP, s1, s2", text=lambda one: size(one.bound.ratios)),
        Column(title="of counts", text=lambda one: size(one.bound.radiance)),
        Column(title="called for", text=lambda one: "yes" if one.acts else "no", left=True),
        Column(title="reason", text=lambda one: one.reason, left=True, wide=True),
    )
    return Table(
        columns=columns,
        rows=found.effects.decisions,
        is_off=lambda one: one.acts and one.effect not in found.taken,
    )


def _taken(one: Decision, taken: frozenset[Effect]) -> str:
    if one.effect not in taken:
        return "NO"
    return "yes" if one.bound.largest > 0.0 or one.acts else NOTHING


def effects_json(plan: EffectPlan, checked: Verification | None) -> dict[str, Json]:
    """Return the effects as JSON holds them; a bound that is not known is null."""
    found = {} if checked is None else {one.effect: one for one in checked.checked}
    content: dict[str, Json] = {
        "rule": plan.rule,
        "tolerance": plan.tolerance,
        "spent": _numbers(plan.spent),
        "effects": [_entry(one, found.get(one.effect)) for one in plan.decisions],
    }
    if checked is not None:
        content |= {
            "time_s": {"all_effects": checked.all_s, "acting_effects": checked.planned_s},
            "violations": [one.effect.value for one in checked.violations],
        }
    return content


def _entry(decision: Decision, checked: CheckedEffect | None) -> dict[str, Json]:
    facts = EFFECTS[decision.effect]
    entry: dict[str, Json] = {
        "effect": decision.effect.value,
        "acts": decision.acts,
        "answer": decision.answer,
        "forced": decision.forced,
        "bound": _numbers(decision.bound),
        "reason": decision.reason,
        "changes": facts.changes,
        "place": facts.place,
        "cost": facts.cost,
        "safe": {"acts": decision.acts_by_bound},
    }
    if decision.changes:
        entry |= {"sizes": [_numbers(one) for one in decision.changes]}
    if decision.answer == "not stated":
        found = statement_of(decision.effect)
        entry |= {"usual": found.words, "table": found.table, "line": found.line}
    if checked is None:
        return entry
    return entry | {
        "actual": _numbers(checked.actual),
        "time_s": {"with": checked.with_s, "without": checked.without_s},
    }


def _numbers(bound: Bound) -> dict[str, float | None]:
    return {kind: value if math.isfinite(value) else None for kind, value in asdict(bound).items()}


# Kinds of numbers that an effect changes, as a table and a sentence name them.
KINDS = {"ratios": "DoLP", "radiance": "counts", "deviations": "noise", "detection": "P_D"}


def unstated_line(plan: EffectPlan) -> str:
    """Return in one line which effects are not stated though they usually change more than is allowed; "" for none."""
    named = ", ".join(one.effect for one in plan.unstated_above(plan.tolerance))
    return f"not stated, and usually above {plan.tolerance:.2g}: {named}" if named else ""


def left_out_line(plan: EffectPlan) -> str:
    """Return in words what was left out though it is there."""
    names = [one.effect.value for one in plan.decisions if not one.acts and one.bound.largest > 0.0 and not one.forced]
    if not names:
        asked = any(one.forced and not one.acts and one.bound.largest > 0.0 for one in plan.decisions)
        return "effects: every other effect of the scene acts" if asked else "effects: every effect of the scene acts"
    return (
        f"effects left out: {', '.join(names)}; together they change no number by more than {size(plan.spent.largest)}"
    )
