"""Tradeoffs as plots: error against time of the computation, and against time of the session."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from model.accuracy.predict import AccuratePrediction
from model.acquisition import degrees_text
from rigctl.prediction.accuracy_curves import WHOLE_CHAIN, Curves, DigitPoint, estimates_share, faster_and_better
from rigctl.prediction.accuracy_curves import CurvePoint as CostPoint
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff, CurvePoint
from rigctl.prediction.paper_choices import NamedChoice
from rigctl.reports.figures.figure_style import (
    COLOURS,
    few_log_labels,
    legend_below,
    legend_beside,
    placed_axes,
    png,
    subplots,
)
from rigctl.reports.figures.point_names import PointName, name_points
from rigctl.reports.tables.accuracy_tables import is_mean

# Told apart in black and white too.
_MARKERS = "osD^vP*X"
_HATCHES = ("", "//", "..", "xx", "\\\\")
_COLOURS = [str(style["color"]) for style in COLOURS]
_LINES = {"cycles": "-", "palindrome": "--", "grouped": ":"}
_BETTER = "the lower and the further left, the better"
# Times span this factor at the least, so that some of them are labelled.
_WIDTH = 6.0
# Tolerances whose times lie nearer than this share of the largest are named together.
_APART = 0.04


def curve_png(curves: Curves, *, worth: AccuratePrediction) -> bytes:
    """Return error against time of tolerances and of the paper's choices, with the tolerance that is worth having."""
    figure, axes = placed_axes(1, 1, size=(8.5, 6.8), margins=(0.9, 0.2, 1.6, 0.5))
    chain = [point for point in curves.points if point.varied == WHOLE_CHAIN]
    _draw_chain(axes[0], chain)
    _draw_named(axes[0], curves.named)
    _draw_floor(axes[0], curves)
    best = next(point for point in chain if point.level == f"tolerance {worth.tolerance:g}")
    if math.isfinite(_shown(best.true)):
        axes[0].plot(best.seconds, best.true, "o", ms=18, mfc="none", mec=_COLOURS[1], mew=2.0, label="worth having")
    _finish_errors_of(axes[0], f"what accuracy costs: {_BETTER}")
    name_points(figure, axes[0], [*_tolerance_names(chain), *_choice_names(curves)])
    _say_without_error(figure, curves.named, chain)
    _say_if_empty(axes[0])
    legend_below(axes[0], columns=2)
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


def digits_png(curves: Curves) -> bytes:
    """Return the time that each correct digit takes, a line for each kind of number: 2 digits are an error of 0.01."""
    figure, axes = subplots(1, 1, size=(8.0, 5.0))
    axis = axes[0]
    for place, quantity in enumerate(dict.fromkeys(point.quantity for point in curves.digits)):
        points = _paying([point for point in curves.digits if point.quantity == quantity and point.error > 0.0])
        if not points:
            continue
        axis.plot(
            [-math.log10(point.error) for point in points],
            [point.seconds for point in points],
            marker=_MARKERS[place % len(_MARKERS)],
            label=f"{quantity}{_price(points)}",
            color=_COLOURS[place],
        )
    axis.set(
        xlabel="correct digits (2: true error 0.01, 3: 0.001)",
        ylabel="processor time of the whole prediction [s]",
        title="What you pay for a digit (grey: --tolerance)",
    )
    axis.set_ylim(0.0, 1.1 * max(point.seconds for point in curves.digits))
    least, most = axis.get_xlim()
    axis.set_xticks(range(math.floor(least), math.ceil(most) + 1))
    _name_times(axis, curves)
    axis.grid(visible=True, alpha=0.3)
    _say_if_empty(axis)
    legend_beside(axis)
    return png(figure)


def _paying(points: Sequence[DigitPoint]) -> list[DigitPoint]:
    """Return the points that are had for no less time, from few digits to many."""
    found: list[DigitPoint] = []
    for point in sorted(points, key=lambda one: (one.seconds, one.error)):
        if not found or point.error < found[-1].error:
            found.append(point)
    return found


def _price(points: Sequence[DigitPoint]) -> str:
    """Say by what the time grows with a digit, from the fewest to the most; nothing where one digit is not spanned."""
    digits = math.log10(points[0].error / points[-1].error)
    if digits < 1.0:
        return ""
    return f":\none more digit takes {(points[-1].seconds / points[0].seconds) ** (1.0 / digits):.2g} x the time"


