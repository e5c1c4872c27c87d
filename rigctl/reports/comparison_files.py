"""The files of a comparison: report and numbers."""

import json
from pathlib import Path
from typing import Any

from rigctl.comparison.compared_run import ComparedRun
from rigctl.durable_file import write_durably
from rigctl.reports.compare_context import calibration_table, effects_block, provenance_json
from rigctl.reports.pages.comparison_page import compare_report
from rigctl.reports.report import Report
from rigctl.reports.tables.comparison_json import comparison_json, measurement_json, prediction_json
from rigctl.reports.writers.html_page import render
from rigctl.reports.writers.pdf_document import pdf
from rigctl.reports.writers.rows_csv import rows_csv


def compared_json(found: ComparedRun) -> dict[str, Any]:
    """Return the content of comparison.json."""
    return comparison_json(found.comparison, found.measurement, provenance=provenance_json(found))


def write_comparison(found: ComparedRun, out: Path) -> None:
    """Write comparison.json, comparison.csv, prediction.json, measurement.json, report.html and report.pdf."""
    out.mkdir(parents=True, exist_ok=True)
    predicted = prediction_json(found.comparison.predictions, found.performance, remarks=found.comparison.remarks)
    for name, content in (
        ("prediction.json", predicted),
        ("measurement.json", measurement_json(found.measurement)),
        ("comparison.json", compared_json(found)),
    ):
        write_durably(out / name, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())
    write_durably(out / "comparison.csv", rows_csv(found.comparison.rows).encode())
    report = comparison_report(found)
    write_durably(out / "report.html", render(report).encode())
    write_durably(out / "report.pdf", pdf(report))


def comparison_report(found: ComparedRun) -> Report:
    """Return what the report says."""
    return compare_report(
        found,
        title=f"{found.measurement.run.path.name} beside the model",
        provenance=provenance_json(found),
        calibration=calibration_table(found.noise),
        effects=None if found.effects is None else effects_block(found.effects),
    )
