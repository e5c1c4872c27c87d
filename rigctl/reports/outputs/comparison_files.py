"""The files of a comparison, and of a series of them: reports and numbers."""

from pathlib import Path

from rigctl.comparison.comparison import Comparison
from rigctl.comparison.series import ComparedSeries
from rigctl.reports.pages.comparison_page import comparison_report
from rigctl.reports.pages.series_page import series_report
from rigctl.reports.tables.comparison_json import compared_json
from rigctl.reports.tables.numbers_json import measurement_json, prediction_json
from rigctl.reports.tables.row_table import row_table
from rigctl.reports.tables.series_tables import series_json, series_rows
from rigctl.reports.writers.data_files import csv_rows, json_file
from rigctl.reports.writers.html_page import html
from rigctl.reports.writers.output_folder import report_file, write_folder


def write_comparison(comparison: Comparison, out: Path) -> None:
    """Write comparison.json, comparison.csv, prediction.json, measurement.json, report.html and report.pdf."""
    report = comparison_report(comparison)
    contents = {
        "prediction.json": json_file(
            prediction_json(comparison.predictions, comparison.performance, remarks=comparison.remarks)
        ),
        "measurement.json": json_file(measurement_json(comparison.measurement)),
        "comparison.json": json_file(compared_json(comparison)),
        "comparison.csv": csv_rows(row_table(comparison.rows)),
        "report.html": html(report).encode(),
        "report.pdf": report_file(report, Path("report.pdf")),
    }
    write_folder(out, contents)


def write_comparison_numbers(comparison: Comparison, out: Path) -> None:
    """Write comparison.json alone."""
    write_folder(out, {"comparison.json": json_file(compared_json(comparison))})


def write_series(series: ComparedSeries, out: Path) -> None:
    """Write series.json, series.csv, series.html and series.pdf, and those of each run in a folder of its name."""
    for point in series.points:
        write_comparison(point.comparison, out / point.name)
    report = series_report(series)
    contents = {
        "series.json": json_file(series_json(series)),
        "series.csv": csv_rows(series_rows(series)),
        "series.html": html(report).encode(),
        "series.pdf": report_file(report, Path("series.pdf")),
    }
    write_folder(out, contents)
