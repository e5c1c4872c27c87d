"""``rigctl summary``: a page on how a session went."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.destination_options import summary_page
from rigctl.console.json_text import Json
from rigctl.console.terminal import print_json, progress, results, warn


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The page; RUN-summary.html if left out.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Write a page on how a session went: contact sheet, counts and drift by angle, faults of the frames, sun, events.

    Example: rigctl summary runs/2026-05-04
    """
    from rigctl.jobs.summary import summarise_session
    from rigctl.measurement.fault_terms import fault_lines
    from rigctl.reports.tables.annotation_tables import annotations_of
    from rigctl.reports.tables.numbers_json import diagnosis_json
    from rigctl.runs.annotation_record import left_out_texts

    page = summary_page(run) if out is None else out
    found = summarise_session(run, page)
    history = found.history
    if as_json:
        kinds = Counter[str](record.kind for record in history.run.frames)
        events = Counter(event.event for event in history.events)
        told = diagnosis_json(found.diagnosis)
        answer: dict[str, Json] = {
            "run": str(run),
            "page": str(page),
            "frames": kinds,
            "events": events,
            "diagnosis": told,
            "doubts": found.doubts,
        }
        print_json(answer | annotations_of(history.run, left_out_texts(history.run.annotations, history.run.excluded)))
        return
    for line in fault_lines(found.diagnosis.named, found.diagnosis.reason):
        results().print(line, markup=False)
    for doubt in found.doubts:
        warn(doubt)
    progress().print(f"summary: {page}", markup=False)
