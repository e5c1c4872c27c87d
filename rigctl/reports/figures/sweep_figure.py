"""A sweep as a plot."""

from itertools import cycle

from rigctl.prediction.sweep import Sweep
from rigctl.reports.figures.figure_style import LINE_STYLES, png, subplots
from rigctl.reports.tables.sweep_tables import SHOWN_RATE


def sweep_png(found: Sweep) -> bytes:
    """Return DoLP with its deviation, DoLP SNR and detection of all regions over the value that was swept."""
    panels = 3 if found.pairs else 2
    figure, axes = subplots(1, panels, size=(5.0 * panels, 4.2))
    degree, ratio = axes[:2]
    for region, style in zip(found.regions, cycle(LINE_STYLES)):
        mean, std = (found.series(region, "dolp_pixels", kind) for kind in ("mean", "std"))
        (line,) = degree.plot(found.values, mean, style, marker=".", label=region)
        degree.fill_between(found.values, mean - std, mean + std, color=line.get_color(), alpha=0.2, linewidth=0)
        ratio.plot(found.values, found.series(region, "dolp_snr", "mean"), style, marker=".", label=region)
    degree.set_ylabel("DoLP; band: deviation of a pixel")
    ratio.set_ylabel("DoLP SNR")
    for (target, background), style in zip(found.pairs, cycle(LINE_STYLES)):
        detected = found.detection((target, background), SHOWN_RATE)
        axes[2].plot(found.values, detected, style, marker=".", label=f"{target} on {background}")
        axes[2].set_ylabel(f"P_D at P_FA {SHOWN_RATE:g}")
        axes[2].legend(fontsize=8)
    for ax in axes:
        ax.set_xlabel(found.key)
        ax.set_ylim(bottom=0.0)
    if found.pairs:
        axes[2].set_ylim(0.0, 1.05)
    ratio.legend(fontsize=8)
    return png(figure)
