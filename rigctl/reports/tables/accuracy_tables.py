"""The numerical error of a prediction to a tolerance: what each knob was set to, what it leaves, and what it cost."""

from typing import Any

from rich.table import Table

from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS, STATISTICS
from model.accuracy.predict_to_tolerance import AccuratePrediction

_PERCENT = 100.0
_MOST_LISTED = 6


def accuracy_table(found: AccuratePrediction) -> Table:
    """Return each knob with its setting, the largest error that is left by it, and how that was estimated."""
    title = f"numerical error, tolerance {found.tolerance:g}"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for name in ("knob", "setting", "largest error", "estimated by"):
        table.add_column(name)
    for name, knob in NUMERICAL_SETTINGS.items():
        label = knob.levels[found.plan[name]].label
        table.add_row(name, label, f"{found.budget.worst(name):.1e}", knob.estimate)
    for name in STATISTICS:
        table.add_row(name, "as the tolerance asks", f"{found.budget.worst(name):.1e}", "its own rule")
    return table


def accuracy_lines(found: AccuratePrediction) -> list[str]:
    """Return the sum of the errors, the time of each stage, and what is not promised and why."""
    promised = {key: error for key, error in found.budget.total.items() if key not in found.not_guaranteed}
    lines = []
    if promised:
        worst = max(promised, key=lambda key: promised[key])
        lines.append(
            f"all {len(promised)} promised numbers keep {found.tolerance:g}; the largest estimated error is "
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
    }


def _share(seconds: float, total: float) -> str:
    return f"{_PERCENT * seconds / total:.0f} %" if total > 0.0 else "0 %"


def _number(error: float) -> float | None:
    return error if error < float("inf") else None
