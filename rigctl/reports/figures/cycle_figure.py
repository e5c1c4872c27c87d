"""Drift, polarization and sum rule of a run, cycle by cycle, drawn and in words."""

import numpy as np
from matplotlib.axes import Axes

from rigctl.live.cycle_history import CycleHistory, CycleLook
from rigctl.live.cycle_numbers import Estimate
from rigctl.reports.figures.figure_style import png, subplots

_S_PER_MIN = 60.0


def cycle_figure(history: CycleHistory) -> bytes:
    """Return a PNG: light of the reference region, DoLP of each region, and the sum rule, over the cycles."""
    figure, axes = subplots(3, 1, size=(8.0, 7.0))
    looks = [look for look in history.looks if history.reference in look.regions]
    _draw_light(axes[0], looks, history)
    for name in dict.fromkeys(name for look in history.looks for name in look.regions):
        _draw(axes[1], history, {look: look.regions[name].dolp for look in history.looks if name in look.regions}, name)
    axes[1].set_ylabel("DoLP")
    axes[1].legend(fontsize=7)
    _draw(axes[2], history, {look: look.sum_rule for look in history.looks if look.sum_rule is not None}, "picture")
    axes[2].set_ylabel("(I0 + I90) / (I45 + I135)")
    axes[2].ticklabel_format(useOffset=False)
    axes[2].set_xlabel("time since the first cycle [min]")
    return png(figure)


def drift_line(history: CycleHistory) -> str:
    """Return in words how the light drifted from cycle to cycle."""
    drifts = [look.drift for look in history.looks if look.drift is not None]
    if not drifts:
        return "Drift within rounds: not known, since no angle was taken twice in a round."
    per_min = np.array([drift.per_min for drift in drifts])
    change = np.array([drift.change for drift in drifts])
    sigmas = [drift.sigma for drift in drifts if drift.sigma is not None]
    noise = f"; noise alone makes {100 * float(np.sqrt(np.mean(np.square(sigmas)))):.2g} %" if sigmas else ""
    return (
        f"Drift of {history.reference}, within rounds: median {100 * float(np.median(per_min)):+.2g} % a minute; from "
        f"one look to the next {100 * float(np.sqrt(np.mean(change**2))):.2g} % rms, "
        f"{100 * float(np.max(np.abs(change))):.2g} % at most{noise}."
    )


def _draw_light(ax: Axes, looks: list[CycleLook], history: CycleHistory) -> None:
    light = np.array([look.regions[history.reference].light_dn_per_s for look in looks])
    if light.size:
        ax.plot([_minutes(look, history) for look in looks], 100.0 * (light / light[0] - 1.0), ".-", markersize=4)
    ax.set_ylabel(f"light of {history.reference},\nchange since the first [%]")


def _draw(ax: Axes, history: CycleHistory, found: dict[CycleLook, Estimate], label: str) -> None:
    minutes = [_minutes(look, history) for look in found]
    values = [estimate.value for estimate in found.values()]
    sigmas = [0.0 if estimate.sigma is None else estimate.sigma for estimate in found.values()]
    ax.errorbar(minutes, values, yerr=sigmas, fmt=".-", markersize=4, linewidth=1.0, label=label)


def _minutes(look: CycleLook, history: CycleHistory) -> float:
    return (look.time_s - history.looks[0].time_s) / _S_PER_MIN
