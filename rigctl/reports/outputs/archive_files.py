"""The table and the page of a job over an archive."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from rigctl.archive.run_rows import RunRow, Verb
from rigctl.console.json_text import Json
from rigctl.reports.figures.archive_figures import archive_figure
from rigctl.reports.report import Paragraph, Picture, Report, Section, Verdict
from rigctl.reports.table import Table, text_columns
from rigctl.reports.tables.archive_tables import archive_table, in_short
from rigctl.reports.writers.data_files import csv_rows, json_file, json_rows
from rigctl.reports.writers.html_page import html
from rigctl.reports.writers.output_folder import write_folder
from rigctl.version import VERSION

SCHEMA_VERSION = 1
_TITLES: dict[Verb, str] = {
    "compare": "beside the model",
    "stokes": "measured",
    "verify": "verified",
    "recalibrate": "measured anew with other calibrations",
}
_GOOD = {"agrees", "agrees_with_reservations", "sound", "flagged", "whole"}


def write_archive_rows(rows: Sequence[RunRow], verb: Verb, out: Path, *, runs: int, alpha: float) -> None:
    """Write archive.csv, archive.json and archive.html.

    Parameters
    ----------
    rows : sequence of RunRow
        Of the runs that were tried.
    verb : str
        The job.
    out : Path
        Folder.
    runs : int
        How many runs match.
    alpha : float
        Chance of a false disagreement, of each comparison.
    """
    table = archive_table(rows, verb)
    content: dict[str, Json] = {
        "schema_version": SCHEMA_VERSION,
        "created_by": f"rigctl {VERSION}",
        "job": verb,
        "runs": runs,
        "done": len(rows),
        "verdicts": dict(Counter(row.verdict for row in rows)),
        "rows": list(json_rows(table)),
    }
    files = {
        "archive.csv": csv_rows(table),
        "archive.json": json_file(content),
        "archive.html": html(_report(rows, verb, runs=runs, alpha=alpha)).encode(),
    }
    write_folder(out, files)


def _report(rows: Sequence[RunRow], verb: Verb, *, runs: int, alpha: float) -> Report:
    counted = Counter(row.verdict for row in rows).most_common()
    left = runs - len(rows)
    said = ", ".join(f"{times} {verdict}" for verdict, times in counted) or "no run matches"
    picture = archive_figure(rows, verb)
    return Report(
        title=f"{runs} runs {_TITLES[verb]}",
        source="A row for each run of the archive and each of its regions; a run that failed has its reason.",
        verdict=Verdict(
            good=left == 0 and all(row.verdict in _GOOD for row in rows),
            text=f"{said}{f'; {left} not done yet' if left else ''}.",
            reasons=tuple(_reasons(rows, verb, alpha)),
        ),
        sections=[
            *(() if picture is None else (Section(title="Against time", blocks=(Picture(png=picture),)),)),
            *_failed(rows),
            Section(title="All runs", blocks=(archive_table(rows, verb),)),
        ],
    )


def _reasons(rows: Sequence[RunRow], verb: Verb, alpha: float) -> Iterable[tuple[str, str]]:
    if verb == "compare":
        judged = sum(row.exit_code in (0, 5) for row in rows)
        yield "", f"alpha = {alpha:g} is of each run: of {judged} runs {judged * alpha:.2g} disagree by chance."
    if verb == "recalibrate":
        yield "", "before: by the run's own angles and dark level, no calibration; after: with those of each row."


def _failed(rows: Sequence[RunRow]) -> Iterable[Section]:
    """Yield why runs have no result, each reason once with how many."""
    failed = Counter(in_short(row) for row in rows if row.exit_code not in (0, 5) and row.reason)
    if failed:
        table = Table(
            columns=text_columns("runs", "why", left=(1,)),
            rows=tuple((str(times), reason) for reason, times in failed.most_common()),
        )
        note = Paragraph(text="The same reason of several runs stands once, without their folder.")
        yield Section(title="Unfit", blocks=(table, note))
