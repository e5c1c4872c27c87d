"""Effects of a scene as a table and as JSON: bound, decision, reason, cost."""

import math
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING

from model.accuracy.effect_estimates import CheckedEffect
from model.effects.bounds import EFFECT_MODELS
from model.effects.names import Bound, Decision, Effect, EffectPlan
from rigctl.comparison.comparison import EffectsTaken
from rigctl.console.json_text import Json
from rigctl.numbers.number_text import NOTHING, size
from rigctl.reports.table import Column, Table
from rigctl.scene.effect_plan import Verification

if TYPE_CHECKING:
    from rigctl.simulated.rendering_costs import RenderingCost, RenderingCosts

_KINDS = ("radiance", "ratios", "deviations", "detection")


@dataclass(frozen=True, kw_only=True)
class _EffectRow:
    decision: Decision
    checked: CheckedEffect | None = None


def effects_table(plan: EffectPlan, checked: Verification | None) -> Table[_EffectRow]:
    """Return the effects: bound, estimate and both decisions, and the true change where that was found out."""
    found = _by_effect(checked)
    columns: tuple[Column[_EffectRow], ...] = (
        Column(title="effect", text=_name, left=True),
        Column(title="here", text=lambda row: _said(row.decision.acts), left=True),
        Column(title="safe", text=lambda row: _said(row.decision.acts_by_bound), left=True),
        Column(title="est.", text=lambda row: _said(row.decision.acts_by_estimate), left=True),
        *(Column(title=kind, text=partial(_limit, kind=kind), unbroken=True) for kind in _KINDS),
        Column(title="reason", text=lambda row: row.decision.reason, left=True),
        Column(title="cost" if checked is None else "time", text=_cost, left=True),
    )
    rows = tuple(_EffectRow(decision=one, checked=found.get(one.effect)) for one in plan.decisions)
    return Table(title=_title(plan, checked), columns=columns, rows=rows)


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
    found = _by_effect(checked)
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


def rendering_table(found: "RenderingCosts") -> "Table[RenderingCost]":
    """Return the effects of a simulated camera's pictures, with what each costs a frame."""
    columns: tuple[Column[RenderingCost], ...] = (
        Column(title="effect", text=lambda row: row.effect, left=True),
        Column(title="acts on", text=lambda row: row.place, left=True),
        Column(title="ms a frame", text=lambda row: f"{1e3 * row.cost_s:.2f}"),
    )
    title = (
        f"effects of the simulated pictures: medians of {found.frames} frames, {1e3 * found.frame_s:.1f} ms each; what "
        "the rig file does not name is not called"
    )
    return Table(title=title, columns=columns, rows=found.costs)


def rendering_json(found: "RenderingCosts") -> dict[str, Json]:
    """Return the same as JSON holds it."""
    effects: list[Json] = [{"effect": one.effect, "place": one.place, "cost_s": one.cost_s} for one in found.costs]
    return {"rendering": effects, "frame_s": found.frame_s, "frames": found.frames}


def left_out_line(plan: EffectPlan) -> str:
    """Return in words what was left out though it is there."""
    names = [one.effect.value for one in plan.decisions if not one.acts and one.bound.largest > 0.0 and not one.forced]
    surely = "together they change no number by more than"
    if plan.rule == "estimated":
        surely = "together they are estimated, errors included, to change no number by more than"
    if not names:
        asked = any(one.forced and not one.acts and one.bound.largest > 0.0 for one in plan.decisions)
        return "effects: every other effect of the scene acts" if asked else "effects: every effect of the scene acts"
    return f"effects left out: {', '.join(names)}; {surely} {size(plan.spent.largest)}"


def saved_line(checked: Verification) -> str:
    """Return what leaving out saved, in words."""
    saved = 1.0 - checked.planned_s / checked.all_s
    return (
        f"time of the chain, nothing being kept from before: {checked.all_s:.3g} s with all effects, "
        f"{checked.planned_s:.3g} s with those that act ({max(saved, 0.0):.0%} saved)"
    )


def _title(plan: EffectPlan, checked: Verification | None) -> str:
    truth = "" if checked is None else "; in brackets what does change"
    return (
        f"effects: most that each kind of number can change if one is left out (any: no bound); ~ what a coarse\n"
        f"evaluation estimates, with its error{truth}. By the rule {plan.rule}: left out while the sums stay within "
        f"{plan.tolerance:.2g};\n{plan.spent.largest:.2g} of it is spent"
    )


def _by_effect(checked: Verification | None) -> dict[Effect, CheckedEffect]:
    return {} if checked is None else {one.effect: one for one in checked.checked}


def _said(acts: bool) -> str:
    return "acts" if acts else "out"


def _cost(row: _EffectRow) -> str:
    """Return the effort of computing an effect, and what it took where that was measured."""
    if row.checked is None:
        return EFFECT_MODELS[row.decision.effect].cost
    return f"{1e3 * max(row.checked.with_s - row.checked.without_s, 0.0):.2g} ms"


def _name(row: _EffectRow) -> str:
    return row.decision.effect.value


def _limit(row: _EffectRow, *, kind: str) -> str:
    """Return the most that a kind of number can change, below it the estimate, and in brackets what it does change."""
    lines, estimate = [_number(getattr(row.decision.bound, kind))], row.decision.estimate
    if estimate is not None and getattr(estimate.value, kind) > 0.0:
        lines.append(f"~{_number(getattr(estimate.value, kind))} +- {_number(getattr(estimate.error, kind))}")
    if row.checked is not None and (getattr(row.checked.actual, kind) > 0.0 or len(lines) > 1):
        lines.append(f"({_number(getattr(row.checked.actual, kind))})")
    return "\n".join(lines)


def _taken(one: Decision, taken: frozenset[Effect]) -> str:
    if one.effect not in taken:
        return "NO"
    return "yes" if one.bound.largest > 0.0 or one.acts else NOTHING


def _entry(decision: Decision, checked: CheckedEffect | None) -> dict[str, Json]:
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
        "safe": {"acts": decision.acts_by_bound},
        "estimated": {
            "acts": decision.acts_by_estimate,
            "value": None if decision.estimate is None else _numbers(decision.estimate.value),
            "error": None if decision.estimate is None else _numbers(decision.estimate.error),
        },
    }
    if checked is None:
        return entry
    return entry | {
        "actual": _numbers(checked.actual),
        "time_s": {"with": checked.with_s, "without": checked.without_s},
    }


def _numbers(bound: Bound) -> dict[str, float | None]:
    return {kind: value if math.isfinite(value) else None for kind, value in asdict(bound).items()}


def _number(value: float) -> str:
    if value == 0.0:
        return "0"
    return f"{value:.0e}" if math.isfinite(value) else "any"
