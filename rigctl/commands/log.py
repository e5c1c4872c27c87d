"""``rigctl log``: what happened in a session, from its begin."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from rigctl.console.json_text import Json
from rigctl.console.terminal import print_json, results


class _Told(NamedTuple):
    """An event or a note: when, its name, as a line, as JSON."""

    utc: str
    name: str
    line: str
    content: dict[str, Json]
    is_note: bool = False


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    only: Annotated[
        str | None, typer.Option(metavar="WORD", help="Events of this name only, such as interlock, round or note.")
    ] = None,
    last: Annotated[int | None, typer.Option(metavar="N", min=1, help="The last N of them.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Tell what happened in a session, line by line, with UTC: while it runs, and years later.

    Readings of monitors, one event an exposure, are told where `--only "monitor readings"` asks for them.

    Example: rigctl log runs/2026-05-04 --only interlock
    """
    from rigctl.runs.annotations import read_annotations
    from rigctl.runs.monitor_readings import READINGS_EVENT
    from rigctl.runs.run_events import event_line, read_events
    from rigctl.runs.run_folder import read_contents

    read_contents(run)  # says so where this is no run folder
    told = [_Told(event.utc, event.event, event_line(event), asdict(event)) for event in read_events(run)]
    notes = [_Told(one.utc, one.kind, one.line, asdict(one), is_note=True) for one in read_annotations(run)]
    if notes:  # events stay in their order, whatever the clock did; what people note stands where it was in time
        told = sorted((*told, *notes), key=lambda one: one.utc)
    told = [one for one in told if only == one.name or (only is None and (as_json or one.name != READINGS_EVENT))]
    told = told if last is None else told[-last:]
    if as_json:
        events = [one.content for one in told if not one.is_note]
        noted = [one.content for one in told if one.is_note]
        print_json({"run": str(run), "events": events, "annotations": noted})
        return
    for one in told:
        results().print(one.line, markup=False)
