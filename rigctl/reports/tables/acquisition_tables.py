"""What sessions give for their time, as tables for the terminal, as CSV and as JSON."""

import csv
import io
import math
from collections.abc import Iterable
from typing import Any

from rich.table import Table

from model.acquisition.frame_order import degrees_text
from model.acquisition.session_design import DolpBudget, Session
from model.acquisition.session_search import Reached
from rigctl.comparison.acquisition_tradeoff import AcquisitionTradeoff, CurvePoint

SCHEMA_VERSION = 1
# The second is that at which detection is shown.
_SHOWN_CYCLES = (1, 8, 64, 512)
_ERRORS = ("sigma", "drift_error", "settling_error", "total")


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


def curve_table(found: AcquisitionTradeoff) -> Table:
    """Return for each way, at its best exposure and settling, the total error of DoLP after so many cycles."""
    table = Table(title="total error of DoLP after n cycles", title_justify="left", box=None, pad_edge=False)
    table.add_column("angles deg")
    table.add_column("order")
    after = [f"n = {cycles}" for cycles in _SHOWN_CYCLES]
    detected = [] if found.request.pair is None else [f"P_D, n = {_SHOWN_CYCLES[1]}"]
    last = f"of it drift, n = {_SHOWN_CYCLES[-1]}"
    for column in ("exposure ms", "settle ms", "s a cycle", *after, last, *detected):
        table.add_column(column, justify="right")
    for points in _ways(found.points):
        table.add_row(*_way_cells({point.session.cycles: point for point in points}))
    return table


def reached_table(found: AcquisitionTradeoff) -> Table:
    """Return the shortest session of each way that reaches what is wanted."""
    table = Table(title=_wanted_text(found), title_justify="left", box=None, pad_edge=False)
    columns = ("angles deg", "order", "exposure ms", "settle ms", "cycles", "frames", "time s", "total")
    for column in columns:
        table.add_column(column, justify="left" if column in ("angles deg", "order") else "right")
    if found.request.pair is not None:
        table.add_column("P_D", justify="right")
    in_time = sorted(found.reached, key=lambda pair: _duration_s(pair[1]))
    for way, reached in in_time:
        if reached.session is not None:
            table.add_row(*_reached_cells(reached.session, reached))
        else:
            table.add_row(degrees_text(way.angles_rad), way.pattern, "-", "-", "-", "-", "-", "-")
    return table


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


def tradeoff_csv(found: AcquisitionTradeoff) -> bytes:
    """Return every point of every curve as CSV, a row a region; empty where a number does not exist."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    head = ("angles_deg", "order", "exposure_ms", "settle_ms", "cycles", "frames", "duration_s", "region", "dolp")
    writer.writerow([*head, *_ERRORS, "p_detection"])
    for point in found.points:
        for name, budget in point.budgets.items():
            numbers = [_number(getattr(budget, error)) for error in _ERRORS]
            writer.writerow(
                [*_session_cells(point.session), name, repr(budget.dolp), *numbers, _number(point.p_detection)]
            )
    return text.getvalue().encode()


def tradeoff_json(found: AcquisitionTradeoff) -> dict[str, Any]:
    """Return all of it as JSON holds it; null where a number does not exist."""
    return {
        "schema_version": SCHEMA_VERSION,
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


def _ways(points: Iterable[CurvePoint]) -> Iterable[list[CurvePoint]]:
    """Return the points of each angle set and order together."""
    ways: dict[tuple[tuple[float, ...], str], list[CurvePoint]] = {}
    for point in points:
        ways.setdefault((point.session.angles_rad, point.session.pattern), []).append(point)
    return ways.values()


def _way_cells(after: dict[int, CurvePoint]) -> tuple[str, ...]:
    session = after[1].session
    detected = after[_SHOWN_CYCLES[1]].p_detection
    return (
        degrees_text(session.angles_rad),
        session.pattern,
        f"{session.exposure_s * 1000:.4g}",
        f"{session.settle_s * 1000:.4g}",
        f"{session.duration_s:.3g}",
        *(_shown(after[cycles].worst.total) for cycles in _SHOWN_CYCLES),
        _shown(after[_SHOWN_CYCLES[-1]].worst.drift_error),
        *(() if detected is None else (f"{detected:.4f}",)),
    )


def _reached_cells(session: Session, reached: Reached) -> tuple[str, ...]:
    total = max(budget.total for budget in reached.budgets.values())
    cells = (
        degrees_text(session.angles_rad),
        session.pattern,
        f"{session.exposure_s * 1000:.4g}",
        f"{session.settle_s * 1000:.4g}",
        str(session.cycles),
        str(session.frames),
        f"{session.duration_s:.4g}",
        _shown(total),
    )
    return cells if reached.p_detection is None else (*cells, f"{reached.p_detection:.4f}")


def _session_cells(session: Session) -> tuple[str, ...]:
    return (
        degrees_text(session.angles_rad),
        session.pattern,
        repr(session.exposure_s * 1000),
        repr(session.settle_s * 1000),
        str(session.cycles),
        str(session.frames),
        repr(session.duration_s),
    )


def _session_json(session: Session) -> dict[str, Any]:
    return {
        "angles_deg": [float(math.degrees(angle)) for angle in session.angles_rad],
        "order": session.pattern,
        "exposure_ms": session.exposure_s * 1000,
        "settle_ms": session.settle_s * 1000,
        "cycles": session.cycles,
        "frames": session.frames,
        "duration_s": session.duration_s,
    }


def _reached_json(way: Session, reached: Reached) -> dict[str, Any]:
    named = {"angles_deg": [float(math.degrees(angle)) for angle in way.angles_rad], "order": way.pattern}
    if reached.session is None:
        return named | {"why_not": reached.why_not}
    return _session_json(reached.session) | _results_json(reached.budgets, reached.p_detection)


def _results_json(budgets: dict[str, DolpBudget], p_detection: float | None) -> dict[str, Any]:
    return {"errors": {name: _errors_json(budget) for name, budget in budgets.items()}, "p_detection": p_detection}


def _errors_json(budget: DolpBudget) -> dict[str, float | None]:
    return {name: _or_none(getattr(budget, name)) for name in ("dolp", *_ERRORS)}


def _duration_s(reached: Reached) -> float:
    return math.inf if reached.session is None else reached.session.duration_s


def _shown(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2g}"


def _number(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else repr(value)


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
