"""A prediction without a run as pictures: counts behind each angle, and the laws of s1, s2 and DoLP."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from model.prediction.prediction import RegionPrediction
from model.processing import normalized_stokes
from model.processing.dolp import pdf
from rigctl.reports.figures.figure_style import LINE_STYLES, png, subplots

FloatArray = NDArray[np.float64]

_POINTS, _SPAN = 400, 5.0
_LINE_LENGTH = 150


def counts_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return mean and deviation of the counts behind each angle, as [MK14] Fig. 7 has them."""
    figure, axes = subplots(1, 2, size=(11.0, 4.4))
    for k, (name, one) in enumerate(predictions.items()):
        counts = {key: value for key, value in one.quantities.items() if key.startswith("dn_")}
        angles = [key.removeprefix("dn_") for key in counts]
        places = np.arange(len(angles)) + 0.8 * (k + 0.5) / len(predictions) - 0.4
        for ax, statistic in zip(axes, ("mean", "std"), strict=True):
            ax.bar(places, [value[statistic] for value in counts.values()], 0.8 / len(predictions), label=name)
            ax.set_xticks(np.arange(len(angles)), angles)
            ax.set_xlabel("angle of the polarizer [deg]")
    axes[0].set_ylabel("mean counts [DN]")
    axes[1].set_ylabel("deviation of the counts over pixels [DN]")
    axes[0].legend(fontsize=8)
    say_beneath(figure, warnings)
    return png(figure)


def laws_png(predictions: Mapping[str, RegionPrediction], *, warnings: Sequence[str] = ()) -> bytes:
    """Return the laws of s1, s2 and DoLP of single pixels, as [MK14] Fig. 8b has them, by the exact distributions."""
    figure, axes = subplots(1, 3, size=(14.0, 4.4))
    for (name, one), style in zip(predictions.items(), cycle(LINE_STYLES)):
        if not one.stokes_dn.mean[0] > 0.0:
            continue
        for ax, (x, density) in zip(axes, laws_of(one), strict=True):
            ax.plot(x, density, style, label=name)
    for ax, label in zip(axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
    axes[0].legend(fontsize=8)
    say_beneath(figure, warnings)
    return png(figure)


def laws_of(one: RegionPrediction) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return abscissa and density of s1, s2 and DoLP of a region's pixels; its S0 is above 0."""
    mean, cov = one.stokes_dn.mean, one.stokes_dn.cov
    found = []
    for k, name in ((1, "s1n"), (2, "s2n")):
        x = _around(one.quantities[name]["mean"], one.quantities[name]["std"])
        found.append((x, normalized_stokes.distribution(x, mean, cov, component=k).density))
    x = np.linspace(*_dolp_limits(one), _POINTS)
    return (*found, (x, pdf(x, mean, cov)))


def _around(mean: float, std: float) -> FloatArray:
    return np.linspace(mean - _SPAN * std, mean + _SPAN * std, _POINTS)


def _dolp_limits(one: RegionPrediction) -> tuple[float, float]:
    mean, std = one.quantities["dolp"]["mean"], max(one.quantities["s1n"]["std"], one.quantities["s2n"]["std"])
    return max(mean - _SPAN * std, 0.0), mean + _SPAN * std


def say_beneath(figure: Figure, lines: Sequence[str]) -> None:
    """Put words under a figure."""
    if lines:
        width = int(_LINE_LENGTH * figure.get_figwidth() / 14.0)
        figure.supxlabel("\n".join(fill(line, width) for line in lines), fontsize=7.5, x=0.01, ha="left")
