"""Errors of DoLP over the time of a session, and what it detects, as a plot."""

import numpy as np
from matplotlib.axes import Axes

from model.acquisition.frame_order import degrees_text
from rigctl.prediction.acquisition_tradeoff import AcquisitionTradeoff, CurvePoint
from rigctl.reports.figures.figure_style import png, subplots

_LINES = {"cycles": "-", "palindrome": "--", "grouped": ":"}


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
    ax.legend(fontsize=8, title="angles [deg]; solid: cycles, dashed: back and forth,\ndotted: grouped by angle")


def _ways(points: tuple[CurvePoint, ...]) -> dict[str, dict[str, list[CurvePoint]]]:
    """Points by angles and pattern, in the order in which they come."""
    ways: dict[str, dict[str, list[CurvePoint]]] = {}
    for point in points:
        if np.isfinite(point.worst.total):
            angles = degrees_text(point.session.angles_rad)
            ways.setdefault(angles, {}).setdefault(point.session.pattern, []).append(point)
    return ways
