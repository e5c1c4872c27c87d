"""A measured run as maps and files: S0, DoLP, AoLP, residual of the fit, and detection on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import NOTHING
from rigctl.report.document import Column, Table
from rigctl.report.drawing import (
    DrawnPicture,
    pictures_png,
)
from rigctl.report.prediction import with_error

if TYPE_CHECKING:
    from model.processing.samples import Sample
    from rigctl.console import Json
    from rigctl.files.regions import Region
    from rigctl.measure.measure import MeasuredRegion, Measurement, PolarizationImages
    from rigctl.report.files import Content


AnyFloatArray = NDArray[np.floating]

# Error of AoLP above which it fades, as DoLP is below three of its errors.
_KNOWN_DEG = 10.0
# Percentiles at the ends of a picture's scale, so that a few bright pixels do not darken the rest.
_SHOWN_PERCENTILES = (1.0, 99.5)
# Grey, not one of the cyclic colours.
_UNKNOWN_GREY = 153
# Least range of the colour bar, as a share of the values, for an even picture.
_LEAST_SPAN = 1e-3


def summary_table(regions: Mapping[str, MeasuredRegion], *, unit: str) -> Table[Any]:
    """Return S0, DoLP and AoLP of each region with their errors."""
    wanted = {f"S0 [{unit}]": "s0", "DoLP": "dolp", "AoLP [deg]": "aolp_deg"}
    columns: tuple[Column[tuple[str, MeasuredRegion]], ...] = (
        Column(title="region", text=lambda row: row[0], left=True),
        *(Column(title=title, text=partial(_mean_text, name=name)) for title, name in wanted.items()),
    )
    return Table(columns=columns, rows=tuple(regions.items()))


def _mean_text(row: tuple[str, MeasuredRegion], name: str) -> str:
    sample = row[1].quantities.get(name, {}).get("mean")
    return NOTHING if sample is None else sample_text(name, sample)


def sample_text(name: str, sample: Sample) -> str:
    """Return a measured number with its standard error or interval."""
    interval = None if sample.intervals is None else sample.intervals[1]
    return with_error(name, sample.value, sample.std_error, interval)


def scene_pictures(images: PolarizationImages, regions: Sequence[Region], *, unit: str) -> bytes:
    """Return the maps of S0 and DoLP with the regions, as [MK14] Fig. 6."""
    return pictures_png(scene_maps(images, unit=unit), regions=regions)


def uncalibrated_pictures(images: PolarizationImages) -> bytes:
    """Return the maps of S0, DoLP and AoLP of images, with titles that say "uncalibrated"."""
    maps = (*scene_maps(images, unit="DN"), aolp_map(images))
    return pictures_png([replace(one, title=f"{one.title}, uncalibrated") for one in maps])


def scene_maps(images: PolarizationImages, *, unit: str) -> tuple[DrawnPicture, DrawnPicture]:
    """Return the maps of S0 and DoLP."""
    s0 = images.stokes[0]
    s0_low, s0_high = _shown(np.where(images.unusable, np.nan, s0))
    low, high = _shown(images.dolp, most=1.0)
    intensity = DrawnPicture(values=s0, low=s0_low, high=s0_high, colours="gray", title="S0", label=f"S0 [{unit}]")
    return intensity, DrawnPicture(
        values=images.dolp, low=low, high=high, colours="viridis", title="DoLP", label="DoLP"
    )


def aolp_map(images: PolarizationImages) -> DrawnPicture:
    """Return the map of AoLP; it fades to grey where DoLP is not significant, below three of its errors."""
    return DrawnPicture(
        values=np.where(images.unusable, np.nan, images.aolp_deg),
        low=0.0,
        high=180.0,
        colours="aolp",
        title="AoLP (grey: DoLP not significant)",
        label="AoLP [deg]",
        opacity=np.clip(_KNOWN_DEG / np.maximum(images.aolp_error_deg, 1e-9), 0.0, 1.0) ** 2,
        ground=_UNKNOWN_GREY,
    )


def aolp_picture(images: PolarizationImages) -> bytes:
    """Return the map of AoLP as PNG."""
    return pictures_png((aolp_map(images),))


def residual_picture(residual: AnyFloatArray) -> bytes:
    """Return the map of the fit residual, as a share of the light."""
    found = 100.0 * residual
    good = np.abs(found[np.isfinite(found)])
    most = max(float(np.percentile(good, _SHOWN_PERCENTILES[1])), 1e-6) if good.size else 1.0
    picture = DrawnPicture(
        values=found,
        low=-most,
        high=most,
        colours="red-blue",
        title="Fit residual",
        label="twice the residual over the light [%]",
    )
    return pictures_png((picture,))


def _shown(image: AnyFloatArray, *, most: float = np.inf) -> tuple[float, float]:
    """Return the values between which a picture is shown."""
    good = image[np.isfinite(image)]
    low, high = np.percentile(good, _SHOWN_PERCENTILES) if good.size else (0.0, 1.0)
    return float(low), float(max(min(high, most), low + _LEAST_SPAN * max(abs(low), _LEAST_SPAN)))


def stokes_files(
    measurement: Measurement, regions: list[Region], *, fits: bytes, numbers: Mapping[str, Json]
) -> dict[str, Content]:
    """Return pictures and numbers of a measurement as files."""
    images, unit = measurement.images, measurement.grid.unit
    return {
        "stokes.fits": fits,
        "pictures.png": scene_pictures(images, regions, unit=unit),
        "aolp.png": aolp_picture(images),
        **({} if images.residual is None else {"residual.png": residual_picture(images.residual)}),
        "stokes.json": numbers,
    }
