"""A comparison as JSON holds it: where a prediction has a number, ``regions.NAME.QUANTITY.STATISTIC``, it has a row."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict

from rigctl.comparison.comparison import Comparison
from rigctl.comparison.numerical_accuracy import ALLOWED_SHARE, NumericalAccuracy
from rigctl.comparison.rows import Row
from rigctl.comparison.trends import Trend
from rigctl.comparison.verdict import RegionVerdict
from rigctl.console.json_text import Json
from rigctl.reports.table import Table
from rigctl.reports.tables.annotation_tables import annotations_of
from rigctl.reports.tables.numbers_json import SCHEMA_VERSION, STATISTICS, diagnosis_json, pixels_json
from rigctl.reports.tables.provenance import provenance_json
from rigctl.reports.tables.row_table import numbers_columns, row_table
from rigctl.reports.writers.data_files import json_rows


def compared_json(comparison: Comparison) -> dict[str, Json]:
    """Return the content of comparison.json."""
    measurement = comparison.measurement
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
        "pixels": {name: pixels_json(region) for name, region in measurement.regions.items()},
        "explanation": None if comparison.attribution is None else asdict(comparison.attribution),
        "trends": [_trend(found) for found in comparison.trends],
        "budget": {found.region: found.parts for found in comparison.budgets},
        "checks": [asdict(check) for check in comparison.checks],
        "remarks": list(comparison.remarks),
        "not_tested": list(comparison.not_tested),
        "accuracy": None if comparison.accuracy is None else _accuracy(comparison.accuracy),
        "provenance": provenance_json(comparison),
        **({} if comparison.picked is None else comparison.picked.as_json()),
        **annotations_of(measurement.run, measurement.grid.left_out),
    }


def _accuracy(found: NumericalAccuracy) -> Json:
    """Return the numerical settings that a comparison chose, and their errors beside those of its rows."""
    return {
        "tolerance": found.tolerance,
        "settings": found.settings,
        "share_of_standard_error": found.share,
        "row": None if found.row is None else "/".join(found.row),
        "allowed_share": ALLOWED_SHARE,
        "is_kept": found.is_kept,
        "is_promised": not found.found.estimated_only,
        "left_out": sorted(found.left_out),
    }


def _with_verdicts(regions: Mapping[str, Mapping[str, Json]], verdicts: Mapping[str, RegionVerdict]) -> Json:
    """Return regions with their verdict and its reason beside their quantities."""
    return {name: {**asdict(verdict), **regions.get(name, {})} for name, verdict in verdicts.items()}


def _rows_by_name(rows: Iterable[Row]) -> dict[str, dict[str, dict[str, Json]]]:
    """Return rows by region, quantity and statistic."""
    regions: dict[str, dict[str, dict[str, Json]]] = {}
    for row in rows:
        numbers = json_rows(Table(columns=numbers_columns(), rows=(row,)))[0]
        regions.setdefault(row.region, {}).setdefault(row.quantity, {})[row.statistic] = numbers
    return regions


def _trend(found: Trend) -> dict[str, Json]:
    share = found.order.share_concordant
    return {"quantity": found.quantity, "over": found.over, "predicted": found.predicted, "share_concordant": share} | (
        asdict(found.order)
    )
