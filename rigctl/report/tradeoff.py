"""Accuracy against time, for people and programs: what a tolerance costs, and what a session gives for it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from operator import attrgetter
from string import ascii_lowercase
from typing import TYPE_CHECKING

import numpy as np

from model.accuracy.plan import NUMERICAL_SETTINGS, STATISTICS
from model.acquisition import Reached, Session, degrees_text
from rigctl.base.numbers import size
from rigctl.prediction.sessions import SessionPoint
from rigctl.prediction.tradeoff import WHOLE_CHAIN, estimates_share, faster_and_better
from rigctl.report.document import Column, Table, text_columns
from rigctl.report.drawing import COLOURS, few_log_labels, legend_below, legend_beside, placed_axes, png, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.accuracy.chain import Reading
    from model.accuracy.predict import Predicted, Predictions
    from model.acquisition import DolpBudget
    from rigctl.console import Json
    from rigctl.prediction.sessions import AcquisitionTradeoff
    from rigctl.prediction.tradeoff import CurvePoint, Curves, NamedChoice


_PERCENT = 100.0
_MOST_LISTED = 6
_SHOWN_FLOORS = ("radiance", "s1n", "s2n", "dolp_pixels", "p_detection")


def accuracy_table(found: Predicted) -> Table[tuple[str, ...]]:
    """Return each numerical setting with its level and its largest error."""
    levels = {name: one.levels[found.plan[name]].label for name, one in NUMERICAL_SETTINGS.items()}
    levels |= dict.fromkeys(STATISTICS, "as the tolerance asks")
    rows = [(name, level, size(found.budget.worst(name))) for name, level in levels.items()]
    columns = text_columns("setting", "level", "largest error", left=(0, 1))
    return Table(title=f"numerical errors (± above), tolerance {found.tolerance:g}", columns=columns, rows=tuple(rows))


def accuracy_lines(found: Predicted) -> list[str]:
    """Return the sum of the errors, the time of each stage, and the numbers without a promise, with the reasons."""
    promised = {key: error for key, error in found.errors.items() if key not in found.not_guaranteed}
    lines = []
    if promised:
        worst = max(promised, key=lambda key: promised[key])
        kind = (
            "numbers, of which errors are estimated and none is promised,"
            if found.estimated_only
            else "promised numbers"
        )
        lines.append(
            f"all {len(promised)} {kind} keep {found.tolerance:g}; the largest estimated error is "
            f"{promised[worst]:.1e} ({', '.join(worst)})"
        )
    total = sum(found.stage_s.values())
    parts = ", ".join(f"{stage} {_share(seconds, total)}" for stage, seconds in found.stage_s.items())
    lines.append(f"{total:.2g} s in {found.rounds} rounds: {parts}")
    return lines + _not_promised([f"{', '.join(key)}: {reason}" for key, reason in found.not_guaranteed.items()])


def _not_promised(missed: Sequence[str]) -> list[str]:
    more = [f"not promised: {len(missed) - _MOST_LISTED} more; --json lists all"]
    return [f"not promised: {line}" for line in missed[:_MOST_LISTED]] + more * (len(missed) > _MOST_LISTED)


def accuracy_json(found: Predicted) -> dict[str, Json]:
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


def series_lines(found: Predictions) -> list[str]:
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
    return lines + _not_promised(missed)


def series_json(found: Predictions) -> dict[str, Json]:
    """Return the same as JSON holds it, a list entry a case."""
    return {
        "tolerance": found.tolerance,
        "judged": [case.is_judged for case in found.cases],
        "largest_error": [_number(_largest(case)) for case in found.cases],
        "not_promised": [{"/".join(key): why for key, why in case.not_guaranteed.items()} for case in found.cases],
        "left_out": [sorted(case.left_out) for case in found.cases],
        "spot_checks": found.spot_checks,
        "spot_checks_held": found.spot_checks_held,
        "share_of_estimates": found.share_of_estimates,
        "stage_s": dict(found.stage_s),
        **({"estimated_only": True} if found.estimated_only else {}),
    }


def _left_out(found: Predictions) -> Iterable[str]:
    """Yield the effects that cases leave out, and of how many."""
    several = Counter(effect for case in found.cases for effect in case.left_out)
    for effect, times in several.items():
        most = max(case.spent for case in found.cases if effect in case.left_out)
        yield f"{effect}, in {times} of {len(found.cases)} cases; all that is left out changes {most:.1e} at the most"


def _largest(case: Predicted) -> float:
    return max((error for key, error in case.errors.items() if key not in case.not_guaranteed), default=0.0)


def _share(seconds: float, total: float) -> str:
    return f"{_PERCENT * seconds / total:.0f} %" if total > 0.0 else "0 %"


def _number(error: float) -> float | None:
    return error if error < float("inf") else None


def curve_table(curves: Curves) -> Table[CurvePoint]:
    """Return every point; a star marks the front."""
    front = set(curves.front)

    def error(title: str, key: str, name: str) -> Column[CurvePoint]:
        value: Callable[[CurvePoint], float] = attrgetter(name)
        return Column(
            title=title,
            key=key,
            value=value,
            text=lambda point: "-" if math.isnan(value(point)) else f"{value(point):.1e}",
            csv=lambda point: f"{value(point):.6g}",
        )

    # CSV has six figures: times are measured, errors estimated.
    columns: tuple[Column[CurvePoint], ...] = (
        Column(title="knob", key="knob", value=lambda point: point.varied, left=True),
        Column(title="setting", key="setting", value=lambda point: point.level, left=True),
        Column(
            title="seconds",
            key="seconds",
            text=lambda point: f"{point.seconds:.3g}",
            csv=lambda point: f"{point.seconds:.6g}",
        ),
        error("true error", "true_error", "true"),
        error("estimated error", "estimated_error", "estimated"),
        error("error of all", "error_of_all", "whole"),
        Column(
            title="front",
            key="on_front",
            value=lambda point: point in front,
            text=lambda point: "*" if point in front else "",
            csv=lambda point: str(int(point in front)),
            left=True,
        ),
    )
    return Table(title="error against time", columns=columns, rows=curves.points)


def curve_json(curves: Curves) -> dict[str, Json]:
    """Return points, choices and the floor as JSON holds them."""
    return {
        "points": curve_table(curves).json(),
        "choices": [accuracy_json(found) for found in curves.predictions],
        "input_floor": {"/".join(key): floor for key, floor in curves.floor.items()},
        "reference_s": curves.reference_s,
        "named_points": named_table(curves).json(),
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


def choice_table(curves: Curves) -> Table[Predicted]:
    """Return what each tolerance chooses, and where its time goes."""
    names = list(curves.predictions[0].plan)
    columns: tuple[Column[Predicted], ...] = (
        Column(title="tolerance", text=lambda found: f"{found.tolerance:g}", left=True),
        *(Column(title=name, text=partial(_setting, name=name), left=True) for name in names),
        Column(title="most of the error", text=lambda found: max(names, key=found.budget.worst), left=True),
        Column(title="time in", text=_slowest, left=True),
    )
    return Table(title="what --tolerance chooses", columns=columns, rows=tuple(curves.predictions))


def _setting(found: Predicted, name: str) -> str:
    return NUMERICAL_SETTINGS[name].levels[found.plan[name]].label


def _slowest(found: Predicted) -> str:
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


ACQUISITION_SCHEMA = 1
# The second is that at which detection is shown.
_SHOWN_CYCLES = (1, 8, 64, 512)
_ERRORS = ("sigma", "drift_error", "settling_error", "total")


# Of a session; the file has all digits.
_SESSION_COLUMNS: tuple[Column[Session], ...] = (
    Column(title="angles deg", key="angles_deg", value=lambda session: degrees_text(session.angles_rad), left=True),
    Column(title="order", key="order", value=lambda session: session.pattern, left=True),
    Column(
        title="exposure ms",
        key="exposure_ms",
        value=lambda session: session.exposure_s * 1000,
        text=lambda session: f"{session.exposure_s * 1000:.4g}",
    ),
    Column(
        title="settle ms",
        key="settle_ms",
        value=lambda session: session.settle_s * 1000,
        text=lambda session: f"{session.settle_s * 1000:.4g}",
    ),
    Column(title="cycles", key="cycles"),
    Column(title="frames", key="frames"),
    Column(title="time s", key="duration_s", text=lambda session: f"{session.duration_s:.4g}"),
)
_OF_A_WAY = ("angles_deg", "order", "exposure_ms", "settle_ms")
_BRIEFLY = ("angles_deg", "order")
_Way = dict[int, SessionPoint]
_Reached = tuple[Session, Reached]


def assumptions(found: AcquisitionTradeoff) -> Iterable[str]:
    """Return in words what the numbers rest on."""
    request, disturbances = found.request, found.request.disturbances
    pixels = "a pixel" if request.pixels == 1 else f"the mean of {request.pixels} pixels"
    yield (
        f"DoLP of {pixels} from the mean of all cycles, of {', '.join(found.regions)}"
        f"{'' if len(found.regions) == 1 else ' (the worst is shown)'}; {request.overhead_s * 1000:.0f} ms a frame to "
        f"turn and store; light that drifts by {disturbances.drift_per_s * 6000:.3g} % a minute; polarizer settles in "
        f"{disturbances.settling_time_s * 1000:.3g} ms"
    )
    yield "texture and fixed pattern are the same in all cycles: no number of frames averages them out"


def ways_table(found: AcquisitionTradeoff, *, wide: bool = True) -> Table[_Way]:
    """Return for each way, at its best exposure and settling, the total error of DoLP after so many cycles."""
    last, of_a_way = _SHOWN_CYCLES[-1], _OF_A_WAY if wide else _BRIEFLY
    columns: list[Column[_Way]] = [
        *(column.of(lambda after: after[1].session) for column in _SESSION_COLUMNS if column.key in of_a_way),
        Column(title="s a cycle", text=lambda after: f"{after[1].session.duration_s:.3g}"),
        *(Column(title=f"n = {cycles}", text=partial(_total_after, cycles=cycles)) for cycles in _SHOWN_CYCLES),
    ]
    if wide:
        columns.append(
            Column(title=f"of it drift, n = {last}", text=lambda after: _error_text(after[last].worst.drift_error))
        )
    if found.request.pair is not None:
        cycles = _SHOWN_CYCLES[1]
        columns.append(Column(title=f"P_D, n = {cycles}", text=lambda after: _probability(after[cycles].p_detection)))
    rows = tuple({point.session.cycles: point for point in points} for points in _by_way(found.points))
    return Table(title="total error of DoLP after n cycles", columns=tuple(columns), rows=rows)


def _total_after(after: _Way, cycles: int) -> str:
    return _error_text(after[cycles].worst.total)


def reached_table(found: AcquisitionTradeoff, *, wide: bool = True) -> Table[_Reached]:
    """Return the shortest session of each way that reaches what is wanted."""
    columns: list[Column[_Reached]] = [
        Column(title="angles deg", text=lambda row: degrees_text(row[0].angles_rad), left=True),
        Column(title="order", text=lambda row: row[0].pattern, left=True),
        *(
            Column(title=column.title, text=partial(_of_session, column=column))
            for column in _SESSION_COLUMNS
            if column.key not in (_BRIEFLY if wide else _OF_A_WAY)
        ),
        Column(title="total", text=_total),
    ]
    if found.request.pair is not None:
        columns.append(Column(title="P_D", text=lambda row: _probability(row[1].p_detection)))
    in_time = tuple(sorted(found.reached, key=lambda pair: _duration_s(pair[1])))
    return Table(title=_wanted_text(found), columns=tuple(columns), rows=in_time)


def _of_session(row: _Reached, column: Column[Session]) -> str:
    return "-" if row[1].session is None else column.text_of(row[1].session)


def _total(row: _Reached) -> str:
    budgets = row[1].budgets.values()
    return "-" if row[1].session is None else _error_text(max(budget.total for budget in budgets))


def _probability(found: float | None) -> str:
    return "" if found is None else f"{found:.4f}"


def reasons(found: AcquisitionTradeoff) -> Iterable[str]:
    """Return why some ways do not reach what is wanted."""
    for way, reached in found.reached:
        if reached.session is None:
            yield f"{degrees_text(way.angles_rad)}, {way.pattern}: {reached.why_not}"


def proposal(found: AcquisitionTradeoff) -> str | None:
    """Return the shortest session as lines for a session file; None where nothing is wanted or nothing reaches it."""
    session = None if found.best is None else found.best.session
    if session is None:
        return None
    angles = ", ".join(degrees_text([angle]) for angle in session.angles_rad)
    settle = f", each {session.settle_s * 1000:.3g} ms after the stage stands" if session.settle_s > 0.0 else ""
    return (
        f"shortest: {session.frames} frames in {session.duration_s:.1f} s{settle}. In a session file:\n"
        f'[[take]]\nkind = "scene"\nexposure_ms = {session.exposure_s * 1000:.4g}\nangles_deg = [{angles}]\n'
        f'order = "{session.pattern}"\ncycles = {session.cycles}'
    )


def points_table(found: AcquisitionTradeoff) -> Table[tuple[SessionPoint, str]]:
    """Return every point of every curve for programs, a row a region."""

    def of_region(key: str) -> Column[tuple[SessionPoint, str]]:
        return Column(key=key, value=lambda row: float(getattr(row[0].budgets[row[1]], key)))

    columns: tuple[Column[tuple[SessionPoint, str]], ...] = (
        *(column.of(lambda row: row[0].session) for column in _SESSION_COLUMNS),
        Column(key="region", value=lambda row: row[1]),
        *map(of_region, ("dolp", *_ERRORS)),
        Column(key="p_detection", value=lambda row: row[0].p_detection),
    )
    rows = tuple((point, name) for point in found.points for name in point.budgets)
    return Table(columns=columns, rows=rows)


def tradeoff_json(found: AcquisitionTradeoff) -> dict[str, Json]:
    """Return all of it as JSON holds it; null where a number does not exist."""
    return {
        "schema_version": ACQUISITION_SCHEMA,
        "scene": found.scene,
        "regions": list(found.regions),
        "pair": None if found.request.pair is None else list(found.request.pair),
        "assumed": list(assumptions(found)),
        "points": [
            _session_json(point.session) | _results_json(point.budgets, point.p_detection) for point in found.points
        ],
        "reached": [_reached_json(way, reached) for way, reached in found.reached],
        "shortest": None if found.best is None or found.best.session is None else _session_json(found.best.session),
        "remarks": list(found.remarks),
    }


def _wanted_text(found: AcquisitionTradeoff) -> str:
    wanted = found.request.wanted
    parts = [] if wanted.dolp_total is None else [f"error of DoLP at most {wanted.dolp_total:g}"]
    if wanted.p_detection is not None and found.request.pair is not None:
        target, background = found.request.pair
        parts.append(
            f"P_D of {target} on {background} at least {wanted.p_detection:g} at P_FA {wanted.p_false_alarm:g}"
        )
    return f"shortest session of each way with {' and '.join(parts)}"


def _by_way(points: Iterable[SessionPoint]) -> Iterable[list[SessionPoint]]:
    """Return the points of each angle set and order together."""
    ways: dict[tuple[tuple[float, ...], str], list[SessionPoint]] = {}
    for point in points:
        ways.setdefault((point.session.angles_rad, point.session.pattern), []).append(point)
    return ways.values()


def _session_json(session: Session) -> dict[str, Json]:
    (numbers,) = Table(columns=_SESSION_COLUMNS, rows=(session,)).json()
    return {**numbers, "angles_deg": [float(math.degrees(angle)) for angle in session.angles_rad]}


def _reached_json(way: Session, reached: Reached) -> dict[str, Json]:
    if reached.session is None:
        angles_deg = [float(math.degrees(angle)) for angle in way.angles_rad]
        return {"angles_deg": angles_deg, "order": way.pattern, "why_not": reached.why_not}
    return _session_json(reached.session) | _results_json(reached.budgets, reached.p_detection)


def _results_json(budgets: dict[str, DolpBudget], p_detection: float | None) -> dict[str, Json]:
    errors: dict[str, Json] = {
        name: {key: None if math.isnan(value := getattr(budget, key)) else value for key in ("dolp", *_ERRORS)}
        for name, budget in budgets.items()
    }
    return {"errors": errors, "p_detection": p_detection}


def _duration_s(reached: Reached) -> float:
    return math.inf if reached.session is None else reached.session.duration_s


def _error_text(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2g}"


# Told apart in black and white too.
_MARKERS = "osD^vP*X"
_HATCHES = ("", "//", "..", "xx", "\\\\")
_COLOURS = [str(style["color"]) for style in COLOURS]
_LINES = {"cycles": "-", "palindrome": "--", "grouped": ":"}
_BETTER = "the lower and the further left, the better"
# Times span this factor at the least, so that some of them are labelled.
_WIDTH = 6.0


def curve_png(curves: Curves, *, worth: Predicted) -> bytes:
    """Return error against time of tolerances and of fixed choices, with the tolerance that is worth having."""
    figure, axes = placed_axes(1, 1, size=(10.5, 5.6), margins=(0.9, 3.2, 0.6, 0.5))
    chain = [point for point in curves.points if point.varied == WHOLE_CHAIN]
    _draw_chain(axes[0], chain)
    _draw_named(axes[0], curves)
    _draw_floor(axes[0], curves)
    best = next(point for point in chain if point.level == f"tolerance {worth.tolerance:g}")
    if math.isfinite(_shown(best.true)):
        axes[0].plot(best.seconds, best.true, "o", ms=18, mfc="none", mec=_COLOURS[1], mew=2.0, label="worth having")
    _finish_errors_of(axes[0], f"what accuracy costs: {_BETTER}")
    _say_if_empty(axes[0])
    legend_beside(axes[0])
    return png(figure)


def settings_png(curves: Curves) -> bytes:
    """Return error against time of each setting by itself."""
    figure, axes = placed_axes(1, 1, size=(8.5, 6.8), margins=(0.9, 0.2, 1.8, 0.5))
    _draw_settings(axes[0], curves)
    _finish_errors_of(axes[0], f"each setting alone: {_BETTER}")
    _say_if_empty(axes[0])
    legend_below(axes[0], columns=2)
    return png(figure)


def stages_png(curves: Curves) -> bytes:
    """Return where the time of each tolerance goes."""
    figure, axes = placed_axes(1, 1, size=(6.5, 6.0), margins=(0.9, 0.2, 1.8, 0.5))
    _draw_stages(axes[0], curves)
    return png(figure)


def _draw_chain(axis: Axes, chain: Sequence[CurvePoint]) -> None:
    """Draw the true errors of tolerances, and those that a prediction estimates for itself."""
    seconds, blue = [point.seconds for point in chain], _COLOURS[0]
    true, estimated = ([_shown(getattr(point, kind)) for point in chain] for kind in ("true", "estimated"))
    axis.plot(seconds, true, marker="o", color=blue, linewidth=2.6, label="--tolerance: true error")
    label = "--tolerance: error that it states"
    axis.plot(seconds, estimated, "o--", markerfacecolor="white", color=blue, linewidth=1.0, label=label)
    for point, error in zip(chain, estimated, strict=True):
        if math.isfinite(error):
            name = point.level.removeprefix("tolerance ")
            axis.annotate(name, (point.seconds, error), xytext=(4.0, 4.0), textcoords="offset points", fontsize=8)


def _draw_named(axis: Axes, curves: Curves) -> None:
    """Draw each fixed choice as a letter; the legend has its name, and why it may seem better than a tolerance."""
    for letter, one in zip(ascii_lowercase, curves.named, strict=False):
        label = one.name + (": no error here" if one.error == 0.0 else "")
        label += "; states no error" if faster_and_better(one, curves) else ""
        colour = _COLOURS[1] if one.by_user else "black"
        axis.plot(one.seconds, _shown(one.error), marker=f"${letter}$", ms=9, ls="", color=colour, label=label)


def _draw_floor(axis: Axes, curves: Curves) -> None:
    least = dolp_floor(curves)
    if least is not None:
        label = "DoLP is known no better: uncertain inputs"
        axis.axhline(least, color="0.5", linestyle="--", linewidth=1.0, label=label)


def _say_if_empty(axis: Axes) -> None:
    named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
    if not any(np.any(np.isfinite(np.asarray(line.get_ydata(), dtype=np.float64))) for line in named):
        axis.text(0.5, 0.5, "no error of these settings in this scene", transform=axis.transAxes, ha="center")


def _draw_settings(axis: Axes, curves: Curves) -> None:
    """Draw the true errors of each setting's levels, the others being fine, and which points are the best of all."""
    for place, name in enumerate(dict.fromkeys(point.varied for point in curves.points)):
        points = [point for point in curves.points if point.varied == name and math.isfinite(_shown(point.true))]
        if not points:
            continue
        is_chain = name == WHOLE_CHAIN
        axis.plot(
            [point.seconds for point in points],
            [point.true for point in points],
            marker=_MARKERS[place % len(_MARKERS)],
            markersize=5,
            label="--tolerance: all settings" if is_chain else name,
            color=_COLOURS[place % len(_COLOURS)],
            linewidth=2.6 if is_chain else 1.2,
        )
    best = [point for point in curves.front if math.isfinite(_shown(point.true))]
    if best:
        seconds, errors = [point.seconds for point in best], [point.true for point in best]
        label = "none is faster and better"
        axis.plot(seconds, errors, "*", markersize=14, markerfacecolor="none", markeredgecolor="0.3", label=label)


