"""Pictures and plots of a measurement and a comparison, as PNG."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.prediction.prediction import RegionPrediction
from model.prediction.quantity_table import angle_of
from model.processing import dolp, normalized_stokes
from model.stokes import dolp as degree_of_polarization
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.rows import Row
from rigctl.files.regions import Region
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.polarization_images import PolarizationImages
from rigctl.reports.figures.figure_style import MEASURED, PREDICTED, finish_picture, picture_size, png, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
Law = Callable[[FloatArray], FloatArray]

_BINS = 60
# Pictures show from the 1st to the 99.5th percentile, so that a few bright pixels do not darken the rest.
_WELL_KNOWN_DEG = 10.0
_SHOWN_PERCENTILES = (1.0, 99.5)


def scene_pictures(images: PolarizationImages, regions: list[Region], *, unit: str) -> bytes:
    """Return the panchromatic and the DoLP image with the regions, as [MK14] Fig. 6."""
    s0 = images.stokes[0]
    figure, axes = subplots(1, 2, size=picture_size(s0, columns=2))
    good = np.where(images.unusable, np.nan, s0)
    _picture(axes[0], s0, scale_of=good, title="S0 (panchromatic)", label=f"S0 [{unit}]", cmap="gray")
    _picture(axes[1], images.dolp, scale_of=images.dolp, title="DoLP", label="DoLP", cmap="viridis", most=1.0)
    for ax in axes:
        _outline(ax, regions)
    return png(figure)


def aolp_picture(images: PolarizationImages) -> bytes:
    """Return the image of the angle of polarization; it fades where it is known to less than 10 degrees."""
    figure, axes = subplots(1, 1, size=picture_size(images.aolp_deg, columns=1))
    angle_deg = np.where(images.unusable, np.nan, images.aolp_deg)
    known = np.clip(_WELL_KNOWN_DEG / np.maximum(images.aolp_error_deg, 1e-9), 0.0, 1.0) ** 2
    axes[0].set_facecolor("0.85")
    shown = axes[0].imshow(angle_deg, cmap="twilight", vmin=0.0, vmax=180.0, interpolation="nearest", alpha=known)
    finish_picture(figure, axes[0], shown, title="AoLP, counter-clockwise from horizontal", label="AoLP [deg]")
    return png(figure)


def residual_picture(residual: FloatArray) -> bytes:
    """Return the image of what no light gives, as a share of the light."""
    found = 100.0 * residual
    figure, axes = subplots(1, 1, size=picture_size(found, columns=1))
    good = np.abs(found[np.isfinite(found)])
    most = max(float(np.percentile(good, _SHOWN_PERCENTILES[1])), 1e-6) if good.size else 1.0
    shown = axes[0].imshow(found, cmap="RdBu_r", vmin=-most, vmax=most, interpolation="nearest")
    title = "What no light gives: twice the residual of the fit over the light"
    finish_picture(figure, axes[0], shown, title=title, label="residual [%]")
    return png(figure)


def channel_bars(rows: tuple[Row, ...], *, unit: str) -> bytes:
    """Return mean and deviation of the counts by channel, predicted beside measured, as [MK14] Fig. 7."""
    regions = list(dict.fromkeys(row.region for row in rows))
    figure, axes = subplots(2, len(regions), size=(3.6 * len(regions), 5.6))
    for column, region in enumerate(regions):
        for line, (statistic, title) in enumerate((("mean", "mean"), ("std", "deviation over pixels, one frame"))):
            ax = axes[line * len(regions) + column]
            chosen = [r for r in rows if r.region == region and r.quantity[:3] == "dn_" and r.statistic == statistic]
            _bars(ax, chosen)
            ax.set_title(f"{region}: {title}", fontsize=9)
            ax.set_xlabel("polarizer angle [deg]")
            ax.set_ylabel(f"counts above dark [{unit}]")
    axes[0].legend(fontsize=8)
    return png(figure)


def histograms(measurement: Measurement, predictions: dict[str, RegionPrediction]) -> bytes:
    """Return histograms of s1, s2 and DoLP of each region's pixels with their exact laws, as [MK14] Fig. 8."""
    names = list(predictions)
    figure, axes = subplots(len(names), 3, size=(11.0, 2.9 * len(names)))
    for line, name in enumerate(names):
        pixels, stokes = measurement.regions[name].stokes_pixels, predictions[name].stokes_dn
        lit = pixels[:, pixels[0] > 0.0]
        if not lit.size:
            continue
        step = 1.0 / float(np.median(lit[0]))
        for column, component in enumerate((1, 2)):
            ax = axes[3 * line + column]
            _histogram(ax, lit[component] / lit[0], _ratio_law(stokes, component), step=step, title=name)
            ax.set_xlabel(f"s{component} = S{component}/S0")
        _histogram(axes[3 * line + 2], degree_of_polarization(lit.T), _dolp_law(stokes), step=step, title=name)
        axes[3 * line + 2].set_xlabel("DoLP")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    return png(figure)


