"""Files of a result in their folder, and a report as a file of the kind that its name says."""

from collections.abc import Mapping
from pathlib import Path

from rigctl.reports.report import Report
from rigctl.storage.destination import require_replaceable
from rigctl.storage.durable_file import write_durably


def report_file(report: Report, path: Path) -> bytes:
    """Return the report as PDF where the file's name ends in .pdf, as HTML otherwise."""
    if path.suffix.lower() == ".pdf":
        from rigctl.reports.writers.pdf_document import pdf  # each writer brings its library

        return pdf(report)
    from rigctl.reports.writers.html_page import html

    return html(report).encode()


def write_folder(out: Path, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Write files into a folder, which is made where it is not there; return their names.

    Results of the same names are replaced where they are of rigctl, and of this very command unless it was forced.

    Raises
    ------
    ConfigError
        A file of the same name is not to be replaced; nothing is written.
    """
    require_replaceable(out / name for name in contents)
    out.mkdir(parents=True, exist_ok=True)
    for name, data in contents.items():
        write_durably(out / name, data)
    return tuple(contents)