def _finish_errors_of(axis: Axes, title: str) -> None:
    axis.set(xscale="log", xlabel="processor time [s]", ylabel="largest error of any number")
    axis.set_title(title, fontsize=11)
    axis.margins(x=0.15, y=0.08)
    least, most = axis.get_xlim()
    if most < _WIDTH * least:
        middle = math.sqrt(least * most)
        axis.set_xlim(middle / math.sqrt(_WIDTH), middle * math.sqrt(_WIDTH))
    few_log_labels(axis.xaxis)
    # A scene of stated radiances has no error that a logarithm could show.
    if any(np.any(np.asarray(line.get_ydata(), dtype=np.float64) > 0.0) for line in axis.lines):
        axis.set_yscale("log")
    axis.grid(visible=True, which="major", alpha=0.3)


def _draw_stages(axis: Axes, curves: Curves) -> None:
    """Bars of the whole chain's time, a tolerance each, by stage."""
    stages = list(dict.fromkeys(stage for found in curves.predictions for stage in found.stage_s))
    low = np.zeros(len(curves.predictions))
    for place, stage in enumerate(stages):
        seconds = np.array([found.stage_s[stage] for found in curves.predictions])
        axis.bar(range(low.size), seconds, bottom=low, label=stage, color=_COLOURS[place], hatch=_HATCHES[place])
        low += seconds
    for place, found in enumerate(curves.predictions):
        axis.annotate(
            f"estimates\n{100.0 * estimates_share(found):.0f} %",
            (place, low[place]),
            ha="center",
            va="bottom",
            fontsize=8,
        )
    axis.margins(y=0.12)
    axis.set_xticks(range(low.size), [f"{found.tolerance:g}" for found in curves.predictions])
    axis.set(xlabel="--tolerance", ylabel="processor time [s]")
    axis.set_title("where the time goes", fontsize=11)
    legend_below(axis, columns=2)


