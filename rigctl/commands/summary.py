"""``rigctl summary``: a page on how a session went."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.durable_file import write_durably
from rigctl.reports.pages.run_page import run_page
from rigctl.runs.run_folder import read_run
from rigctl.terminal import progress


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The page; RUN/summary.html if left out.")] = None,
) -> None:
    """Write a page on how a session went: contact sheet, counts and drift by angle, sun track, events.

    Example: rigctl summary runs/2026-05-04
    """
    page = run / "summary.html" if out is None else out
    write_durably(page, run_page(read_run(run)).encode("utf-8"))
    progress().print(f"summary: {page}", markup=False)
