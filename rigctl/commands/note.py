"""``rigctl note``: write down something about a run."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.options import AnnotationBy
from rigctl.console.terminal import print_json, results, warn


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder; it may still be growing.")],
    text: Annotated[str, typer.Argument(metavar="TEXT", help="What there is to say, in quotes.")],
    at: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="When it was: 14:10 (UTC, or with a zone), 2026-05-04T14:10Z; else now."),
    ] = None,
    by: AnnotationBy = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Write down something about a run, with time and name: it stands in its log, summary and reports.

    It goes into annotations.jsonl in the run; frames never change.

    Example: rigctl note runs/2026-05-04 "a cloud passed" --at 10:00 --by ann
    """
    from rigctl.jobs.annotate import note_run

    noted = note_run(run, text, at=at, by=by)
    for remark in noted.remarks:
        warn(remark)
    if as_json:
        print_json(noted.as_json())
    elif noted.annotation is not None:
        results().print(noted.annotation.line, markup=False)
