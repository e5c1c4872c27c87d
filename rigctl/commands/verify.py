"""``rigctl verify``: check every checksum of a run."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import track

from rigctl.errors import RunFolderError
from rigctl.terminal import print_json, progress, results

if TYPE_CHECKING:
    from rigctl.runs.run_folder import FrameRecord
    from rigctl.runs.verification import Finding, Verification


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Check every checksum of a run, and its manifest against the frames.

    Ends with 4 where anything is damaged, missing or contradictory. What a killed session leaves behind
    (unfinished files, frames that were never acknowledged) is listed as left over and is not bad.

    Example: rigctl verify runs/2026-05-04
    """
    from rigctl.runs.verification import verify_run

    verification = verify_run(run, watch=_with_progress)
    if as_json:
        print_json(asdict(verification))
    else:
        _print(run, verification)
    if not verification.ok:
        raise RunFolderError(f"{run}: {len(verification.bad)} bad of {verification.frames} frames and their files")


def _with_progress(frames: Sequence["FrameRecord"]) -> Iterable["FrameRecord"]:
    return track(frames, description="verifying", console=progress(), transient=True)


def _print(run: Path, verification: "Verification") -> None:
    console = results()
    state = "sound" if verification.ok else "BAD"
    console.print(f"{run}: {verification.frames} frames, {state}", markup=False)
    _print_findings("bad", verification.bad)
    _print_findings("left over", verification.leftovers)


def _print_findings(title: str, findings: Sequence["Finding"]) -> None:
    for finding in findings:
        results().print(f"  {title}: {finding.file}: {finding.problem}", markup=False)
