"""Verification of a run: its files against their checksums, and its frames against what its session planned."""

from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from rigctl.errors import ConfigError, DataError
from rigctl.files.session_file import SessionFile
from rigctl.runs.run_description import RunDescription
from rigctl.runs.run_events import read_events
from rigctl.runs.run_folder import read_contents
from rigctl.runs.verification import Finding, Verification, Watch, verify_run
from rigctl.session.planning.session_steps import Step, plan_steps

_LEFT_OUT = ("round missed", "time is up")
_PLAN = "plan"


def verify(path: Path, *, watch: Watch = iter) -> Verification:
    """Return what is wrong with a run folder, as `verify_run` does, and which steps of its plan have no frame."""
    found = verify_run(path, watch=watch)
    contents = read_contents(path)
    if contents.description is None or not contents.description.record.is_of_session:
        return found
    try:
        steps = _planned(contents.description)
    except (ValidationError, ConfigError, DataError):
        return replace(
            found, unchecked=(*found.unchecked, "what was planned: the session is none that this program knows")
        )
    taken = {record.sequence for record in contents.frames}
    gaps = tuple(f"step {step.sequence} ({_named(step)}) has no frame" for step in steps if step.sequence not in taken)
    # A run with a chain that holds has just the frames that it closed with. An old one has only its plan to tell.
    if gaps and found.state == "whole" and not contents.description.is_sealed and not _left_some_out(path):
        bad = Finding(file=_PLAN, problem=f"the session finished, and {len(gaps)} of {len(steps)} steps have no frame")
        found = replace(found, ok=False, state="damaged", bad=(*found.bad, bad))
    return replace(found, gaps=gaps)


def _planned(description: RunDescription) -> tuple[Step, ...]:
    session, record = SessionFile.model_validate(description.session["session"]), description.record
    return plan_steps(session, record.rounds_ns, cell_deg=record.cell_deg)


def _left_some_out(path: Path) -> bool:
    return any(event.event in _LEFT_OUT for event in read_events(path))


def _named(step: Step) -> str:
    angle = "" if step.polarizer_angle_deg is None else f", {step.polarizer_angle_deg:g} deg"
    return f"{step.kind}, cycle {step.cycle}{angle}"
