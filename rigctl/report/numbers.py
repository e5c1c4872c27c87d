"""Numbers of a prediction and of a measurement in JSON, in one shape, and notes on a run.

``regions.NAME.QUANTITY.STATISTIC`` is a number in a prediction; a measurement also has ``STATISTIC_std_error``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from rigctl.base.numbers import covariance_rows, finite
from rigctl.measure.faults import UNSEEN
from rigctl.report.document import Column, Section, Table
from rigctl.runs.records import frames_text

if TYPE_CHECKING:
    from model.prediction import PairDetection, PolarizationStrength, RegionPrediction
    from model.processing.samples import Texture
    from rigctl.console import Json
    from rigctl.measure.diagnose import RunDiagnosis
    from rigctl.measure.faults import FaultTerm
    from rigctl.measure.measure import MeasuredRegion, Measurement
    from rigctl.prediction.predict import Performance
    from rigctl.runs.folder import Run
    from rigctl.runs.records import Annotation


SCHEMA_VERSION = 1

STATISTICS = {
    "mean": "mean over the region's pixels (of dolp, s1n, s2n and aolp_deg: of the region's mean Stokes vector)",
    "std": "standard deviation over pixels, spatial, of one frame or cycle (s1n, s2n, dolp, aolp_deg: first order)",
    "std_temporal": "standard deviation of a pixel from repeat to repeat",
    "std_spatial_mean": "standard deviation over pixels, spatial, of the mean of all repeats",
    "first_order": "the same to first order, as in [MK14]; shown, not compared",
}


def prediction_json(
    predictions: Mapping[str, RegionPrediction], performance: Performance, *, remarks: Iterable[str]
) -> dict[str, Json]:
    """Return predictions and their accuracy as JSON."""
    return {
        "schema_version": SCHEMA_VERSION,
        "statistics": STATISTICS,
        "regions": {name: prediction.quantities for name, prediction in predictions.items()},
        "methods": {
            name: {"dolp": prediction.dolp_method, "dolp_error": finite(prediction.dolp_error)}
            for name, prediction in predictions.items()
        },
        "dolp_law": {name: _strength(strength) for name, strength in performance.strengths.items()},
        "detection": [_pair(pair) for pair in performance.detections],
        "warnings": {name: list(prediction.warnings) for name, prediction in predictions.items()},
        "remarks": list(remarks),
    }


def _strength(found: PolarizationStrength | None) -> dict[str, Json] | None:
    """Return quantiles of a region's DoLP; nothing without light."""
    if found is None:
        return None
    quantiles = {f"{p:g}": float(q) for p, q in zip(found.probabilities, found.quantiles, strict=True)}
    numbers: dict[str, Json] = {"quantiles": quantiles, "nedolp": found.nedolp}
    if found.nedolp is None:
        from rigctl.prediction.predict import NO_NOISE

        numbers["nedolp_reason"] = NO_NOISE
    return numbers | {"unpolarised_mean": finite(found.unpolarised_mean)}


def _pair(pair: PairDetection) -> dict[str, Json]:
    rates = zip(pair.p_false_alarm, pair.p_detection, strict=True)
    return {
        "target": pair.target,
        "background": pair.background,
        "p_detection": {f"{rate:g}": finite(float(found)) for rate, found in rates},
        "auc": finite(pair.auc),
        "warnings": list(pair.warnings),
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
        "terms": [_fault(term) for term in found.terms],
        "first": None if first is None else first.name,
        "named": [term.title for term in found.named],
        "reason": found.reason,
        "unseen": UNSEEN,
    }


def _fault(term: FaultTerm) -> dict[str, Json]:
    return {
        "name": term.name,
        "angle_deg": term.angle_deg,
        "value": term.value,
        "std_error": term.std_error,
        "unit": term.unit,
        "testable": term.testable,
        "reason": term.reason,
        "confused_with": list(term.confused_with),
        "dolp_shift": term.dolp_shift,
        "aolp_shift_deg": term.aolp_shift_deg,
        "named": term.named,
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
    from rigctl.measure.measure import measured_with_ratios

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