def _shown(error: float) -> float:
    return error if error > 0.0 and math.isfinite(error) else math.nan


def tradeoff_picture(found: AcquisitionTradeoff) -> bytes:
    """Return the total error over the duration of each way, with what is wanted; and P_D where a pair was named."""
    panels = 1 if found.request.pair is None else 2
    figure, axes = subplots(1, panels, size=(7.6 * panels, 5.4))
    for colour, (angles, ways) in enumerate(_ways(found.points).items()):
        for pattern, points in ways.items():
            style = {
                "color": _COLOURS[colour % len(_COLOURS)],
                "linestyle": _LINES[pattern],
                "marker": ".",
                "markersize": 4,
            }
            label = angles if pattern == "cycles" else None
            time_s = [point.session.duration_s for point in points]
            axes[0].loglog(time_s, [point.worst.total for point in points], label=label, **style)
            if panels == 2:
                axes[1].semilogx(time_s, [point.p_detection for point in points], **style)
    _finish_errors(axes[0], found)
    if panels == 2 and found.request.pair is not None:
        target, background = found.request.pair
        axes[1].set_ylabel(f"P_D of {target} on {background} at P_FA {found.request.wanted.p_false_alarm:g}")
        axes[1].set_xlabel("time of the session [s]")
        axes[1].set_ylim(0.0, 1.02)
        if found.request.wanted.p_detection is not None:
            axes[1].axhline(found.request.wanted.p_detection, color="0.4", linewidth=0.8)
    return png(figure)


def _finish_errors(ax: Axes, found: AcquisitionTradeoff) -> None:
    wanted = found.request.wanted.dolp_total
    if wanted is not None:
        ax.axhline(wanted, color="0.4", linewidth=0.8)
    best = None if found.best is None else found.best.session
    if best is not None and found.best is not None:
        total = max(budget.total for budget in found.best.budgets.values())
        ax.plot(best.duration_s, total, marker="*", markersize=14, color="#d55e00", linestyle="none", label="shortest")
    ax.set_xlabel("time of the session [s]")
    ax.set_ylabel("error of DoLP: noise, drift and settling")
    ax.legend(
        fontsize=8,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.12),
        ncols=2,
        title="angles [deg]; solid: cycles, dashed: back and forth,\ndotted: grouped by angle",
    )


def _ways(points: tuple[SessionPoint, ...]) -> dict[str, dict[str, list[SessionPoint]]]:
    """Points by angles and pattern, in the order in which they come."""
    ways: dict[str, dict[str, list[SessionPoint]]] = {}
    for point in points:
        if np.isfinite(point.worst.total):
            angles = degrees_text(point.session.angles_rad)
            ways.setdefault(angles, {}).setdefault(point.session.pattern, []).append(point)
    return ways
