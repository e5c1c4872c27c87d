"""Numbers as JSON holds them: one shape for prediction, measurement and comparison.

``regions.NAME.QUANTITY.STATISTIC`` is a number in a prediction; in a measurement there is ``STATISTIC_std_error``
beside it; in a comparison it is a row.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

from model.prediction.prediction import RegionPrediction
from model.prediction.region_performance import PairDetection, PolarizationStrength
from model.processing.texture import Texture
from rigctl.comparison.compared_run import ComparedRun
from rigctl.comparison.rows import Row, measured_with_ratios
from rigctl.comparison.trends import Trend
from rigctl.comparison.verdict import RegionVerdict
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.region_numbers import MeasuredRegion
from rigctl.measurement.run_diagnosis import UNSEEN, FaultTerm, RunDiagnosis
from rigctl.prediction.performance import Performance
from rigctl.reports.table import Table
from rigctl.reports.tables.provenance import provenance_json
from rigctl.reports.tables.row_table import numbers_columns, row_table
from rigctl.reports.writers.data_files import finite, json_rows

SCHEMA_VERSION = 1

STATISTICS = {
    "mean": "mean over the region's pixels (of dolp, s1n, s2n and aolp_deg: of the region's mean Stokes vector)",
    "std": "standard deviation over pixels, spatial, of one frame or cycle (s1n, s2n, dolp, aolp_deg: first order)",
    "std_temporal": "standard deviation of a pixel from repeat to repeat",
    "std_spatial_mean": "standard deviation over pixels, spatial, of the mean of all repeats",
    "first_order": "the same to first order, as [MK14] has it; shown, not compared",
}


def prediction_json(
    predictions: dict[str, RegionPrediction], performance: Performance, *, remarks: Iterable[str]
) -> dict[str, Any]:
    """Return predictions, and what they are worth, as JSON holds them."""
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


def _strength(found: PolarizationStrength | None) -> dict[str, Any] | None:
    """Return the law of a region's DoLP in a few numbers; nothing where there is no light."""
    if found is None:
        return None
    quantiles = {f"{p:g}": float(q) for p, q in zip(found.probabilities, found.quantiles, strict=True)}
    return {"quantiles": quantiles, "nedolp": found.nedolp, "unpolarised_mean": finite(found.unpolarised_mean)}


def _pair(pair: PairDetection) -> dict[str, Any]:
    rates = zip(pair.p_false_alarm, pair.p_detection, strict=True)
    return {
        "target": pair.target,
        "background": pair.background,
        "p_detection": {f"{rate:g}": finite(float(found)) for rate, found in rates},
        "auc": finite(pair.auc),
        "warnings": list(pair.warnings),
    }


def measurement_json(measurement: Measurement, textures: dict[str, Texture] | None = None) -> dict[str, Any]:
    """Return what a run measured as JSON holds it, with the textures of its regions where they are known."""
    grid = measurement.grid
    content = {
        "schema_version": SCHEMA_VERSION,
        "unit": grid.unit,
        "statistics": STATISTICS,
        "cycles": grid.cycles,
        "polarizer_angles_rad": dict(zip(grid.channel_names, grid.polarizer_angles_rad.tolist(), strict=True)),
        "extinction_ratio": finite(measurement.extinction_ratio),
        "dark_level_dn": dict(zip(grid.channel_names, measurement.dark_level.level_dn.tolist(), strict=True)),
        "dark_level_source": measurement.dark_level.source,
        "saturated_pixels": int(measurement.saturated.sum()),
        "missing_pixels": int(measurement.missing.sum()),
        "left_out": list(grid.left_out),
        "warnings": list(measurement.plan.warnings),
        "pixels": {name: _pixels(region) for name, region in measurement.regions.items()},
        "regions": {name: _measured(region) for name, region in measurement.regions.items()},
    }
    if textures is not None:
        content["texture"] = {name: texture_json(texture) for name, texture in textures.items()}
    return content


def texture_json(texture: Texture) -> dict[str, Any]:
    """Return the texture of a region as JSON holds it: of (S0, S1, S2), in the square of the measurement's unit."""
    return {
        "cov": texture.cov.tolist(),
        "std_error": texture.std_error.tolist(),
        "rank_one_share": finite(texture.rank_one_share),
        "common_factor_rms": texture.common_factor_rms,
        "remark": texture.remark,
    }


def compared_json(found: ComparedRun) -> dict[str, Any]:
    """Return the content of comparison.json."""
    comparison, measurement = found.comparison, found.measurement
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": comparison.kind,
        "agrees": comparison.agrees,
        "verdict": comparison.verdict,
        "flags": [check.name for check in comparison.flags],
        "alpha": comparison.alpha,
        "scale": None if comparison.scale is None else asdict(comparison.scale),
        "disagreements": json_rows(row_table(comparison.disagreements)),
        "diagnosis": asdict(comparison.diagnosis) | diagnosis_json(comparison.run_diagnosis),
        "statistics": STATISTICS,
        "unit": measurement.grid.unit,
        "regions": _with_verdicts(_rows_by_name(comparison.rows), comparison.regions),
        "rows": json_rows(row_table(comparison.rows)),
        "pixels": {name: _pixels(region) for name, region in measurement.regions.items()},
        "explanation": None if comparison.attribution is None else asdict(comparison.attribution),
        "trends": [_trend(found) for found in comparison.trends],
        "budget": {found.region: found.parts for found in comparison.budgets},
        "checks": [asdict(check) for check in comparison.checks],
        "remarks": list(comparison.remarks),
        "not_tested": list(comparison.not_tested),
        "provenance": provenance_json(found),
    }


def diagnosis_json(found: RunDiagnosis | None) -> dict[str, Any]:
    """Return what a run says of its own faults as JSON holds it."""
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


def _fault(term: FaultTerm) -> dict[str, Any]:
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


def _with_verdicts(
    regions: dict[str, dict[str, Any]], verdicts: Mapping[str, RegionVerdict]
) -> dict[str, dict[str, Any]]:
    """Return regions with their verdict and its reason beside their quantities."""
    return {name: asdict(verdict) | regions.get(name, {}) for name, verdict in verdicts.items()}


def _rows_by_name(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, Any]]]:
    """Return rows by region, quantity and statistic."""
    regions: dict[str, dict[str, dict[str, Any]]] = {}
    for row in rows:
        numbers = json_rows(Table(columns=numbers_columns(), rows=(row,)))[0]
        regions.setdefault(row.region, {}).setdefault(row.quantity, {})[row.statistic] = numbers
    return regions


def _trend(found: Trend) -> dict[str, Any]:
    share = found.order.share_concordant
    return {"quantity": found.quantity, "over": found.over, "predicted": found.predicted, "share_concordant": share} | (
        asdict(found.order)
    )


def _pixels(region: MeasuredRegion) -> dict[str, float]:
    return {
        "used": region.pixels,
        "excluded": region.excluded,
        "edge": region.edge,
        "worth_independent": region.independent_pixels,
    }


def _measured(region: MeasuredRegion) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for quantity, statistics in measured_with_ratios(region).items():
        found[quantity] = {}
        for statistic, sample in statistics.items():
            found[quantity][statistic] = sample.value
            found[quantity][f"{statistic}_std_error"] = sample.std_error
    return found
