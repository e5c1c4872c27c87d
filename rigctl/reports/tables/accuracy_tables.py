"""Accuracy against time as tables, CSV and JSON: what a tolerance costs, knob by knob and for the whole chain."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

from model.accuracy.chain import Reading
from model.accuracy.plan import NUMERICAL_SETTINGS, STATISTICS
from model.accuracy.predict import AccuratePrediction
from model.accuracy.series import SeriesCase, SeriesPrediction
from rigctl.console.json_text import Json
from rigctl.numbers.number_text import size
from rigctl.prediction.accuracy_curves import CurvePoint, Curves
from rigctl.prediction.paper_choices import NamedChoice
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.data_files import json_rows

_PERCENT = 100.0
_MOST_LISTED = 6
_SHOWN_FLOORS = ("radiance", "s1n", "s2n", "dolp_pixels", "p_detection")


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
        Column(title="largest error", text=lambda one: size(one.error), left=True),
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


def accuracy_json(found: AccuratePrediction) -> dict[str, Json]:
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
        **({"estimated_only": True} if found.estimated_only else {}),
    }


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
    if found.spot_checks:
        lines.append(
            f"{found.spot_checks} judged to see whether errors between others are as these tell: "
            f"{found.spot_checks_held} were"
        )
    lines += [f"left out: {text}" for text in _left_out(found)]
    if errors:
        kind = "estimated errors of numbers, none of them promised," if found.estimated_only else "promised numbers"
        lines.append(f"all {len(errors)} {kind} keep it; the largest error is {max(errors):.1e}")
    missed = [
        f"case {place + 1}: {', '.join(key)}: {reason}"
        for place, case in enumerate(found.cases)
        for key, reason in case.not_guaranteed.items()
    ]
    lines += [f"not promised: {line}" for line in missed[:_MOST_LISTED]]
    if len(missed) > _MOST_LISTED:
        lines.append(f"not promised: {len(missed) - _MOST_LISTED} more; --json lists all")
    return lines


def series_json(found: SeriesPrediction) -> dict[str, Json]:
    """Return the same as JSON holds it, a list entry a case."""
    return {
        "tolerance": found.tolerance,
        "judged": [case.is_judged for case in found.cases],
        "largest_error": [_number(_largest(case)) for case in found.cases],
        "not_promised": [{"/".join(key): why for key, why in case.not_guaranteed.items()} for case in found.cases],
        "left_out": [sorted(case.effects.left_out) for case in found.cases],
        "spot_checks": found.spot_checks,
        "spot_checks_held": found.spot_checks_held,
        "share_of_estimates": found.share_of_estimates,
        "stage_s": dict(found.stage_s),
        **({"estimated_only": True} if found.estimated_only else {}),
    }


def _left_out(found: SeriesPrediction) -> Iterable[str]:
    """Yield the effects that cases leave out, and of how many."""
    several = Counter(effect for case in found.cases for effect in case.effects.left_out)
    for effect, times in several.items():
        most = max(case.effects.spent for case in found.cases if effect in case.effects.left_out)
        yield f"{effect}, in {times} of {len(found.cases)} cases; all that is left out changes {most:.1e} at the most"


def _largest(case: SeriesCase) -> float:
    return max((error for key, error in case.errors.items() if key not in case.not_guaranteed), default=0.0)


def _share(seconds: float, total: float) -> str:
    return f"{_PERCENT * seconds / total:.0f} %" if total > 0.0 else "0 %"


def _number(error: float) -> float | None:
    return error if error < float("inf") else None


@dataclass(frozen=True, kw_only=True)
class _Point:
    point: CurvePoint
    on_front: bool


def _error(one: _Point, name: str) -> float:
    found: float = getattr(one.point, name)
    return found


def _digits(one: _Point, name: str) -> str:
    error = _error(one, name)
    return "-" if math.isnan(error) else f"{error:.1e}"


def _six_digits(one: _Point, name: str) -> str:
    return f"{_error(one, name):.6g}"


# CSV has six figures: times are measured, errors estimated.
_COLUMNS: tuple[Column[_Point], ...] = (
    Column(title="knob", key="knob", value=lambda one: one.point.varied, left=True),
    Column(title="setting", key="setting", value=lambda one: one.point.level, left=True),
    Column(
        title="seconds",
        key="seconds",
        value=lambda one: one.point.seconds,
        text=lambda one: f"{one.point.seconds:.3g}",
        csv=lambda one: f"{one.point.seconds:.6g}",
    ),
    *(
        Column(
            title=title,
            key=key,
            value=partial(_error, name=name),
            text=partial(_digits, name=name),
            csv=partial(_six_digits, name=name),
        )
        for title, key, name in (
            ("true error", "true_error", "true"),
            ("estimated error", "estimated_error", "estimated"),
            ("error of all", "error_of_all", "whole"),
        )
    ),
    Column(
        title="front",
        key="on_front",
        value=lambda one: one.on_front,
        text=lambda one: "*" if one.on_front else "",
        csv=lambda one: str(int(one.on_front)),
        left=True,
    ),
)


def curve_table(curves: Curves) -> Table[_Point]:
    """Return every point; a star marks the front."""
    front = set(curves.front)
    rows = tuple(_Point(point=point, on_front=point in front) for point in curves.points)
    return Table(title="error against time", columns=_COLUMNS, rows=rows)


def curve_json(curves: Curves) -> dict[str, Json]:
    """Return points, choices and the floor as JSON holds them."""
    return {
        "points": json_rows(curve_table(curves)),
        "choices": [accuracy_json(found) for found in curves.predictions],
        "input_floor": {"/".join(key): floor for key, floor in curves.floor.items()},
        "reference_s": curves.reference_s,
        "named_points": json_rows(named_table(curves)),
        "digits": [
            {"quantity": one.quantity, "seconds": one.seconds, "true_error": one.error} for one in curves.digits
        ],
    }


def named_table(curves: Curves) -> Table[NamedChoice]:
    """Return the paper's choices, and the user's: all other settings are fine."""
    columns: tuple[Column[NamedChoice], ...] = (
        Column(title="choice", key="choice", value=lambda one: one.name, left=True),
        Column(title="seconds", key="seconds", value=lambda one: one.seconds, text=lambda one: f"{one.seconds:.3g}"),
        Column(title="true error", key="true_error", value=lambda one: one.error, text=lambda one: f"{one.error:.1e}"),
        Column(title="of", key="of", value=lambda one: "/".join(one.reading or ("nothing",)), left=True),
        Column(title="by", key="by", value=lambda one: "you" if one.by_user else "[MK14]", left=True),
    )
    return Table(title="choices of the paper, and yours: error against time", columns=columns, rows=curves.named)


def choice_table(curves: Curves) -> Table[AccuratePrediction]:
    """Return what each tolerance chooses, and where its time goes."""
    names = list(curves.predictions[0].plan)
    columns: tuple[Column[AccuratePrediction], ...] = (
        Column(title="tolerance", text=lambda found: f"{found.tolerance:g}", left=True),
        *(Column(title=name, text=partial(_setting, name=name), left=True) for name in names),
        Column(title="most of the error", text=lambda found: max(names, key=found.budget.worst), left=True),
        Column(title="time in", text=_slowest, left=True),
    )
    return Table(title="what --tolerance chooses", columns=columns, rows=tuple(curves.predictions))


def _setting(found: AccuratePrediction, name: str) -> str:
    return NUMERICAL_SETTINGS[name].levels[found.plan[name]].label


def _slowest(found: AccuratePrediction) -> str:
    total = sum(found.stage_s.values())
    slow = sorted(found.stage_s.items(), key=lambda item: -item[1])[:2]
    return ", ".join(f"{stage} {100.0 * seconds / total:.0f} %" for stage, seconds in slow if total > 0.0)


def floor_lines(curves: Curves) -> list[str]:
    """Return what the uncertain inputs make of a tolerance, in words."""
    if not any(floor > 0.0 for floor in curves.floor.values()):
        return ["the scene's numbers are stated without uncertainty: no floor; give std of what is not certain"]
    lines = ["floor by the uncertain inputs (one standard deviation):"]
    for quantity in _SHOWN_FLOORS:
        keys = [key for key in curves.floor if key.quantity == quantity and is_mean(key)]
        if keys:
            lines.append("  " + "; ".join(f"{key.place} {quantity} {curves.floor[key]:.1e}" for key in keys[:4]))
    least = dolp_floor(curves)
    if least is not None:
        lines.append(
            f"a tolerance below {least:.1e} buys nothing for DoLP: the inputs are not known better (absolute error)"
        )
    return lines


def dolp_floor(curves: Curves) -> float | None:
    """Return the least uncertainty that the inputs leave of a region's DoLP; None where they are all exact."""
    known = [floor for key, floor in curves.floor.items() if key.quantity == "dolp_pixels" and is_mean(key)]
    return min((floor for floor in known if floor > 0.0), default=None)


def is_mean(key: Reading) -> bool:
    """Return whether a number is one that people read first."""
    return key.statistic in ("mean", "s0", "0.001")
