"""Pictures of the RX detector on a run."""

import numpy as np

from rigctl.comparison.rx_detection import RxOnRun
from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, finish_picture, picture_size, png, subplots


def statistic_picture(found: RxOnRun, *, background: str) -> bytes:
    """Return the map of the statistic on a log scale, from what one background pixel in ten exceeds."""
    figure, axes = subplots(1, 1, size=picture_size(found.statistic, columns=1))
    shown = axes[0].imshow(
        np.log10(np.maximum(found.statistic, 1e-3)), cmap="cividis", vmin=0.8, interpolation="nearest"
    )
    finish_picture(figure, axes[0], shown, title=f"RX against {background}", label="log10 D")
    return png(figure)


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
    ax.legend(fontsize=8)
    return png(figure)
