"""``rigctl exclude``: leave frames out of every number, with a reason."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.options import AnnotationBy
from rigctl.console.terminal import print_json, results, warn


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")],
    *,
    frames: Annotated[
        str, typer.Option(metavar="LIST", help="Frames by the number in the manifest and file name: 12,15-18.")
    ],
    reason: Annotated[str | None, typer.Option(metavar="TEXT", help="Why; has to be said, but for --undo.")] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Take them in again.")] = False,
    by: AnnotationBy = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Leave frames of a run out of every number, with a reason, a time and a name; or take them in again.

    It goes into annotations.jsonl in the run; frames never change. Every command that makes numbers of frames leaves
    them out and says so; --ignore-exclusions takes all.

    Example: rigctl exclude runs/2026-05-04 --frames 12,15-18 --reason "a bird" --by ann
    """
    from rigctl.jobs.annotate import exclude_frames
    from rigctl.runs.annotation_record import frames_text

    found = exclude_frames(run, frames, reason=reason, undo=undo, by=by)
    for remark in found.remarks:
        warn(remark)
    if as_json:
        print_json(found.as_json())
        return
    if found.annotation is not None:
        results().print(found.annotation.line, markup=False)
    results().print(f"excluded are now: {frames_text(found.excluded) or 'none'}", markup=False)
