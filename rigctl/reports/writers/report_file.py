"""A report as the bytes of a file, by the name of the file."""

from pathlib import Path

from rigctl.reports.report import Report
from rigctl.reports.writers.html_page import html
from rigctl.reports.writers.pdf_document import pdf


def report_file(report: Report, path: Path) -> bytes:
    """Return the report as PDF where the file's name ends in .pdf, as HTML otherwise."""
    return pdf(report) if path.suffix.lower() == ".pdf" else html(report).encode()
