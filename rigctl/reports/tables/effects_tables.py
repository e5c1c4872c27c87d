"""Effects of a scene as a table and as JSON: bound, decision, reason, cost."""

import math
from dataclasses import asdict, dataclass
from functools import partial

from model.effects.bound import Bound
from model.effects.effect_models import EFFECT_MODELS
from model.effects.names import Effect
from model.effects.planner import Decision, EffectPlan
from rigctl.comparison.compared_run import EffectsTaken
from rigctl.console.json_text import Json
from rigctl.numbers.number_text import NOTHING, size
from rigctl.reports.table import Column, Table
from rigctl.scene.effect_plan import Verification

_KINDS = ("radiance", "ratios", "deviations", "detection")


@dataclass(frozen=True, kw_only=True)
class _EffectRow:
    decision: Decision
    actual: Bound | None = None


def effects_table(plan: EffectPlan, checked: Verification | None) -> Table[_EffectRow]:
    """Return the effects, with what those left out truly change where that was found out."""
    found = _actual(checked)
    columns: tuple[Column[_EffectRow], ...] = (
        Column(title="effect", text=_name, left=True),
        Column(title="decision", text=lambda row: "acts" if row.decision.acts else "left out", left=True),
        *(Column(title=kind, text=partial(_limit, kind=kind), unbroken=True) for kind in _KINDS),
        Column(title="reason", text=lambda row: row.decision.reason, left=True),
        Column(title="cost", text=lambda row: EFFECT_MODELS[row.decision.effect].cost, left=True),
    )
    rows = tuple(_EffectRow(decision=one, actual=found.get(one.effect)) for one in plan.decisions)
    return Table(title=_title(plan), columns=columns, rows=rows)


def taken_table(found: EffectsTaken) -> Table[_EffectRow]:
    """Return each effect of the model: taken here or not, the most that leaving it out can change, and why."""
    columns: tuple[Column[_EffectRow], ...] = (
        Column(title="effect", text=_name, left=True),
        Column(title="taken here", text=lambda row: _taken(row.decision, found.taken), left=True),
        Column(title="of DoLP, s1, s2", text=lambda row: size(row.decision.bound.ratios)),
        Column(title="of counts", text=lambda row: size(row.decision.bound.radiance)),
        Column(title="called for", text=lambda row: "yes" if row.decision.acts else "no", left=True),
        Column(title="reason", text=lambda row: row.decision.reason, left=True, wide=True),
    )
    return Table(
        columns=columns,
        rows=tuple(_EffectRow(decision=one) for one in found.plan.decisions),
        is_off=lambda row: row.decision.acts and row.decision.effect not in found.taken,
    )


def effects_json(plan: EffectPlan, checked: Verification | None) -> dict[str, Json]:
    """Return the same as JSON holds it; a bound that is not known is null."""
    found = _actual(checked)
    content: dict[str, Json] = {
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


def left_out_line(plan: EffectPlan) -> str:
    """Return in words what was left out though it is there."""
    names = [one.effect.value for one in plan.decisions if not one.acts and one.bound.largest > 0.0 and not one.forced]
    if not names:
        asked = any(one.forced and not one.acts and one.bound.largest > 0.0 for one in plan.decisions)
        return "effects: every other effect of the scene acts" if asked else "effects: every effect of the scene acts"
    return (
        f"effects left out: {', '.join(names)}; together they change no number by more than {size(plan.spent.largest)}"
    )


def saved_line(checked: Verification) -> str:
    """Return what leaving out saved, in words."""
    saved = 1.0 - checked.planned_s / checked.all_s
    return (
        f"time of the chain, nothing being kept from before: {checked.all_s:.3g} s with all effects, "
        f"{checked.planned_s:.3g} s with those that act ({max(saved, 0.0):.0%} saved)"
    )


def _title(plan: EffectPlan) -> str:
    return (
        f"effects: most that each kind of number can change if left out (in brackets: does change; any: no bound).\n"
        f"Left out while the sums stay within {plan.tolerance:.2g}; {plan.spent.largest:.2g} of it is spent"
    )


def _actual(checked: Verification | None) -> dict[Effect, Bound]:
    return {} if checked is None else {one.effect: one.actual for one in checked.checked}


def _name(row: _EffectRow) -> str:
    return row.decision.effect.value


def _limit(row: _EffectRow, *, kind: str) -> str:
    """Return the most that a kind of number can change, and in brackets what it does change."""
    limit = _number(getattr(row.decision.bound, kind))
    return limit if row.actual is None else f"{limit} ({_number(getattr(row.actual, kind))})"


def _taken(one: Decision, taken: frozenset[Effect]) -> str:
    if one.effect not in taken:
        return "NO"
    return "yes" if one.bound.largest > 0.0 or one.acts else NOTHING


def _entry(decision: Decision, actual: Bound | None) -> dict[str, Json]:
    facts = EFFECT_MODELS[decision.effect]
    entry: dict[str, Json] = {
        "effect": decision.effect.value,
        "acts": decision.acts,
        "forced": decision.forced,
        "bound": _numbers(decision.bound),
        "reason": decision.reason,
        "changes": facts.changes,
        "place": facts.place,
        "cost": facts.cost,
    }
    return entry if actual is None else entry | {"actual": _numbers(actual)}


def _numbers(bound: Bound) -> dict[str, float | None]:
    return {kind: value if math.isfinite(value) else None for kind, value in asdict(bound).items()}


def _number(value: float) -> str:
    if value == 0.0:
        return "0"
    return f"{value:.0e}" if math.isfinite(value) else "any"
