"""Whole ROC curves, on Stokes parameters and on counts side by side."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps

from model.prediction.region_performance import PairDetection
from rigctl.files.choices import RocKind
from rigctl.reports.figures.figure_style import png, subplots

# More names than these fit no legend.
_MOST_NAMED = 12


def roc_png(curves: Mapping[RocKind, Sequence[PairDetection]], labels: Sequence[str] = ("",)) -> bytes:
    """Return a panel for each kind of vector, a curve for each point.

    Parameters
    ----------
    curves : mapping
        Kind to curves.
    labels : sequence of str
        What each is of.
    """
    figure, axes = subplots(1, len(curves), size=(5.6 * len(curves), 4.4))
    named = np.unique(np.linspace(0, len(labels) - 1, min(len(labels), _MOST_NAMED)).astype(int))
    for ax, (kind, found) in zip(axes, curves.items(), strict=True):
        colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(found)))
        for k, (one, label, colour) in enumerate(zip(found, labels, colours, strict=True)):
            name = f"{label} (area {one.auc:.4f})".strip() if k in named else None
            ax.plot(one.p_false_alarm, one.p_detection, color=colour, label=name, linewidth=1.4)
        ax.plot(found[0].p_false_alarm, found[0].p_false_alarm, ":", color="0.6", linewidth=1.0)
        ax.set_xscale("log")
        ax.set_ylim(0.0, 1.02)
        ax.set_xlabel("probability of false alarm")
        ax.set_ylabel("probability of detection")
        ax.set_title(f"RX on {kind}: {found[0].target} on {found[0].background}", fontsize=10)
        ax.legend(fontsize=7)
    return png(figure)
