"""``rigctl summary``: a page on how a session went."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.terminal import progress


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The page; RUN/summary.html if left out.")] = None,
) -> None:
    """Write a page on how a session went: contact sheet, counts and drift by angle, sun track, events.

    Example: rigctl summary runs/2026-05-04
    """
    from rigctl.jobs.summary import summarise_session

    page = run / "summary.html" if out is None else out
    summarise_session(run, page)
    progress().print(f"summary: {page}", markup=False)
