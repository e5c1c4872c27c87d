"""The file ``events.jsonl`` of a run folder: what happened, and when."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import JsonValue, TypeAdapter, ValidationError

from rigctl.errors import DataError, RunFolderError
from rigctl.runs.run_description import SESSION_FILE, explain_invalid, first_link, read_description
from rigctl.runs.sealed_lines import Lines, first_link_of, journal_bytes, read_lines

EVENTS_FILE = "events.jsonl"
METERED_EVENT = "metered"
HOST_CLOCK_EVENT = "host clock"
TALLY_EVENT = "camera tally"
"""Counts of a camera's pictures, at the end of each part of a session."""
_UTC_DIGITS = 19
_FRAMES_FACT = "frames_in_run"
_CHAIN_FACT = "manifest_chain_sha256"


@dataclass(frozen=True, kw_only=True)
class RunEvent:
    """Something that happened.

    Attributes
    ----------
    id : int or None
        Its place in the file, from 0.
    utc : str
        When, as ``rigctl.numbers.utc_time.utc_text`` writes it.
    monotonic_ns : int or None
        The same by the host's monotonic clock [ns].
    event : str
        Its name, a word or two.
    facts : mapping
        What else was noted, as JSON can hold it.
    """

    id: int | None = None
    utc: str = ""
    monotonic_ns: int | None = None
    event: str
    facts: dict[str, JsonValue] = field(default_factory=dict)


_EVENT = TypeAdapter(RunEvent)


@dataclass(frozen=True, kw_only=True)
class Metered:
    """Facts of the event that notes a metered exposure.

    Attributes
    ----------
    round : int
        Of the schedule.
    exposure_s : float
        What was chosen for it [s].
    next_camera_frame : int or None
        Number that the camera gives to its next picture; None where it counts none.
    """

    round: int
    exposure_s: float
    next_camera_frame: int | None = None


_METERED = TypeAdapter(Metered)


def metered_exposures(events: Iterable[RunEvent]) -> tuple[Metered, ...]:
    """Return the exposures that were metered in a session.

    Raises
    ------
    RunFolderError
        An event says so, and not what.
    """
    try:
        return tuple(_METERED.validate_python(event.facts) for event in events if event.event == METERED_EVENT)
    except ValidationError as error:
        raise RunFolderError(f"{EVENTS_FILE}: a metered exposure: {explain_invalid(error)}") from error


def host_clock_text(events: Iterable[RunEvent]) -> str | None:
    """Return how well the machine's clock was synchronised when a session began; None where that was not noted."""
    found = next((event for event in events if event.event == HOST_CLOCK_EVENT), None)
    if found is None:
        return None
    error_s = found.facts.get("utc_error_s")
    if not isinstance(error_s, float | int):
        return "this machine's clock was not synchronised: how far from UTC it was is not known"
    return f"this machine's clock was within {error_s * 1e3:.3g} ms of UTC, as its time service says"


def pictures_lost(events: Iterable[RunEvent]) -> tuple[str, ...]:
    """Return what became of pictures and their packets on the way from the camera; nothing where it counts none."""
    sums: Counter[str] = Counter()
    for event in events:
        if event.event == TALLY_EVENT:
            sums.update({name: int(count) for name, count in event.facts.items() if isinstance(count, int)})
    if not sums:
        return ()
    pictures = (
        f"Of the camera's pictures {sums['accepted']} were taken; {sums['damaged']} were damaged, {sums['too_old']} "
        f"began too early, {sums['never_came']} never came. The connection was made anew {sums['reopened']} times."
    )
    if not sums["packets"]:
        return (pictures,)
    share = 100.0 * sums["packets_lost"] / sums["packets"]
    packets = (
        f"The network lost {share:.2g} % of their packets ({sums['packets_lost']} of {sums['packets']}); "
        f"{sums['packets_resent']} of these came when they were asked for again."
    )
    return (pictures, packets)


def read_events(path: Path) -> list[RunEvent]:
    """Return the events of a run folder, without a last line that was never finished.

    Raises
    ------
    RunFolderError
        A line is no event, or is not the one that was written.
    """
    file = path / EVENTS_FILE
    journal = read_journal(path)
    problems = journal_problems(journal)
    if problems:
        raise RunFolderError(f"{file}: " + "; ".join(problems))
    return [_EVENT.validate_json(line.content) for line in journal.lines]


def read_journal(path: Path) -> Lines:
    """Return the lines of a run folder's events, each held against its seal; none where there is no such file.

    Raises
    ------
    RunFolderError
        The file cannot be read.
    """
    data = journal_bytes(path / EVENTS_FILE)
    try:
        first = first_link(read_description(path / SESSION_FILE))
    except DataError:
        first = first_link_of(data)
    return read_lines(data, first)


def journal_problems(journal: Lines) -> list[str]:
    """Return what is wrong with the events of a run, line by line."""
    problems = [f"line {number}: {line.problem}" for number, line in enumerate(journal.lines, start=1) if line.problem]
    for number, line in enumerate(journal.lines, start=1):
        try:
            if line.content:
                _EVENT.validate_json(line.content)
        except ValidationError as error:
            problems.append(f"line {number} is no event: {explain_invalid(error)}")
    return problems


def sound_events(journal: Lines) -> list[tuple[bytes, RunEvent]]:
    """Return those lines that are sound by themselves, and what they say."""
    found = []
    for line in journal.lines:
        try:
            if line.content:
                found.append((line.content, _EVENT.validate_json(line.content)))
        except ValidationError:
            continue
    return found


def closing_facts(*, frames: int, link: str | None) -> dict[str, JsonValue]:
    """Return what the event that closes a run says of its manifest; nothing in an old run, which has no chain."""
    return {} if link is None else {_FRAMES_FACT: frames, _CHAIN_FACT: link}


def closed_with(event: RunEvent) -> tuple[int, str] | None:
    """Return how many frames an event has closed a run with, and their chain; None where it is no such event."""
    frames, link = event.facts.get(_FRAMES_FACT), event.facts.get(_CHAIN_FACT)
    return (frames, link) if isinstance(frames, int) and isinstance(link, str) else None


def event_line(event: RunEvent) -> str:
    """Return an event as a line that a person reads: when, what, and what is known of it."""
    return f"{event.utc[:_UTC_DIGITS]}Z  {event.event:<14}  {event_facts(event)}".rstrip()


def event_facts(event: RunEvent) -> str:
    """Return what is known of an event in words."""
    told = {name: value for name, value in event.facts.items() if name not in (_FRAMES_FACT, _CHAIN_FACT)}
    return "; ".join(f"{name.replace('_', ' ')}: {_said(value)}" for name, value in told.items())


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
