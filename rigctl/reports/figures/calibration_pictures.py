"""Pictures of a sensor's fixed pattern: maps, histograms, spectrograms, defects."""

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from calibration.sensor.levels import Spectrogram
from calibration.sensor.pattern import Defect, FixedPattern, PatternHistogram
from rigctl.reports.figures.figure_style import (
    MEASURED,
    PREDICTED,
    few_log_labels,
    finish_picture,
    legend_below,
    legend_of_all,
    png,
    subplots,
)

SingleArray = NDArray[np.float32]

_SHOWN_PERCENTILES = (0.5, 99.5)
_PERCENT = 100.0
# More pixels than this are averaged for a picture on a page.
_WIDEST = 900
_LEAST_COUNT = 0.5
_DEFECT_COLOURS = {
    "hot": "#d55e00",
    "cold": "#0072b2",
    "bright": "#e69f00",
    "weak": "#009e73",
    "noisy": "#cc79a7",
    "jumping": "#000000",
}
_MARKERS = dict(zip(_DEFECT_COLOURS, "ov^sDx", strict=True))


def maps_png(pattern: FixedPattern) -> bytes:
    """Return the dark mean, the response and the temporal noise of each pixel as pictures, and where defects are."""
    response = _PERCENT * (pattern.flat.mean_dn - pattern.dark.mean_dn) / pattern.signal_dn
    height, width = response.shape
    figure, axes = subplots(2, 2, size=(10.8, min(max(8.4 * height / width + 1.4, 4.0), 18.0)))
    _map(figure, axes[0], pattern.dark.mean_dn, title="Dark mean", label="mean [DN]")
    _map(figure, axes[1], response, title="Response", label="signal over its mean [%]")
    _map(figure, axes[2], np.sqrt(pattern.dark.temporal_variance_dn2), title="Dark noise in time", label="noise [DN]")
    _defects(axes[3], pattern)
    return png(figure)


def _map(figure: Figure, axes: Axes, picture: SingleArray, *, title: str, label: str) -> None:
    height, width = picture.shape
    scale = min(1.0, _WIDEST / width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if scale < 1.0 else picture
    low, high = np.percentile(small, _SHOWN_PERCENTILES)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    shown = axes.imshow(small, cmap="cividis", vmin=low, vmax=high, interpolation="nearest", extent=extent)
    finish_picture(figure, axes, shown, title=f"{title} (0.5 to 99.5 %)", label=label)


def _defects(axes: Axes, pattern: FixedPattern) -> None:
    mask = pattern.defects.mask
    axes.set(xlim=(-0.5, mask.shape[1] - 0.5), ylim=(mask.shape[0] - 0.5, -0.5), aspect="equal")
    for name, count in pattern.defects.counts.items():
        y, x = np.nonzero(mask & Defect[name.upper()].value)
        (shown,) = axes.plot(x, y, _MARKERS[name], ms=4, color=_DEFECT_COLOURS[name], label=f"{name}: {count}")
        shown.set_markerfacecolor("none")
    axes.set(xlabel="x [pixel]", ylabel="y [pixel]", title=f"{pattern.defects.n_defect} pixels unlike the others")
    if not pattern.defects.n_defect:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", va="center")
        return
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.08, 1.0), borderaxespad=0.0)


def histograms_png(pattern: FixedPattern) -> bytes:
    """Return logarithmic histograms of the pixels' deviations from their neighbours, and the accumulated ones."""
    figure, axes = subplots(2, 2, size=(10.4, 6.6))
    for column, (found, factor, what) in enumerate(
        (
            (pattern.dark_histogram, 1.0, "dark mean off that of 5 x 5 pixels [DN]"),
            (pattern.response_histogram, _PERCENT, "response off that of 5 x 5 pixels [%]"),
        )
    ):
        _histogram(axes[column], found, factor, what)
        _accumulated(axes[2 + column], found, factor, what)
    return png(figure)


def _histogram(axes: Axes, found: PatternHistogram, factor: float, what: str) -> None:
    centres = factor * found.centres
    axes.step(centres, np.maximum(found.counts, _LEAST_COUNT), where="mid", color=MEASURED, lw=1.2, label="pixels")
    label = f"normal law, {factor * found.sigma:.3g} from quartiles"
    axes.plot(centres, np.maximum(found.normal_counts, 1e-3), color=PREDICTED, ls="--", label=label)
    axes.set(yscale="log", xlabel=what, ylabel="pixels in a bin", ylim=(_LEAST_COUNT, None))
    axes.grid(alpha=0.3, lw=0.4)
    legend_below(axes)


def _accumulated(axes: Axes, found: PatternHistogram, factor: float, what: str) -> None:
    share = _PERCENT * found.at_least / found.counts.sum()
    axes.step(factor * found.reach, share, where="post", color=MEASURED, lw=1.2, label="pixels")
    axes.set(
        yscale="log",
        xlabel=f"|{what.partition(' [')[0]}| [{what.partition('[')[2]}",
        ylabel="pixels at least so far off [%]",
    )
    axes.set_ylim(0.5 * _PERCENT / found.counts.sum(), 200.0)
    axes.grid(alpha=0.3, lw=0.4)


def spectrograms_png(pattern: FixedPattern) -> bytes:
    """Return the fixed pattern by spatial frequency, along rows and along columns, in the dark and with light."""
    figure, axes = subplots(2, 2, size=(10.4, 6.4))
    dark_noise_dn = float(np.sqrt(pattern.dark.temporal_variance_dn2.mean() / pattern.n_dark_frames))
    flat_noise = float(np.sqrt(pattern.flat.temporal_variance_dn2.mean() / pattern.n_flat_frames)) / pattern.signal_dn
    response_noise = float(np.hypot(flat_noise, dark_noise_dn / pattern.signal_dn))
    for place, found, factor, noise, title, unit in (
        (0, pattern.dark_rows, 1.0, dark_noise_dn, "Dark, along rows", "DN"),
        (1, pattern.dark_columns, 1.0, dark_noise_dn, "Dark, along columns", "DN"),
        (2, pattern.response_rows, _PERCENT, response_noise, "Response, along rows", "%"),
        (3, pattern.response_columns, _PERCENT, response_noise, "Response, along columns", "%"),
    ):
        _spectrogram(axes[place], found, factor, noise)
        axes[place].set(title=title, xlabel="frequency [cycles per pixel]", ylabel=f"amplitude [{unit}]")
    legend_of_all(figure, axes[0])
    return png(figure)


def _spectrogram(axes: Axes, found: Spectrogram, factor: float, noise: float) -> None:
    if not found.amplitude.size:
        return
    axes.semilogy(
        found.frequency_per_pixel, factor * found.amplitude, color=MEASURED, lw=0.9, label="fixed pattern and noise"
    )
    axes.axhline(factor * noise, color=PREDICTED, ls="--", lw=1.2, label="what is left of noise in time")
    axes.axhline(factor * found.median, color="0.45", ls=":", lw=1.2, label="median: independent pixels")
    axes.grid(alpha=0.3, which="both", lw=0.4)
    few_log_labels(axes.yaxis)
    axes.tick_params(axis="y", which="both", labelsize=8)