def _name_times(axis: Axes, curves: Curves) -> None:
    """Write each tolerance at its time, those at one time together."""
    times = sorted((sum(found.stage_s.values()), found.tolerance) for found in curves.predictions)
    groups: list[list[tuple[float, float]]] = []
    for time in times:
        if groups and time[0] - groups[-1][-1][0] < _APART * times[-1][0]:
            groups[-1].append(time)
        else:
            groups.append([time])
    for group in groups:
        text = ", ".join(f"{tolerance:g}" for tolerance in sorted((one for _, one in group), reverse=True))
        axis.axhline(group[-1][0], color="0.8", linewidth=0.8, zorder=0)
        axis.annotate(
            text,
            (0.01, group[-1][0]),
            xycoords=("axes fraction", "data"),
            xytext=(0.0, 2.0),
            textcoords="offset points",
            fontsize=8,
        )


def _draw_chain(axis: Axes, chain: Sequence[CostPoint]) -> None:
    """Draw the true errors of tolerances, and those that a prediction estimates for itself."""
    seconds, blue = [point.seconds for point in chain], _COLOURS[0]
    true, estimated = ([_shown(getattr(point, kind)) for point in chain] for kind in ("true", "estimated"))
    axis.plot(seconds, true, marker="o", color=blue, linewidth=2.6, label="--tolerance: true error")
    label = "--tolerance: error that it states"
    axis.plot(seconds, estimated, "o--", markerfacecolor="white", color=blue, linewidth=1.0, label=label)


def _draw_named(axis: Axes, named: Sequence[NamedChoice]) -> None:
    """Draw the paper's choices as crosses, the user's as pluses; those without error in a line."""
    for by_user, marker, label in ((False, "X", "choices of the paper"), (True, "P", "your own choices")):
        places = [(one.seconds, one.error) for one in named if one.by_user is by_user and one.error > 0.0]
        if places:
            seconds, errors = zip(*places, strict=True)
            axis.plot(seconds, errors, linestyle="none", marker=marker, color="black", markersize=7, label=label)


def _say_without_error(figure: Figure, named: Sequence[NamedChoice], chain: Sequence[CostPoint]) -> None:
    """Write below all what has no error that a logarithm could show."""
    without = [*(one.level for one in chain if one.true == 0.0), *(one.name for one in named if not one.error > 0.0)]
    if without:
        figure.text(0.02, 0.02, f"no error here: {', '.join(without)}", fontsize=8)


def _say_if_empty(axis: Axes) -> None:
    named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
    if not any(np.any(np.isfinite(np.asarray(line.get_ydata(), dtype=np.float64))) for line in named):
        axis.text(0.5, 0.5, "no error of these settings in this scene", transform=axis.transAxes, ha="center")


def _draw_floor(axis: Axes, curves: Curves) -> None:
    floors = [floor for key, floor in curves.floor.items() if key.quantity == "dolp_pixels" and is_mean(key)]
    least = min((floor for floor in floors if floor > 0.0), default=None)
    if least is not None:
        label = "DoLP is known no better: uncertain inputs"
        axis.axhline(least, color="0.5", linestyle="--", linewidth=1.0, label=label)


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


def _tolerance_names(chain: Sequence[CostPoint]) -> list[PointName]:
    """Return each tolerance at its point, several that come to the same error at the last of them."""
    by_error: dict[float, list[CostPoint]] = {}
    for point in chain:
        if math.isfinite(_shown(point.true)):
            by_error.setdefault(float(f"{point.true:.2g}"), []).append(point)
    names = []
    for points in by_error.values():
        text = ", ".join(point.level.removeprefix("tolerance ") for point in points)
        names.append(PointName(text=text, x=points[-1].seconds, y=points[-1].true, is_bold=True))
    return [replace(one, text=f"{'' if k else '--tolerance '}{one.text}") for k, one in enumerate(names)]


def _choice_names(curves: Curves) -> list[PointName]:
    """Return each choice at its point, with the reason where it seems better than a tolerance."""
    return [
        PointName(
            text=f"{one.name}\n(states no error)" if faster_and_better(one, curves) else one.name,
            x=one.seconds,
            y=one.error,
        )
        for one in curves.named
        if one.error > 0.0
    ]


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


def _ways(points: tuple[CurvePoint, ...]) -> dict[str, dict[str, list[CurvePoint]]]:
    """Points by angles and pattern, in the order in which they come."""
    ways: dict[str, dict[str, list[CurvePoint]]] = {}
    for point in points:
        if np.isfinite(point.worst.total):
            angles = degrees_text(point.session.angles_rad)
            ways.setdefault(angles, {}).setdefault(point.session.pattern, []).append(point)
    return ways
