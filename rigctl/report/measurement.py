"""A measured run as maps, numbers and files: S0, DoLP, AoLP, residual of the fit, faults, and notes of people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import NOTHING, covariance_rows, finite
from rigctl.measure.faults import UNSEEN
from rigctl.measure.measure import measured_with_ratios
from rigctl.report.document import Column, Section, Table
from rigctl.report.drawing import (
    DrawnPicture,
    pictures_png,
)
from rigctl.report.prediction import SCHEMA_VERSION, STATISTICS, with_error
from rigctl.runs.records import frames_text

if TYPE_CHECKING:
    from model.processing.samples import Sample, Texture
    from rigctl.console import Json
    from rigctl.files.regions import Region
    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.measure.measure import MeasuredRegion, Measurement, PolarizationImages
    from rigctl.report.files import Content
    from rigctl.runs.folder import Run
    from rigctl.runs.records import Annotation


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


def measurement_json(measurement: Measurement, textures: dict[str, Texture] | None = None) -> dict[str, Json]:
    """Return the numbers of a run as JSON, with known textures of its regions."""
    grid = measurement.grid
    content: dict[str, Json] = {
        "schema_version": SCHEMA_VERSION,
        "unit": grid.unit,
        "statistics": STATISTICS,
        "cycles": grid.cycles,
        "polarizer_angles_rad": dict(zip(grid.channel_names, grid.polarizer_angles_rad.tolist(), strict=True)),
        "extinction_ratio": finite(measurement.extinction_ratio),
        "dark_level_dn": dict(zip(grid.channel_names, measurement.frames.dark_level.level_dn.tolist(), strict=True)),
        "dark_level_source": measurement.frames.dark_level.source,
        "saturated_pixels": int(measurement.frames.saturated.sum()),
        "missing_pixels": int(measurement.frames.missing.sum()),
        "left_out": list(grid.left_out),
        "warnings": list(measurement.plan.warnings),
        "pixels": {name: pixels_json(region) for name, region in measurement.regions.items()},
        "regions": {name: region_statistics(region) for name, region in measurement.regions.items()},
    }
    if textures is not None:
        content["texture"] = {name: texture_json(texture) for name, texture in textures.items()}

    return content | annotations_of(measurement.run, grid.left_out)


def texture_json(texture: Texture) -> dict[str, Json]:
    """Return the texture of a region as JSON: of (S0, S1, S2), in the square of the measurement's unit."""
    return {
        "cov": [*covariance_rows(texture.cov)],
        "std_error": texture.std_error.tolist(),
        "rank_one_share": finite(texture.rank_one_share),
        "common_factor_rms": texture.common_factor_rms,
        "remark": texture.remark,
    }


def diagnosis_json(found: RunDiagnosis | None) -> dict[str, Json]:
    """Return the faults found in a run as JSON."""
    if found is None:
        return {"terms": [], "first": None, "named": [], "reason": "not asked"}
    first = found.first
    return {
        "terms": [{k: v for k, v in vars(term).items() if k != "by_region"} for term in found.terms],
        "first": None if first is None else first.name,
        "named": [term.title for term in found.named],
        "reason": found.reason,
        "unseen": UNSEEN,
    }


def pixels_json(region: MeasuredRegion) -> dict[str, float]:
    """Return the numbers of used and unused pixels of a region."""
    return {
        "used": region.pixels,
        "excluded": region.excluded,
        "edge": region.edge,
        "hit": region.hit,
        "worth_independent": region.independent_pixels,
    }


def region_statistics(region: MeasuredRegion) -> dict[str, dict[str, float]]:
    """Return every measured number of a region with its standard error, by quantity and statistic.

    DoLP has its intervals too: ``mean_68_low``, ``mean_68_high``, and those of 95 %.
    """
    found: dict[str, dict[str, float]] = {}
    for quantity, statistics in measured_with_ratios(region).items():
        found[quantity] = {}
        for statistic, sample in statistics.items():
            found[quantity][statistic] = sample.value
            found[quantity][f"{statistic}_std_error"] = sample.std_error
            for level, (low, high) in zip((68, 95), sample.intervals or (), strict=False):
                found[quantity] |= {f"{statistic}_{level}_low": low, f"{statistic}_{level}_high": high}
    return found


_TITLE = "Notes and exclusions"


def annotation_table(annotations: Sequence[Annotation]) -> Table[Annotation]:
    """Return what is noted of a run, line by line."""
    columns: tuple[Column[Annotation], ...] = (
        Column(title="when", text=lambda one: f"{one.utc[:19]}Z", left=True),
        Column(title="by", text=lambda one: one.by, left=True),
        Column(title="what", text=lambda one: one.kind, left=True),
        Column(title="frames", text=lambda one: frames_text(one.frames), left=True),
        Column(title="text", text=lambda one: one.text, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(annotations))


def annotation_sections(annotations: Sequence[Annotation]) -> Iterable[Section]:
    """Yield the section of a report with the notes on a run, if there are any."""
    if annotations:
        yield Section(title=_TITLE, blocks=(annotation_table(annotations),))


def annotations_json(annotations: Sequence[Annotation]) -> list[Json]:
    """Return the notes on a run as JSON."""
    return [asdict(one) for one in annotations]


def annotations_of(run: Run, left_out: Sequence[str]) -> dict[str, Json]:
    """Return notes and unused frames of a run, for a result in JSON."""
    return {"annotations": annotations_json(run.annotations), "left_out": list(left_out)} if run.annotations else {}
