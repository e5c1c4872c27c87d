"""Pictures of what was measured: S0 and DoLP with the regions, angle of polarization, residual of the fit."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigctl.files.regions import Region
from rigctl.measurement.polarization_images import PolarizationImages
from rigctl.reports.figures.figure_style import finish_picture, picture_axes, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.floating]

# An angle that is known worse than this fades.
_WELL_KNOWN_DEG = 10.0
# Pictures show from the 1st to the 99.5th percentile, so that a few bright pixels do not darken the rest.
_SHOWN_PERCENTILES = (1.0, 99.5)


def scene_pictures(images: PolarizationImages, regions: list[Region], *, unit: str) -> bytes:
    """Return the panchromatic and the DoLP image with the regions, as [MK14] Fig. 6."""
    s0 = images.stokes[0]
    figure, axes = picture_axes(s0.shape, columns=2)
    good = np.where(images.unusable, np.nan, s0)
    _picture(axes[0], s0, scale_of=good, title="S0 (panchromatic)", label=f"S0 [{unit}]", cmap="gray")
    _picture(axes[1], images.dolp, scale_of=images.dolp, title="DoLP", label="DoLP", cmap="viridis", most=1.0)
    for ax in axes:
        _outline(ax, regions)
    return png(figure)


def aolp_picture(images: PolarizationImages) -> bytes:
    """Return the image of the angle of polarization; it fades where it is known to less than 10 degrees."""
    figure, axes = picture_axes(images.aolp_deg.shape)
    angle_deg = np.where(images.unusable, np.nan, images.aolp_deg)
    known = np.clip(_WELL_KNOWN_DEG / np.maximum(images.aolp_error_deg, 1e-9), 0.0, 1.0) ** 2
    # A grey that the cyclic colours never pass: theirs at 0 degrees is a light one.
    axes[0].set_facecolor("0.6")
    shown = axes[0].imshow(angle_deg, cmap="twilight", vmin=0.0, vmax=180.0, interpolation="nearest", alpha=known)
    title = f"AoLP (grey: not known to {_WELL_KNOWN_DEG:g} deg)"
    finish_picture(figure, axes[0], shown, title=title, label="counter-clockwise from horizontal [deg]")
    return png(figure)


def residual_picture(residual: FloatArray) -> bytes:
    """Return the image of what no light gives, as a share of the light."""
    found = 100.0 * residual
    figure, axes = picture_axes(found.shape)
    good = np.abs(found[np.isfinite(found)])
    most = max(float(np.percentile(good, _SHOWN_PERCENTILES[1])), 1e-6) if good.size else 1.0
    shown = axes[0].imshow(found, cmap="RdBu_r", vmin=-most, vmax=most, interpolation="nearest")
    title = "What no light gives"
    finish_picture(figure, axes[0], shown, title=title, label="twice the residual over the light [%]")
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
