"""``rigctl verify``: check every checksum of a run."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import track

from rigctl.console.failures import EXIT_DATA, EXIT_INCOMPLETE
from rigctl.console.terminal import print_json, progress, results
from rigctl.errors import RunFolderError

if TYPE_CHECKING:
    from rigctl.runs.frame_record import FrameRecord
    from rigctl.runs.verification import Finding, Verification

_GAPS_SHOWN = 20
_SAID = {"whole": "whole", "unfinished": "sound so far, UNFINISHED", "damaged": "DAMAGED"}


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Check every checksum of a run, its manifest against the frames, and the frames against what was planned.

    Ends with 0 where the run is whole: every check holds, and the session has noted its end over these very frames.
    Ends with 75 where it is unfinished, with 4 where anything is damaged, missing or contradictory; a step of the plan
    without a frame is named. What a killed session leaves behind (unfinished files, a frame that was never
    acknowledged) is listed as left over and is not bad.

    Example: rigctl verify runs/2026-05-04
    """
    from rigctl.jobs.verify import verify

    verification = verify(run, watch=_with_progress)
    if as_json:
        print_json(asdict(verification))
    else:
        _print(run, verification)
    if verification.state == "damaged" and as_json:
        raise typer.Exit(EXIT_DATA)
    if verification.state == "damaged":
        raise RunFolderError(f"{run}: {len(verification.bad)} bad of {verification.frames} frames and their files")
    if verification.state == "unfinished":
        raise typer.Exit(EXIT_INCOMPLETE)


def _with_progress(frames: Sequence["FrameRecord"]) -> Iterable["FrameRecord"]:
    return track(frames, description="verifying", console=progress(), transient=True)


def _print(run: Path, verification: "Verification") -> None:
    console = results()
    console.print(f"{run}: {verification.frames} frames, {_SAID[verification.state]}", markup=False)
    _print_findings("bad", verification.bad)
    _print_findings("left over", verification.leftovers)
    for gap in verification.gaps[:_GAPS_SHOWN]:
        console.print(f"  missing: {gap}", markup=False)
    if len(verification.gaps) > _GAPS_SHOWN:
        console.print(f"  missing: {len(verification.gaps) - _GAPS_SHOWN} more steps", markup=False)
    for text in verification.unchecked:
        console.print(f"  not checked: {text}", markup=False)


def _print_findings(title: str, findings: Sequence["Finding"]) -> None:
    for finding in findings:
        results().print(f"  {title}: {finding.file}: {finding.problem}", markup=False)
