"""The figures of [MK14] as the model has them, and what noise does to the degree of polarization."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from model.prediction import RegionPrediction
from model.processing.dolp_studies import DolpAgainstSnr, EstimatorError
from rigctl.paper.curves import Panel, PaperFigure
from rigctl.paper.digitised import DigitisedPoint
from rigctl.reports.figures.figure_style import (
    COLOURS,
    MEASURED,
    PREDICTED,
    legend_below,
    legend_of_all,
    png,
    say_beneath,
    subplots,
)
from rigctl.reports.figures.prediction_figures import laws_of

_PANEL_PIXELS = 120
_MOST_FALSE_ALARMS = 0.03
_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))


def curves_png(figure: PaperFigure, beneath: Sequence[str], points: Sequence[DigitisedPoint] = ()) -> bytes:
    """Return a figure of curves; points of the paper's own figure, where somebody has them, lie over them."""
    columns = len(figure.panels)
    drawn, axes = subplots(1, columns, size=(max(6.4 * columns, 8.5), 4.8 + 0.16 * len(beneath)))
    for ax, panel in zip(axes, figure.panels, strict=True):
        _draw(ax, panel)
        if not panel.log_y:
            _overlay(ax, [one for one in points if one.panel in ("", panel.letter)])
        legend_below(ax)
    drawn.suptitle(f"[MK14] Fig. {figure.number}: {figure.title}", fontsize=11)
    say_beneath(drawn, beneath)
    return png(drawn)


def _draw(ax: Axes, panel: Panel) -> None:
    colours = len(COLOURS)
    for k, curve in enumerate(panel.curves):
        # Where colours come round again, lines are broken.
        line = "--" if k >= colours and curve.line == "-" else curve.line
        ax.plot(curve.x, curve.y, linestyle=line or "none", marker=curve.marker or None, label=curve.label)
    if panel.log_x:
        ax.set_xscale("log")
    if panel.log_y:
        ax.set_yscale("log")
        # Toward false alarms everywhere next to nothing is missed, by so many decades that they would hide the others.
        shown = np.concatenate([curve.y[curve.x <= _MOST_FALSE_ALARMS] for curve in panel.curves])
        ax.set_ylim(0.1 * float(np.min(shown)), 10.0 * float(np.max(shown)))
    elif panel.log_x:
        ax.set_ylim(0.0, 1.03)
    else:
        ax.set_ylim(0.0, 1.05 * max(float(np.nanmax(curve.y)) for curve in panel.curves))
    ax.set_title(panel.title, fontsize=9)
    ax.set_xlabel(panel.x_label)
    ax.set_ylabel(panel.y_label)


def _overlay(ax: Axes, points: Sequence[DigitisedPoint]) -> None:
    for name in dict.fromkeys(point.label for point in points):
        own = [point for point in points if point.label == name]
        ax.plot([point.x for point in own], [point.y for point in own], "kx", markersize=6, label=f"digitised: {name}")


def panels_png(predictions: Mapping[str, RegionPrediction], names: Mapping[str, str], beneath: Sequence[str]) -> bytes:
    """Return Fig. 6: S0 and DoLP of panels, each pixel drawn from the predicted law (seed 1)."""
    generator = np.random.default_rng(1)
    size = (_PANEL_PIXELS * _PANEL_PIXELS, 3)
    s0, degree = [], []
    for name in names:
        stokes = predictions[name].stokes_dn
        pixels = stokes.mean + generator.standard_normal(size) @ np.linalg.cholesky(stokes.cov).T
        s0.append(pixels[:, 0].reshape(_PANEL_PIXELS, -1))
        degree.append(np.hypot(pixels[:, 1], pixels[:, 2]).reshape(_PANEL_PIXELS, -1) / s0[-1])
    figure, axes = subplots(1, 2, size=(12.0, 4.0))
    for ax, parts, label, cmap in zip(axes, (s0, degree), ("S0 [DN]", "DoLP"), ("gray", "magma"), strict=True):
        shown = ax.imshow(np.hstack(parts), cmap=cmap, vmin=0.0)
        ax.set_title(f"{label}: {', '.join(names.values())} (left to right)", fontsize=9)
        ax.set_xlabel("x [pixel]")
        ax.set_ylabel("y [pixel]")
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8)
    figure.suptitle("[MK14] Fig. 6: panels drawn from the predicted law; no picture of the authors", fontsize=11)
    say_beneath(figure, beneath)
    return png(figure)


