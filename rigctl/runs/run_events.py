"""The file ``events.jsonl`` of a run folder: what happened, and when."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from rigctl.errors import RunFolderError
from rigctl.runs.run_description import explain_invalid

EVENTS_FILE = "events.jsonl"
TALLY_EVENT = "camera tally"
"""Counts of a camera's pictures, at the end of each part of a session."""
_UTC_DIGITS = 19


@dataclass(frozen=True, kw_only=True)
class RunEvent:
    """Something that happened.

    Attributes
    ----------
    id : int or None
        Its place in the file, from 0.
    utc : str
        When, as ``rigctl.utc_time.utc_text`` writes it.
    monotonic_ns : int or None
        The same by the host's monotonic clock [ns].
    event : str
        Its name, a word or two.
    facts : dict
        What else was noted, as JSON can hold it.
    """

    id: int | None = None
    utc: str = ""
    monotonic_ns: int | None = None
    event: str
    facts: dict[str, Any] = field(default_factory=dict)


_EVENT = TypeAdapter(RunEvent)


def read_events(path: Path) -> list[RunEvent]:
    """Return the events of a run folder, without a last line that was never finished.

    Raises
    ------
    RunFolderError
        A line is no event.
    """
    file = path / EVENTS_FILE
    whole = file.read_bytes().rpartition(b"\n")[0] if file.exists() else b""
    try:
        return [_EVENT.validate_json(line) for line in whole.splitlines()]
    except ValidationError as error:
        raise RunFolderError(f"{file}: a line is no event: {explain_invalid(error)}") from error


def event_line(event: RunEvent) -> str:
    """Return an event as a line that a person reads: when, what, and what is known of it."""
    return f"{event.utc[:_UTC_DIGITS]}Z  {event.event:<14}  {event_facts(event)}".rstrip()


def event_facts(event: RunEvent) -> str:
    """Return what is known of an event in words."""
    return "; ".join(f"{name.replace('_', ' ')}: {_said(value)}" for name, value in event.facts.items())


def _said(value: object) -> str:
    if value is None:
        return "not known"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_said(one)}" for name, one in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_said, value)) or "none"
    return str(value)
