"""Effects of a scene as a table and as JSON: bound, decision, reason, cost."""

import math
from dataclasses import asdict
from typing import Any

from rich.table import Table

from model.effects.bound import Bound
from model.effects.effect_models import EFFECT_MODELS
from model.effects.names import Effect
from model.effects.planner import Decision, EffectPlan
from rigctl.scene.effect_plan import Verification

_KINDS = ("radiance", "ratios", "deviations", "detection")


def effects_table(plan: EffectPlan, checked: Verification | None) -> Table:
    """Return the table of effects, with what those left out truly change where that was found out."""
    table = Table(title=_title(plan), title_justify="left", box=None, pad_edge=False)
    table.add_column("effect")
    table.add_column("decision")
    for kind in _KINDS:
        table.add_column(kind, justify="right", no_wrap=True)
    table.add_column("reason")
    table.add_column("cost")
    found = _actual(checked)
    for decision in plan.decisions:
        table.add_row(*_cells(decision, found.get(decision.effect)))
    return table


def effects_json(plan: EffectPlan, checked: Verification | None) -> dict[str, Any]:
    """Return the same as JSON holds it; a bound that is not known is null."""
    found = _actual(checked)
    content: dict[str, Any] = {
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
    return f"effects left out: {', '.join(names)}; together they change no number by more than {plan.spent.largest:.1e}"


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


def _cells(decision: Decision, actual: Bound | None) -> list[str]:
    facts = EFFECT_MODELS[decision.effect]
    limits = asdict(decision.bound)
    shown = [_number(limits[kind]) for kind in _KINDS]
    if actual is not None:
        truly = asdict(actual)
        shown = [f"{limit} ({_number(truly[kind])})" for kind, limit in zip(_KINDS, shown, strict=True)]
    return [
        decision.effect.value,
        "acts" if decision.acts else "left out",
        *shown,
        decision.reason,
        facts.cost,
    ]


def _entry(decision: Decision, actual: Bound | None) -> dict[str, Any]:
    facts = EFFECT_MODELS[decision.effect]
    entry: dict[str, Any] = {
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
