"""Errors of sessions beside their time, as tables, as CSV and as JSON."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

from model.acquisition import DolpBudget, Reached, Session, degrees_text
from rigctl.console.json_text import Json
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff, CurvePoint
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.data_files import csv_rows

SCHEMA_VERSION = 1
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
_Way = dict[int, CurvePoint]
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


def curve_table(found: AcquisitionTradeoff, *, wide: bool = True) -> Table[_Way]:
    """Return for each way, at its best exposure and settling, the total error of DoLP after so many cycles."""
    last, of_a_way = _SHOWN_CYCLES[-1], _OF_A_WAY if wide else _BRIEFLY
    columns: list[Column[_Way]] = [
        *(column.of(lambda after: after[1].session) for column in _SESSION_COLUMNS if column.key in of_a_way),
        Column(title="s a cycle", text=lambda after: f"{after[1].session.duration_s:.3g}"),
        *(Column(title=f"n = {cycles}", text=partial(_total_after, cycles=cycles)) for cycles in _SHOWN_CYCLES),
    ]
    if wide:
        columns.append(
            Column(title=f"of it drift, n = {last}", text=lambda after: _shown(after[last].worst.drift_error))
        )
    if found.request.pair is not None:
        cycles = _SHOWN_CYCLES[1]
        columns.append(Column(title=f"P_D, n = {cycles}", text=lambda after: _probability(after[cycles].p_detection)))
    rows = tuple({point.session.cycles: point for point in points} for points in _ways(found.points))
    return Table(title="total error of DoLP after n cycles", columns=tuple(columns), rows=rows)


def _total_after(after: _Way, cycles: int) -> str:
    return _shown(after[cycles].worst.total)


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
    return "-" if row[1].session is None else _shown(max(budget.total for budget in budgets))


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


@dataclass(frozen=True, kw_only=True)
class _RegionPoint:
    point: CurvePoint
    region: str

    @property
    def budget(self) -> DolpBudget:
        return self.point.budgets[self.region]


def tradeoff_csv(found: AcquisitionTradeoff) -> bytes:
    """Return every point of every curve as CSV, a row a region; empty where a number does not exist."""
    columns: tuple[Column[_RegionPoint], ...] = (
        *(column.of(lambda row: row.point.session) for column in _SESSION_COLUMNS),
        Column(key="region"),
        Column(key="dolp", value=lambda row: row.budget.dolp),
        *(Column(key=error, value=partial(_error, error=error)) for error in _ERRORS),
        Column(key="p_detection", value=lambda row: row.point.p_detection),
    )
    rows = tuple(_RegionPoint(point=point, region=name) for point in found.points for name in point.budgets)
    return csv_rows(Table(columns=columns, rows=rows))


def _error(row: _RegionPoint, error: str) -> float:
    found: float = getattr(row.budget, error)
    return found


def tradeoff_json(found: AcquisitionTradeoff) -> dict[str, Json]:
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


def _session_json(session: Session) -> dict[str, Json]:
    return {
        "angles_deg": [float(math.degrees(angle)) for angle in session.angles_rad],
        "order": session.pattern,
        "exposure_ms": session.exposure_s * 1000,
        "settle_ms": session.settle_s * 1000,
        "cycles": session.cycles,
        "frames": session.frames,
        "duration_s": session.duration_s,
    }


def _reached_json(way: Session, reached: Reached) -> dict[str, Json]:
    named = {"angles_deg": [float(math.degrees(angle)) for angle in way.angles_rad], "order": way.pattern}
    if reached.session is None:
        return named | {"why_not": reached.why_not}
    return _session_json(reached.session) | _results_json(reached.budgets, reached.p_detection)


def _results_json(budgets: dict[str, DolpBudget], p_detection: float | None) -> dict[str, Json]:
    return {"errors": {name: _errors_json(budget) for name, budget in budgets.items()}, "p_detection": p_detection}


def _errors_json(budget: DolpBudget) -> dict[str, float | None]:
    return {name: _or_none(getattr(budget, name)) for name in ("dolp", *_ERRORS)}


def _duration_s(reached: Reached) -> float:
    return math.inf if reached.session is None else reached.session.duration_s


def _shown(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2g}"


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