def laws_figure_png(
    predictions: Mapping[str, RegionPrediction],
    names: Mapping[str, str],
    beneath: Sequence[str],
    points: Sequence[DigitisedPoint] = (),
) -> bytes:
    """Return Fig. 8 (b): laws of s1, s2 and DoLP of the panels' pixels, exact and, dashed, Gaussian to first order."""
    figure, axes = subplots(1, 3, size=(14.0, 4.6 + 0.16 * len(beneath)))
    quantities = ("s1n", "s2n", "dolp")
    for name, label in names.items():
        one = predictions[name]
        for ax, quantity, (x, density) in zip(axes, quantities, laws_of(one), strict=True):
            # Where both are the same the thin line lies on the broad one.
            (line,) = ax.plot(x, density, linewidth=4.0, alpha=0.35, label=f"{label}, exact")
            mean, std = one.quantities[quantity]["mean"], one.quantities[quantity]["std"]
            gauss = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
            ax.plot(x, gauss, "--", color=line.get_color(), linewidth=1.4, label=f"{label}, first order")
    for letter, ax, label in zip("abc", axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        _overlay(ax, [one for one in points if one.panel in ("", letter)])
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
        legend_below(ax)
    figure.suptitle("[MK14] Fig. 8 (b): sun 22, view 53, phi 180", fontsize=11)
    say_beneath(figure, beneath)
    return png(figure)


def fig5_plot(found: DolpAgainstSnr) -> bytes:
    """Return mean and deviation of DoLP against the SNR of S0: draws, first order, exact, as [MK14] Fig. 5."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    decibel = 20 * np.log10(found.snr)
    rows = (
        (axes[0], "mean of DoLP", found.drawn_mean, found.drawn_mean_error, found.first_mean, found.true_mean),
        (axes[1], "deviation of DoLP", found.drawn_std, found.drawn_std_error, found.first_std, found.true_std),
    )
    for ax, label, drawn, error, first, exact in rows:
        ax.errorbar(decibel, drawn, yerr=error, fmt="o", markersize=4, color=MEASURED, label="Poisson draws")
        ax.plot(decibel, first, color="0.45", linestyle="--", label="first order, [MK14]")
        ax.plot(decibel, exact, color=PREDICTED, label="exact law of Poisson counts")
        ax.axvline(20.0, color="0.8", linewidth=1.0)
        ax.set_xlabel("SNR of S0 [dB, amplitude]")
        ax.set_ylabel(label)
        ax.set_ylim(0.0, 1.15 * float(np.max(drawn)))
    legend_of_all(figure, axes[1])
    return png(figure)


def estimator_plot(true_snr: NDArray[np.float64], errors: Mapping[str, EstimatorError]) -> bytes:
    """Return bias and rms error of every estimator against the true signal-to-noise ratio."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    for (name, found), dash in zip(errors.items(), _DASHES, strict=True):
        axes[0].plot(true_snr, found.bias, linestyle=dash, label=name)
        axes[1].plot(true_snr, found.rms, linestyle=dash, label=name)
    for ax, label in zip(axes, ("bias", "rms error"), strict=True):
        ax.set_xlabel("true DoLP / deviation")
        ax.set_ylabel(f"{label} / deviation")
        ax.axhline(0.0 if label == "bias" else 1.0, color="0.8", linewidth=1.0)
    legend_of_all(figure, axes[1])
    return png(figure)
