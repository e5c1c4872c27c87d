"""`rigctl verify`: checks whether a run is complete, unfinished or damaged."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.console import EXIT_DATA, EXIT_INCOMPLETE, Json
from rigctl.verbs.options import Part, Result, RunPath

if TYPE_CHECKING:
    from rigctl.runs.check import Verification, Watch
    from rigctl.runs.records import FrameRecord, RunDescription
    from rigctl.session.plan import Step

_MOST_GAPS = 20


def verify(run: RunPath, /) -> "VerifiedRun":
    """Check every checksum of a run, its manifest against the frames, and the frames against what was planned.

    The exit code is 0 if the run is complete, 75 if it is unfinished, and 4 if anything is damaged, missing or
    contradictory. Planned steps without a frame are listed. Files that an interrupted session left behind are listed as
    left over; they do no harm.

    Example: rigctl verify runs/2026-05-04

    Parameters
    ----------
    run : path or Run
        Run folder.
    """
    path = Path(run)
    return VerifiedRun(path, verification_of(path, watch=_with_progress))


@dataclass(frozen=True)
class VerifiedRun(Result):
    """State and problems of a run."""

    run: Path
    verification: "Verification"

    @property
    def exit_code(self) -> int:
        """4 if the run is damaged, 75 if it is unfinished."""
        return {"damaged": EXIT_DATA, "unfinished": EXIT_INCOMPLETE}.get(self.verification.state, 0)

    def content(self) -> Iterable[Part]:
        """Return the state, then each finding, missing step and check that was not possible."""
        found = self.verification
        state = {
            "whole": "whole",
            "unfinished": "sound so far, UNFINISHED",
            "damaged": f"DAMAGED: {len(found.bad)} bad of the frames and their files",
        }
        yield f"{self.run}: {found.frames} frames, {state[found.state]}"
        yield from (f"  bad: {finding.file}: {finding.problem}" for finding in found.bad)
        yield from (f"  left over: {finding.file}: {finding.problem}" for finding in found.leftovers)
        yield from (f"  missing: {gap}" for gap in found.gaps[:_MOST_GAPS])
        if len(found.gaps) > _MOST_GAPS:
            yield f"  missing: {len(found.gaps) - _MOST_GAPS} more steps"
        yield from (f"  not checked: {text}" for text in found.unchecked)

    def as_json(self) -> dict[str, Json]:
        """Return the fields of the verification."""
        return asdict(self.verification)


def _with_progress(frames: "Sequence[FrameRecord]") -> "Iterable[FrameRecord]":
    from rich.progress import track

    from rigctl.console import progress

    return track(frames, description="verifying", console=progress(), transient=True)


def verification_of(path: Path, *, watch: "Watch" = iter) -> "Verification":
    """Check a run folder, and list the steps of its plan without a frame.

    `watch` takes the records of the frames and yields them one by one as they are checked.
    """
    from pydantic import ValidationError

    from rigctl.errors import ConfigError, DataError
    from rigctl.runs.check import verify_run
    from rigctl.runs.folder import read_contents

    found = verify_run(path, watch=watch)
    contents = read_contents(path)
    if contents.description is None or not contents.description.record.is_of_session:
        return found
    try:
        steps = _planned(contents.description)
    except (ValidationError, ConfigError, DataError):
        return replace(
            found, unchecked=(*found.unchecked, "the plan: this version of the program does not know such a session")
        )
    taken = {record.sequence for record in contents.frames}
    gaps = tuple(f"step {step.sequence} ({_named(step)}) has no frame" for step in steps if step.sequence not in taken)
    return replace(found, gaps=gaps)


def _planned(description: "RunDescription") -> "tuple[Step, ...]":
    from rigctl.files.session_file import SessionFile
    from rigctl.session.plan import plan_steps

    session, record = SessionFile.model_validate(description.session["session"]), description.record
    return plan_steps(session, record.rounds_ns, cell_deg=record.cell_deg)


def _named(step: "Step") -> str:
    angle = "" if step.polarizer_angle_deg is None else f", {step.polarizer_angle_deg:g} deg"
    return f"{step.kind}, cycle {step.cycle}{angle}"
