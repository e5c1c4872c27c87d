"""Curves of error against time as tables, CSV, JSON and a plot."""

import csv
import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from model.accuracy.evaluation.quantities import Reading
from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS
from rigctl.comparison.accuracy_curves import WHOLE_CHAIN, CurvePoint, Curves
from rigctl.reports.figures.figure_style import png, subplots
from rigctl.reports.tables.accuracy_tables import accuracy_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Told apart in black and white too.
_MARKERS = "osD^vP*X"
_HATCHES = ("", "//", "..", "xx", "\\\\")
_SHOWN_FLOORS = ("radiance", "s1n", "s2n", "dolp_pixels", "p_detection")
_COLUMNS = ("knob", "setting", "seconds", "true error", "estimated error", "error of all")


def curve_table(curves: Curves) -> Table:
    """Return every point; a star marks the front."""
    table = Table(title="error against time", title_justify="left", box=None, pad_edge=False)
    for name in (*_COLUMNS, "front"):
        table.add_column(name, justify="left" if name in ("knob", "setting", "front") else "right")
    front = set(curves.front)
    for point in curves.points:
        table.add_row(*_texts(point), "*" if point in front else "")
    return table


def curve_csv(curves: Curves) -> bytes:
    """Return every point, a row each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("knob", "setting", "seconds", "true_error", "estimated_error", "error_of_all", "on_front"))
    front = set(curves.front)
    for point in curves.points:
        numbers = tuple(f"{number:.6g}" for number in (point.seconds, point.true, point.estimated, point.whole))
        writer.writerow((point.knob, point.setting, *numbers, int(point in front)))
    return text.getvalue().encode()


def curve_json(curves: Curves) -> dict[str, Any]:
    """Return points, choices and the floor as JSON holds them."""
    front = set(curves.front)
    return {
        "points": [
            {
                "knob": point.knob,
                "setting": point.setting,
                "seconds": point.seconds,
                "true_error": _number(point.true),
                "estimated_error": _number(point.estimated),
                "error_of_all": _number(point.whole),
                "on_front": point in front,
            }
            for point in curves.points
        ],
        "choices": [accuracy_json(found) for found in curves.predictions],
        "input_floor": {"/".join(key): floor for key, floor in curves.floor.items()},
        "reference_s": curves.reference_s,
    }


def choice_table(curves: Curves) -> Table:
    """Return what each tolerance chooses, and where its time goes."""
    table = Table(title="what --tolerance chooses", title_justify="left", box=None, pad_edge=False)
    names = list(curves.predictions[0].plan)
    for name in ("tolerance", *names, "most of the error", "time in"):
        table.add_column(name)
    for found in curves.predictions:
        labels = [NUMERICAL_SETTINGS[name].levels[found.plan[name]].label for name in names]
        total = sum(found.stage_s.values())
        slow = sorted(found.stage_s.items(), key=lambda item: -item[1])[:2]
        where = ", ".join(f"{stage} {100.0 * seconds / total:.0f} %" for stage, seconds in slow if total > 0.0)
        table.add_row(f"{found.tolerance:g}", *labels, max(names, key=found.budget.worst), where)
    return table


def floor_lines(curves: Curves) -> list[str]:
    """Return what the uncertain inputs make of a tolerance, in words."""
    if not any(floor > 0.0 for floor in curves.floor.values()):
        return ["the scene's numbers are stated without uncertainty: no floor; give std of what is not certain"]
    lines = ["floor by the uncertain inputs (one standard deviation):"]
    for quantity in _SHOWN_FLOORS:
        keys = [key for key in curves.floor if key.quantity == quantity and _is_mean(key)]
        if keys:
            lines.append("  " + "; ".join(f"{key.place} {quantity} {curves.floor[key]:.1e}" for key in keys[:4]))
    known = [floor for key, floor in curves.floor.items() if key.quantity == "dolp_pixels" and _is_mean(key)]
    least = min((floor for floor in known if floor > 0.0), default=None)
    if least is not None:
        lines.append(
            f"a tolerance below {least:.1e} buys nothing for DoLP: the inputs are not known better (absolute error)"
        )
    return lines


def curve_png(curves: Curves) -> bytes:
    """Return true and estimated error against time on logarithmic axes, the floor, and the time of each stage."""
    figure, axes = subplots(1, 3, size=(15.0, 4.8))
    for axis, kind in zip(axes[:2], ("true", "estimated"), strict=True):
        _draw_errors(axis, curves, kind)
    axes[0].plot(
        [point.seconds for point in curves.front],
        [_shown(point.whole) for point in curves.front],
        linestyle="none",
        marker="*",
        markersize=13,
        markerfacecolor="none",
        markeredgecolor="0.3",
        label="all knobs: none is faster and better",
    )
    axes[0].legend(fontsize=7)
    _draw_stages(axes[2], curves)
    return png(figure)


def _draw_errors(axis: "Axes", curves: Curves, kind: str) -> None:
    for place, knob in enumerate(dict.fromkeys(point.knob for point in curves.points)):
        points = [point for point in curves.points if point.knob == knob]
        axis.plot(
            [point.seconds for point in points],
            [_shown(getattr(point, kind)) for point in points],
            marker=_MARKERS[place % len(_MARKERS)],
            markersize=4,
            label=knob,
            color=f"C{place}",
            linewidth=2.2 if knob == WHOLE_CHAIN else 1.0,
        )
    floors = [floor for key, floor in curves.floor.items() if key.quantity == "dolp_pixels" and _is_mean(key)]
    least = min((floor for floor in floors if floor > 0.0), default=None)
    if least is not None:
        axis.axhline(least, color="0.5", linestyle="--", linewidth=1.0, label="floor of the inputs (DoLP)")
    axis.set(xscale="log", xlabel="time [s]", ylabel="largest error of any number", title=f"{kind} error")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:.0e}"[0] in "25" else "")
    # A scene of stated radiances has no error that a logarithm could show.
    if any(np.any(np.asarray(line.get_ydata(), dtype=np.float64) > 0.0) for line in axis.lines):
        axis.set_yscale("log")
    axis.grid(visible=True, which="major", alpha=0.3)


def _draw_stages(axis: "Axes", curves: Curves) -> None:
    """Bars of the whole chain's time, a tolerance each, by stage."""
    stages = list(dict.fromkeys(stage for found in curves.predictions for stage in found.stage_s))
    low = np.zeros(len(curves.predictions))
    for place, stage in enumerate(stages):
        seconds = np.array([found.stage_s[stage] for found in curves.predictions])
        axis.bar(range(low.size), seconds, bottom=low, label=stage, color=f"C{place}", hatch=_HATCHES[place])
        low += seconds
    axis.set_xticks(range(low.size), [f"{found.tolerance:g}" for found in curves.predictions])
    axis.set(xlabel="tolerance", ylabel="time [s]", title="where the time goes")
    axis.legend(fontsize=7)


def _is_mean(key: Reading) -> bool:
    return key.statistic in ("mean", "s0", "0.001")


def _texts(point: CurvePoint) -> tuple[str, ...]:
    return (
        point.knob,
        point.setting,
        f"{point.seconds:.3g}",
        _digits(point.true),
        _digits(point.estimated),
        _digits(point.whole),
    )


def _digits(error: float) -> str:
    return "-" if math.isnan(error) else f"{error:.1e}"


def _shown(error: float) -> float:
    return error if error > 0.0 and math.isfinite(error) else math.nan


def _number(error: float) -> float | None:
    return error if math.isfinite(error) else None
