"""Tradeoffs as plots: error against time of the computation, and against time of the session."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from model.accuracy.predict_to_tolerance import ESTIMATES
from model.acquisition.frame_order import degrees_text
from rigctl.prediction.accuracy_curves import WHOLE_CHAIN, Curves, DigitPoint
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff, CurvePoint
from rigctl.reports.figures.figure_style import legend_below, legend_beside, png, subplots
from rigctl.reports.tables.accuracy_tables import is_mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Told apart in black and white too.
_MARKERS = "osD^vP*X"
_HATCHES = ("", "//", "..", "xx", "\\\\")
# Text that lies on lines stays readable.
_ON_LINES = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
_LINES = {"cycles": "-", "palindrome": "--", "grouped": ":"}


def curve_png(curves: Curves) -> bytes:
    """Return true and estimated error against time on logarithmic axes, the floor, and the time of each stage."""
    figure, axes = subplots(1, 3, size=(16.0, 7.0))
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
        label="no other point is faster and better",
    )
    _draw_named(axes[0], curves)
    axes[0].legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    _draw_stages(axes[2], curves)
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
            color=f"C{place}",
        )
    axis.set(
        xlabel="correct digits (2: true error 0.01, 3: 0.001)",
        ylabel="processor time of the whole prediction [s]",
        title="What you pay for a digit",
    )
    axis.set_ylim(bottom=0.0)
    axis.locator_params(axis="x", integer=True)
    axis.grid(visible=True, alpha=0.3)
    if axis.lines:
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


def _draw_named(axis: "Axes", curves: Curves) -> None:
    """Draw the paper's choices as crosses, the user's as pluses, each with its name; those without error in a line."""
    for by_user, marker, label in ((False, "X", "choices of the paper"), (True, "P", "your own choices")):
        shown = [one for one in curves.named if one.by_user is by_user and one.error > 0.0]
        if not shown:
            continue
        places = [(one.seconds, one.error) for one in shown]
        axis.plot(*zip(*places, strict=True), linestyle="none", marker=marker, color="black", markersize=6, label=label)
        for one, place in zip(shown, places, strict=True):
            _name_point(axis, one.name, place, weight="normal")
    without = [one.name for one in curves.named if not one.error > 0.0]
    if without:
        text = "\n".join(("no error here:", *without))
        axis.text(0.02, 0.02, text, transform=axis.transAxes, fontsize=7, va="bottom", bbox=_ON_LINES)


def _name_point(axis: "Axes", text: str, place: tuple[float, float], *, weight: str) -> None:
    axis.annotate(
        text, place, xytext=(6, 4), textcoords="offset points", fontsize=7, fontweight=weight, bbox=_ON_LINES, zorder=5
    )


def _draw_errors(axis: "Axes", curves: Curves, kind: str) -> None:
    for place, name in enumerate(dict.fromkeys(point.varied for point in curves.points)):
        points = [point for point in curves.points if point.varied == name]
        axis.plot(
            [point.seconds for point in points],
            [_shown(getattr(point, kind)) for point in points],
            marker=_MARKERS[place % len(_MARKERS)],
            markersize=4,
            label=name,
            color=f"C{place}",
            linewidth=2.6 if name == WHOLE_CHAIN else 0.8,
            alpha=1.0 if name == WHOLE_CHAIN else 0.6,
        )
        if name == WHOLE_CHAIN:
            _name_tolerances(axis, {point.level: (point.seconds, _shown(getattr(point, kind))) for point in points})
    floors = [floor for key, floor in curves.floor.items() if key.quantity == "dolp_pixels" and is_mean(key)]
    least = min((floor for floor in floors if floor > 0.0), default=None)
    if least is not None:
        axis.axhline(least, color="0.5", linestyle="--", linewidth=1.0, label="floor of the inputs (DoLP)")
    axis.set(xscale="log", xlabel="processor time [s]", ylabel="largest error of any number")
    axis.set_title(f"{kind} error: the lower and the further left, the better")
    axis.margins(x=0.15)
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:.0e}"[0] in "25" else "")
    # A scene of stated radiances has no error that a logarithm could show.
    if any(np.any(np.asarray(line.get_ydata(), dtype=np.float64) > 0.0) for line in axis.lines):
        axis.set_yscale("log")
    axis.grid(visible=True, which="major", alpha=0.3)


def _name_tolerances(axis: "Axes", places: Mapping[str, tuple[float, float]]) -> None:
    """Write each tolerance at its point, several that come to the same error at the last of them."""
    by_error: dict[float, list[str]] = {}
    for level, (_, error) in places.items():
        by_error.setdefault(float(f"{error:.2g}"), []).append(level)
    for k, levels in enumerate(by_error.values()):
        if math.isfinite(places[levels[-1]][1]):
            text = ", ".join(level.removeprefix("tolerance ") for level in levels)
            _name_point(axis, f"{'' if k else '--tolerance '}{text}", places[levels[-1]], weight="bold")


def _draw_stages(axis: "Axes", curves: Curves) -> None:
    """Bars of the whole chain's time, a tolerance each, by stage."""
    stages = list(dict.fromkeys(stage for found in curves.predictions for stage in found.stage_s))
    low = np.zeros(len(curves.predictions))
    for place, stage in enumerate(stages):
        seconds = np.array([found.stage_s[stage] for found in curves.predictions])
        axis.bar(range(low.size), seconds, bottom=low, label=stage, color=f"C{place}", hatch=_HATCHES[place])
        low += seconds
    for place, found in enumerate(curves.predictions):
        share = found.stage_s[ESTIMATES] / low[place] if low[place] > 0.0 else 0.0
        axis.annotate(f"estimates\n{100.0 * share:.0f} %", (place, low[place]), ha="center", va="bottom", fontsize=8)
    axis.margins(y=0.12)
    axis.set_xticks(range(low.size), [f"{found.tolerance:g}" for found in curves.predictions])
    axis.set(xlabel="tolerance", ylabel="processor time [s]", title="where the time goes")
    legend_below(axis)


def _shown(error: float) -> float:
    return error if error > 0.0 and math.isfinite(error) else math.nan


def tradeoff_picture(found: AcquisitionTradeoff) -> bytes:
    """Return the total error over the duration of each way, with what is wanted; and P_D where a pair was named."""
    panels = 1 if found.request.pair is None else 2
    figure, axes = subplots(1, panels, size=(7.6 * panels, 5.4))
    for colour, (angles, ways) in enumerate(_ways(found.points).items()):
        for pattern, points in ways.items():
            style = {"color": f"C{colour}", "linestyle": _LINES[pattern], "marker": ".", "markersize": 4}
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
