"""Numbers as JSON holds them: one shape for prediction, measurement and comparison.

``regions.NAME.QUANTITY.STATISTIC`` is a number in a prediction; in a measurement there is ``STATISTIC_std_error``
beside it; in a comparison it is a row.
"""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from model.prediction.performance import PairDetection, PolarizationStrength
from model.prediction.prediction import RegionPrediction
from model.processing.texture import Texture
from rigctl.comparison.channel_shares import measured_with_ratios
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.explanation import Explanation
from rigctl.comparison.performance import Performance
from rigctl.comparison.rows import Row
from rigctl.comparison.trends import Trend
from rigctl.measurement.measurement import Measurement
from rigctl.measurement.region_numbers import MeasuredRegion

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
            name: {"dolp": prediction.dolp_method, "dolp_error": _finite(prediction.dolp_error)}
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
    return {"quantiles": quantiles, "nedolp": found.nedolp, "unpolarised_mean": _finite(found.unpolarised_mean)}


def _pair(pair: PairDetection) -> dict[str, Any]:
    rates = zip(pair.p_false_alarm, pair.p_detection, strict=True)
    return {
        "target": pair.target,
        "background": pair.background,
        "p_detection": {f"{rate:g}": _finite(float(found)) for rate, found in rates},
        "auc": _finite(pair.auc),
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
        "extinction_ratio": _finite(measurement.extinction_ratio),
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
        "rank_one_share": _finite(texture.rank_one_share),
        "common_factor_rms": texture.common_factor_rms,
        "remark": texture.remark,
    }


def comparison_json(comparison: Comparison, measurement: Measurement, *, provenance: dict[str, Any]) -> dict[str, Any]:
    """Return a comparison as JSON holds it."""
    regions: dict[str, dict[str, dict[str, Any]]] = {}
    for row in comparison.rows:
        regions.setdefault(row.region, {}).setdefault(row.quantity, {})[row.statistic] = _numbers(row)
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": comparison.kind,
        "agrees": comparison.agrees,
        "alpha": comparison.alpha,
        "scale": None if comparison.scale is None else asdict(comparison.scale),
        "disagreements": [asdict(row) for row in comparison.disagreements],
        "diagnosis": asdict(comparison.diagnosis),
        "statistics": STATISTICS,
        "unit": measurement.grid.unit,
        "regions": regions,
        "rows": [asdict(row) for row in comparison.rows],
        "pixels": {name: _pixels(region) for name, region in measurement.regions.items()},
        "explanation": explanation_json(comparison.explanation),
        "trends": [_trend(found) for found in comparison.trends],
        "budget": {found.region: found.parts for found in comparison.budgets},
        "checks": [asdict(check) for check in comparison.checks],
        "remarks": list(comparison.remarks),
        "not_tested": list(comparison.not_tested),
        "provenance": provenance,
    }


def explanation_json(explanation: Explanation | None) -> dict[str, Any] | None:
    """Return what would explain the residuals as JSON holds it; what is fitted stands under "fitted"."""
    if explanation is None:
        return None
    return asdict(explanation)


def _trend(found: Trend) -> dict[str, Any]:
    share = found.order.share_concordant
    return {"quantity": found.quantity, "over": found.over, "predicted": found.predicted, "share_concordant": share} | (
        asdict(found.order)
    )


def _numbers(row: Row) -> dict[str, Any]:
    return {key: value for key, value in asdict(row).items() if key not in ("region", "quantity", "statistic")}


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


def _finite(number: float) -> float | None:
    """Return a number that JSON can hold: infinity (an ideal polarizer) and what does not exist are null."""
    return number if abs(number) < float("inf") else None
