"""The numerical error of a prediction to a tolerance: what each knob was set to, what it leaves, and what it cost."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS, STATISTICS
from model.accuracy.predict_to_tolerance import AccuratePrediction
from model.accuracy.series_to_tolerance import SeriesCase, SeriesPrediction
from rigctl.reports.table import Column, Table

_PERCENT = 100.0
_MOST_LISTED = 6


@dataclass(frozen=True, kw_only=True)
class _ErrorOf:
    name: str
    setting: str
    error: float
    rule: str


def accuracy_table(found: AccuratePrediction) -> Table[_ErrorOf]:
    """Return each knob with its setting, the largest error that is left by it, and how that was estimated."""
    columns: tuple[Column[_ErrorOf], ...] = (
        Column(title="knob", text=lambda one: one.name, left=True),
        Column(title="setting", text=lambda one: one.setting, left=True),
        Column(title="largest error", text=lambda one: f"{one.error:.1e}", left=True),
        Column(title="estimated by", text=lambda one: one.rule, left=True),
    )
    rows = (*_errors_of_knobs(found), *_errors_of_statistics(found))
    return Table(title=f"numerical error, tolerance {found.tolerance:g}", columns=columns, rows=rows)


def _errors_of_knobs(found: AccuratePrediction) -> Iterable[_ErrorOf]:
    for name, knob in NUMERICAL_SETTINGS.items():
        label = knob.levels[found.plan[name]].label
        yield _ErrorOf(name=name, setting=label, error=found.budget.worst(name), rule=knob.estimate)


def _errors_of_statistics(found: AccuratePrediction) -> Iterable[_ErrorOf]:
    for name in STATISTICS:
        yield _ErrorOf(name=name, setting="as the tolerance asks", error=found.budget.worst(name), rule="its own rule")


def accuracy_lines(found: AccuratePrediction) -> list[str]:
    """Return the sum of the errors, the time of each stage, and what is not promised and why."""
    promised = {key: error for key, error in found.budget.total.items() if key not in found.not_guaranteed}
    lines = []
    if promised:
        worst = max(promised, key=lambda key: promised[key])
        kind = (
            "numbers, of which errors are estimated and none is promised,"
            if found.estimated_only
            else ("promised numbers")
        )
        lines.append(
            f"all {len(promised)} {kind} keep {found.tolerance:g}; the largest estimated error is "
            f"{promised[worst]:.1e} ({', '.join(worst)})"
        )
    total = sum(found.stage_s.values())
    parts = ", ".join(f"{stage} {_share(seconds, total)}" for stage, seconds in found.stage_s.items())
    lines.append(f"{total:.2g} s in {found.rounds} rounds: {parts}")
    missed = [f"{', '.join(key)}: {reason}" for key, reason in found.not_guaranteed.items()]
    lines += [f"not promised: {line}" for line in missed[:_MOST_LISTED]]
    if len(missed) > _MOST_LISTED:
        lines.append(f"not promised: {len(missed) - _MOST_LISTED} more; --json lists all")
    return lines


def accuracy_json(found: AccuratePrediction) -> dict[str, Any]:
    """Return the same as JSON holds it; errors that are not known are null."""
    return {
        "tolerance": found.tolerance,
        "settings": {name: knob.levels[found.plan[name]].label for name, knob in NUMERICAL_SETTINGS.items()},
        "largest_error": {name: _number(found.budget.worst(name)) for name in found.budget.by_setting},
        "estimated_errors": [
            {"place": key.place, "quantity": key.quantity, "statistic": key.statistic, "error": _number(error)}
            for key, error in found.budget.total.items()
        ],
        "not_promised": {"/".join(key): reason for key, reason in found.not_guaranteed.items()},
        "stage_s": dict(found.stage_s),
        "rounds": found.rounds,
    } | ({"estimated_only": True} if found.estimated_only else {})


def series_lines(found: SeriesPrediction) -> list[str]:
    """Return how many cases of a series were judged, the largest error of any, and what is not promised."""
    errors = [error for case in found.cases for key, error in case.errors.items() if key not in case.not_guaranteed]
    total = sum(found.stage_s.values())
    judged = (
        f"tolerance {found.tolerance:g}: {found.judged} of {len(found.cases)} cases were judged, the others take the "
        f"plans and errors of their neighbours; {total:.2g} s, of it {_PERCENT * found.share_of_estimates:.0f} % for "
        "error estimates"
    )
    lines = [judged]
    if errors:
        lines.append(f"all {len(errors)} promised numbers keep it; the largest error is {max(errors):.1e}")
    missed = [
        f"case {place + 1}: {', '.join(key)}: {reason}"
        for place, case in enumerate(found.cases)
        for key, reason in case.not_guaranteed.items()
    ]
    lines += [f"not promised: {line}" for line in missed[:_MOST_LISTED]]
    if len(missed) > _MOST_LISTED:
        lines.append(f"not promised: {len(missed) - _MOST_LISTED} more; --json lists all")
    return lines


def series_json(found: SeriesPrediction) -> dict[str, Any]:
    """Return the same as JSON holds it, a list entry a case."""
    return {
        "tolerance": found.tolerance,
        "judged": [case.is_judged for case in found.cases],
        "largest_error": [_number(_largest(case)) for case in found.cases],
        "not_promised": [{"/".join(key): why for key, why in case.not_guaranteed.items()} for case in found.cases],
        "stage_s": dict(found.stage_s),
    }


def _largest(case: SeriesCase) -> float:
    return max((error for key, error in case.errors.items() if key not in case.not_guaranteed), default=0.0)


def _share(seconds: float, total: float) -> str:
    return f"{_PERCENT * seconds / total:.0f} %" if total > 0.0 else "0 %"


def _number(error: float) -> float | None:
    return error if error < float("inf") else None
