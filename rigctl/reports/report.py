"""The report of a comparison: one HTML file that holds all of it."""

import base64
import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from model.performance import pair_detections, polarization_strength
from model.prediction import RegionPrediction
from rigctl.comparison.comparison import Comparison
from rigctl.comparison.rows import Row
from rigctl.files.regions import Region
from rigctl.measurement.measurement import Measurement
from rigctl.reports import figures
from rigctl.reports.tables_json import FALSE_ALARM_RATES, STATISTICS

# So many disagreements are shown at the head of the report; all stand in its tables.
_SHOWN_DISAGREEMENTS = 12
_SUMMARY = (("dolp", "mean"), ("aolp_deg", "mean"), ("dolp_snr", "mean"))
_NOTHING = "–"


@dataclass(frozen=True, kw_only=True)
class _TextRow:
    """A row with its numbers as text, each to the digits that its error allows."""

    name: str
    statistic: str
    predicted: str
    measured: str
    std_error: str
    std_error_inputs: str
    z_measurement: str
    z: str
    agrees: bool | None
    verdict: str


def render(
    comparison: Comparison, measurement: Measurement, regions: list[Region], *, title: str, provenance: dict[str, Any]
) -> str:
    """Return the report as HTML that needs no other file.

    Parameters
    ----------
    comparison, measurement
        What to report.
    regions : list of Region
        Drawn on the pictures.
    title : str
        Heading.
    provenance : dict
        Files, hashes, devices and versions that the numbers rest on, as JSON can hold them.
    """
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string((files("rigctl") / "data" / "report.html.j2").read_text(encoding="utf-8"))
    by_region: dict[str, list[_TextRow]] = {}
    for row in comparison.rows:
        by_region.setdefault(row.region, []).append(_text_row(row))
    ranked = sorted(comparison.disagreements, key=lambda row: -abs(row.z or 0.0))[:_SHOWN_DISAGREEMENTS]
    return template.render(
        title=title,
        comparison=comparison,
        simulated=measurement.run.session.get("origin") == "simulated",
        tests=sum(row.agrees is not None for row in comparison.rows),
        worst=[_text_row(row, with_region=True) for row in ranked],
        strengths=[_strength(name, region) for name, region in comparison.predictions.items()],
        detections=_detections(comparison),
        false_alarm_rates=[f"{rate:g}" for rate in FALSE_ALARM_RATES],
        summary=[_summary(name, comparison, measurement) for name in measurement.regions],
        pictures=_embedded(figures.scene_pictures(measurement, regions)),
        score_plot=_embedded(figures.scores(comparison)),
        bars=_embedded(figures.channel_bars(comparison.rows, unit=measurement.grid.unit)),
        histogram_plot=_embedded(figures.histograms(measurement, comparison.predictions)),
        unit=measurement.grid.unit,
        statistics=STATISTICS,
        by_region=by_region,
        facts=_facts(measurement),
        provenance=json.dumps(provenance, indent=2),
    )


def _facts(measurement: Measurement) -> dict[str, str]:
    grid, first = measurement.grid, measurement.grid.records[0][0]
    exposures = "not known" if grid.exposures_s is None else ", ".join(f"{1000 * t:g}" for t in grid.exposures_s)
    return {
        "run": str(measurement.run.path),
        "frames come from": str(measurement.run.session.get("origin", "not said")),
        "camera": f"{first.camera_model or 'not known'}, serial number {first.camera_serial or 'not known'}",
        "stage": f"{first.stage_model or 'not known'}, serial number {first.stage_serial or 'not known'}",
        "polarizer angles, measured [deg]": ", ".join(
            f"{a * 57.29577951308232:.3f}" for a in grid.polarizer_angles_rad
        ),
        "extinction ratio of the polarizer": f"{measurement.extinction_ratio:g}",
        "cycles": str(grid.cycles),
        "exposure [ms]": exposures,
        "dark level": measurement.dark_level.source,
        "saturated pixels in the picture": str(int(measurement.saturated.sum())),
        "missing pixels in the picture": str(int(measurement.missing.sum())),
        "first frame": first.start_utc or "not known",
    }


def _summary(name: str, comparison: Comparison, measurement: Measurement) -> dict[str, Any]:
    rows = [row for row in comparison.rows if row.region == name]
    cells: list[str] = []
    for quantity, statistic in _SUMMARY:
        row = next((r for r in rows if (r.quantity, r.statistic) == (quantity, statistic)), None)
        text = None if row is None else _text_row(row)
        cells += [_NOTHING, _NOTHING] if text is None else [text.predicted, text.measured]
    return {
        "region": name,
        "pixels": measurement.regions[name].pixels,
        "cells": cells,
        "tests": sum(row.agrees is not None for row in rows),
        "off": sum(row.agrees is False for row in rows),
    }


def _strength(name: str, prediction: RegionPrediction) -> dict[str, str]:
    """Return the law of a region's DoLP as text, and how it was found."""
    found = {"region": name, "method": prediction.dolp_method, "error": f"{prediction.dolp_error:.1e}"}
    if not prediction.stokes_dn.mean[0] > 0.0:
        return found | dict.fromkeys(("low", "median", "high", "nedolp"), _NOTHING)
    strength = polarization_strength(prediction)
    low, median, high = (f"{quantile:.4f}" for quantile in strength.quantiles)
    return found | {"low": low, "median": median, "high": high, "nedolp": f"{strength.nedolp:.4f}"}


def _detections(comparison: Comparison) -> list[dict[str, Any]]:
    """Return the probability of detection of every pair of regions as text."""
    return [
        {
            "target": pair.target,
            "background": pair.background,
            "cells": [_NOTHING if np.isnan(p) else f"{p:.4f}" for p in (*pair.p_detection, pair.auc)],
        }
        for pair in pair_detections(comparison.predictions, FALSE_ALARM_RATES)
    ]


def _text_row(row: Row, *, with_region: bool = False) -> _TextRow:
    error = float(np.hypot(row.std_error or 0.0, row.std_error_inputs or 0.0))
    return _TextRow(
        name=f"{row.region}: {row.quantity}" if with_region else row.quantity,
        statistic=row.statistic,
        predicted=to_digits(row.predicted, error),
        measured=to_digits(row.measured, error),
        std_error=_NOTHING if row.std_error is None else f"{row.std_error:.2g}",
        std_error_inputs=_NOTHING if row.std_error_inputs is None else f"{row.std_error_inputs:.2g}",
        z_measurement=_NOTHING if row.z_measurement is None else f"{row.z_measurement:+.2f}",
        z=_NOTHING if row.z is None else f"{row.z:+.2f}",
        agrees=row.agrees,
        verdict={True: "agrees", False: "DISAGREES", None: "no test"}[row.agrees],
    )


def to_digits(value: float, error: float) -> str:
    """Return a number to two digits of its error, or to four digits where there is none."""
    if error == 0.0:
        return f"{value:.4g}"
    exponent = int(f"{error:.1e}".partition("e")[2])
    return f"{value:.{max(0, 1 - exponent)}f}"


def _embedded(png: bytes) -> str:
    return base64.b64encode(png).decode("ascii")