def scores(comparison: Comparison) -> bytes:
    """Return every row's standard score, and which of them disagree."""
    tested = [row for row in comparison.rows if row.z is not None]
    names = list(dict.fromkeys(row.region for row in tested))
    figure, axes = subplots(1, 1, size=(11.0, 0.9 + 0.55 * len(names)))
    axes[0].axvspan(-2, 2, color="0.92", label="two standard errors")
    for agrees, colour, label in ((True, PREDICTED, "agrees"), (False, MEASURED, "disagrees")):
        chosen = [row for row in tested if row.agrees is agrees]
        heights = [names.index(row.region) for row in chosen]
        values = [row.z or 0.0 for row in chosen]
        axes[0].scatter(values, heights, s=18, c=colour, marker="o" if agrees else "x", label=label, zorder=3)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    farthest = max([5.0, *(1.3 * abs(row.z or 0.0) for row in tested)])
    axes[0].set_xscale("symlog", linthresh=5.0)
    axes[0].set_xlim(-farthest, farthest)
    axes[0].xaxis.set_major_formatter("{x:g}")
    axes[0].set_ylim(-0.6, len(names) - 0.4)
    axes[0].set_xlabel("(measured - predicted) / standard error of both")
    axes[0].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return png(figure)


def _picture(
    ax: "Axes", image: FloatArray, *, title: str, label: str, cmap: str, scale_of: FloatArray, most: float = np.inf
) -> None:
    good = scale_of[np.isfinite(scale_of)]
    low, high = np.percentile(good, _SHOWN_PERCENTILES) if good.size else (0.0, 1.0)
    high = min(high, most)
    shown = ax.imshow(image, cmap=cmap, vmin=low, vmax=high, interpolation="nearest")
    finish_picture(ax.figure, ax, shown, title=title, label=label)


def _outline(ax: "Axes", regions: list[Region]) -> None:
    for region in regions:
        corners = [*region.outline(), region.outline()[0]]
        x, y = zip(*corners, strict=True)
        ax.plot(x, y, color="white", linewidth=2.4)
        ax.plot(x, y, color="black", linewidth=1.0)
        ax.annotate(
            region.name,
            (min(x), min(y)),
            xytext=(0, 3),
            textcoords="offset points",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.0},
        )


def _bars(ax: "Axes", rows: list[Row]) -> None:
    places = np.arange(len(rows))
    ax.bar(places - 0.2, [row.predicted for row in rows], 0.38, color=PREDICTED, label="predicted")
    ax.bar(places + 0.2, [row.measured for row in rows], 0.38, color=MEASURED, label="measured")
    both = [np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0) for row in rows]
    ax.errorbar(places + 0.2, [row.measured for row in rows], yerr=both, fmt="none", ecolor="black", capsize=3)
    ax.set_xticks(places, [angle_of(row.quantity) for row in rows])


def _histogram(ax: "Axes", values: FloatArray, law: Law, *, step: float, title: str) -> None:
    low, high = float(values.min()), float(values.max())
    ax.hist(
        values, bins=_edges(low, high, step).tolist(), density=True, color=MEASURED, alpha=0.55, label="measured pixels"
    )
    x = np.linspace(low, high, 300)
    try:
        ax.plot(x, law(x), color=PREDICTED, linewidth=1.8, label="predicted law")
    except (ValueError, ArithmeticError) as error:
        ax.annotate(f"no law: {error}", (0.02, 0.95), xycoords="axes fraction", fontsize=6, va="top", wrap=True)
    ax.set_title(title, fontsize=9)
    ax.set_ylabel("density")
    ax.locator_params(axis="x", nbins=5)


def _edges(low: float, high: float, step: float) -> FloatArray:
    """Return edges of bins that are whole multiples of one count's step wide: others make spikes that are not there."""
    width = step * max(1.0, np.ceil((high - low) / _BINS / step))
    start = np.floor(low / width) - 0.5
    return np.asarray((start + np.arange(int(np.ceil((high - low) / width)) + 3)) * width)


def _ratio_law(stokes: Moments, component: int) -> Law:
    return lambda x: normalized_stokes.distribution(x, stokes.mean, stokes.cov, component=component).density


def _dolp_law(stokes: Moments) -> Law:
    return lambda x: np.asarray(dolp.pdf(x, stokes.mean, stokes.cov))
