"""The files of many runs beside one scene: one table, one report, and a report of each."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from model.prediction.quantity_table import FOLLOWED
from rigctl.comparison.compared_run import ComparedSeries
from rigctl.comparison.series import SeriesPoint, hours_of, mean_row
from rigctl.durable_file import write_durably
from rigctl.reports.compare_context import provenance_json
from rigctl.reports.comparison_files import write_comparison
from rigctl.reports.figures import series_figure
from rigctl.reports.number_text import signed, to_digits
from rigctl.reports.report import NOTHING, Bullets, Paragraph, Picture, Report, Section, Table, Verbatim
from rigctl.reports.tables import comparison_tables
from rigctl.reports.tables.comparison_json import SCHEMA_VERSION
from rigctl.reports.writers.html_page import render
from rigctl.reports.writers.pdf_document import pdf
from rigctl.reports.writers.rows_csv import rows_csv

# Of a drift that is worth a word, in standard errors.
_DRIFTS = 4.0


def series_json(series: ComparedSeries) -> dict[str, Any]:
    """Return the content of series.json."""
    return {
        "schema_version": SCHEMA_VERSION,
        "agrees": series.agrees,
        "alpha": series.alpha,
        "scene": {"path": str(series.scene.path), "sha256": series.scene.sha256},
        "runs": [_point_json(point) for point in series.points],
        "drifts": [
            {"region": d.region, "quantity": d.quantity, "z": d.z, "per_hour": asdict(d.line)} for d in series.drifts
        ],
        "trends": [
            {"quantity": t.quantity, "over": t.over, "predicted": t.predicted} | asdict(t.order) for t in series.trends
        ],
        "provenance": [provenance_json(run) for run in series.runs],
    }


def write_series(series: ComparedSeries, out: Path) -> None:
    """Write series.json, series.csv, series.html and series.pdf, and those of each run in a folder of its name."""
    out.mkdir(parents=True, exist_ok=True)
    for point, run in zip(series.points, series.runs, strict=True):
        write_comparison(run, out / point.name)
    write_durably(out / "series.json", (json.dumps(series_json(series), indent=2, allow_nan=False) + "\n").encode())
    rows = [row for point in series.points for row in point.comparison.rows]
    facts = [_facts(point) for point in series.points for _ in point.comparison.rows]
    write_durably(out / "series.csv", rows_csv(rows, facts).encode())
    report = series_report(series)
    write_durably(out / "series.html", render(report).encode())
    write_durably(out / "series.pdf", pdf(report))


def series_report(series: ComparedSeries) -> Report:
    """Return what the report of many runs says."""
    points = series.points
    off = [point for point in points if not point.comparison.agrees]
    drifting = [d for d in series.drifts if abs(d.z) > _DRIFTS]
    reasons = [
        (
            "",
            f"{len(points)} runs, {len(off)} of which disagree, at alpha = {series.alpha:g} for all of them together.",
        ),
        *(("Disagrees:", f"{point.name}: {_why(point)}") for point in off),
        *(
            (
                "Drifts:",
                f"{d.quantity} of {d.region} against its prediction, by {d.line.slope:+.3g} an hour ({d.z:+.1f})",
            )
            for d in drifting
        ),
    ]
    return Report(
        title=f"{len(points)} runs beside the model",
        source="Each run with its own sun, time and exposure, and one scene file for all.",
        good=series.agrees,
        verdict="Model and measurement agree." if series.agrees else "Model and measurement disagree.",
        reasons=tuple(reasons),
        sections=[
            *_figures(points),
            Section(title="All runs", blocks=(_table(points),)),
            *_drift_sections(series),
            Section(title="What this does not test", blocks=(Bullets(items=_not_tested(points)),)),
            Section(
                title="Provenance in full",
                blocks=(Verbatim(text=json.dumps([provenance_json(run)["files"] for run in series.runs], indent=2)),),
                folded=True,
            ),
        ],
    )


def _why(point: SeriesPoint) -> str:
    comparison = point.comparison
    text = (
        f"{len(comparison.disagreements)} numbers; points to {', '.join(comparison.diagnosis.points_to) or 'no cause'}"
    )
    return text if comparison.explanation is None else f"{text}; {comparison.explanation.remark}"


def _figures(points: Sequence[SeriesPoint]) -> Iterable[Section]:
    hours = hours_of(points)
    zeniths = [point.sun_zenith_deg for point in points if point.sun_zenith_deg is not None]
    axes: list[tuple[str, list[float], str]] = []
    if hours is None:
        axes.append(("order", [float(k) for k in range(1, len(points) + 1)], "run, as given"))
    else:
        axes.append(("time", hours, "time from the first run [h]"))
    if len(zeniths) == len(points) and len(set(zeniths)) > 1:
        axes.append(("sun", zeniths, "sun from the zenith [deg]"))
    for name, at, label in axes:
        pictures = tuple(
            Picture(
                png=series_figure.series_figure(
                    points, at, region=region, quantities=FOLLOWED, label=label, unit=points[0].measurement.grid.unit
                ),
                caption=f"{region}, both sides and residuals against the {name}; bars of residuals: both errors.",
            )
            for region in points[0].measurement.regions
        )
        yield Section(title=f"Against the {name}", blocks=pictures)


def _table(points: Sequence[SeriesPoint]) -> Table:
    rows, off = [], []
    for point in points:
        for region in point.measurement.regions:
            for quantity in FOLLOWED:
                row = mean_row(point, region, quantity)
                if row is not None:
                    error = ((row.std_error or 0.0) ** 2 + (row.std_error_inputs or 0.0) ** 2) ** 0.5
                    when = NOTHING if point.start is None else point.start.strftime("%Y-%m-%d %H:%M")
                    sun = NOTHING if point.sun_zenith_deg is None else f"{point.sun_zenith_deg:.1f}"
                    numbers = (to_digits(row.predicted, error), to_digits(row.measured, error))
                    rows.append((point.name, when, sun, region, quantity, *numbers, f"{error:.1e}", signed(row.z)))
                    off.append(row.agrees is False)
    return Table(
        header=("run", "first frame", "sun zenith", "region", "quantity", "predicted", "measured", "error", "z, both"),
        rows=tuple(rows),
        off=tuple(off),
        left=(0, 1, 3, 4),
    )


def _drift_sections(series: ComparedSeries) -> Iterable[Section]:
    if series.drifts:
        note = Paragraph(
            text="Straight line through measured less predicted, weighted by the errors of the measurement. Errors of "
            "the inputs are common to all runs and no reason for a drift, unless they change with the sun."
        )
        table = Table(
            header=("region", "quantity", "drift an hour", "its error", "z", "chi-square left"),
            rows=tuple(
                (
                    d.region,
                    d.quantity,
                    f"{d.line.slope:+.3g}",
                    f"{d.line.std_error:.2g}",
                    signed(d.z),
                    f"{d.line.chi_square:.1f} / {d.line.degrees_of_freedom}",
                )
                for d in series.drifts
            ),
            off=tuple(abs(d.z) > _DRIFTS for d in series.drifts),
            left=(0, 1),
        )
        yield Section(title="Drift of the residuals", blocks=(table, note))
    if series.trends:
        yield Section(title="Trends", blocks=(comparison_tables.trend_table(series.trends),))


def _not_tested(points: Sequence[SeriesPoint]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(text for point in points for text in point.comparison.not_tested))


def _facts(point: SeriesPoint) -> dict[str, Any]:
    start = None if point.start is None else point.start.isoformat()
    return {"run": point.name, "first_frame_utc": start, "sun_zenith_deg": point.sun_zenith_deg}


def _point_json(point: SeriesPoint) -> dict[str, Any]:
    comparison = point.comparison
    return _facts(point) | {
        "agrees": comparison.agrees,
        "disagreements": len(comparison.disagreements),
        "points_to": list(comparison.diagnosis.points_to),
        "explanation": None if comparison.explanation is None else comparison.explanation.remark,
        "means": {
            region: {
                quantity: asdict(row) for quantity in FOLLOWED if (row := mean_row(point, region, quantity)) is not None
            }
            for region in point.measurement.regions
        },
    }
