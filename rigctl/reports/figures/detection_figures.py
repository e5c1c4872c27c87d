"""Pictures of detection: the map of the RX statistic, and ROC curves."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps

from model.prediction import PairDetection
from rigctl.comparison.rx_detection import RxOnRun
from rigctl.files.choices import RocKind
from rigctl.reports.figures.figure_style import (
    MEASURED,
    PREDICTED,
    legend_below,
    legend_beside,
    png,
    subplots,
)
from rigctl.reports.figures.picture_drawing import Picture, pictures_png

# What one background pixel in ten exceeds.
_LEAST_SHOWN = 0.8
# More names than these fit no legend.
_MOST_NAMED = 12


def statistic_picture(found: RxOnRun, *, background: str) -> bytes:
    """Return the map of the statistic on a log scale, from what one background pixel in ten exceeds."""
    values = np.log10(np.maximum(found.statistic, 1e-3))
    picture = Picture(
        values=values,
        low=_LEAST_SHOWN,
        high=max(float(np.nanmax(values, initial=_LEAST_SHOWN)), _LEAST_SHOWN + 0.1),
        colours="cividis",
        title=f"RX against {background}",
        label="log10 D",
    )
    return pictures_png((picture,))


def roc_plot(found: RxOnRun, *, background: str, target: str) -> bytes:
    """Return the measured ROC with its band and the predicted one on top."""
    figure, axes = subplots(1, 1, size=(6.4, 4.6))
    ax = axes[0]
    ax.fill_between(found.p_false_alarm, found.band_low, found.band_high, color=MEASURED, alpha=0.25, label="95 % band")
    ax.plot(found.p_false_alarm, found.empirical_p_detection, color=MEASURED, label="measured pixels")
    ax.plot(found.p_false_alarm, found.predicted_p_detection, color=PREDICTED, label="predicted, exact law")
    ax.plot(found.p_false_alarm, found.p_false_alarm, color="0.5", linestyle=":", label="chance")
    ax.set_xscale("log")
    ax.set_xlabel("probability of false alarm")
    ax.set_ylabel("probability of detection")
    ax.set_ylim(-0.02, 1.02)
    ax.set_title(f"RX: {target} on {background}")
    legend_beside(ax)
    return png(figure)


def roc_png(curves: Mapping[RocKind, Sequence[PairDetection]], labels: Sequence[str] = ("",)) -> bytes:
    """Return a panel for each kind of vector, a curve for each point; of many a dozen are named, the others grey.

    Parameters
    ----------
    curves : mapping
        Kind to curves.
    labels : sequence of str
        What each is of.
    """
    named = np.unique(np.linspace(0, len(labels) - 1, min(len(labels), _MOST_NAMED)).astype(int))
    # Names of many curves stand below, where they hide none.
    figure, axes = subplots(1, len(curves), size=(5.6 * len(curves), 4.4 + 0.16 * len(named) * (len(labels) > 1)))
    for ax, (kind, found) in zip(axes, curves.items(), strict=True):
        colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(found)))
        for k, (one, label, colour) in enumerate(zip(found, labels, colours, strict=True)):
            if k in named:
                name = f"{label} (area {one.auc:.4f})".strip()
                ax.plot(one.p_false_alarm, one.p_detection, color=colour, label=name, linewidth=1.6, zorder=3)
            else:
                ax.plot(one.p_false_alarm, one.p_detection, color="0.8", linewidth=0.6)
        ax.plot(found[0].p_false_alarm, found[0].p_false_alarm, ":", color="0.6", linewidth=1.0)
        ax.set_xscale("log")
        ax.set_ylim(0.0, 1.02)
        ax.set_xlabel("probability of false alarm")
        ax.set_ylabel("probability of detection")
        ax.set_title(f"RX on {kind}: {found[0].target} on {found[0].background}", fontsize=10)
        legend_below(ax)
    return png(figure)
