"""``rigctl log``: what happened in a session, from its begin."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, results


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    only: Annotated[
        str | None, typer.Option(metavar="WORD", help="Events of this name only, such as interlock or round.")
    ] = None,
    last: Annotated[int | None, typer.Option(metavar="N", min=1, help="The last N of them.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Tell what happened in a session, line by line, with UTC: while it runs, and years later.

    Example: rigctl log runs/2026-05-04 --only interlock
    """
    from rigctl.runs.run_events import event_line, read_events
    from rigctl.runs.run_folder import read_contents

    read_contents(run)  # says so where this is no run folder
    events = [event for event in read_events(run) if only in (None, event.event)]
    events = events if last is None else events[-last:]
    if as_json:
        print_json({"run": str(run), "events": [asdict(event) for event in events]})
        return
    for event in events:
        results().print(event_line(event), markup=False)
