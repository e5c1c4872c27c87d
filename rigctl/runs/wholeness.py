"""Wholeness of a run: held against what its session has noted of itself, it is whole, unfinished or damaged."""

import hashlib
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rigctl.errors import RunFolderError
from rigctl.runs.annotations import (
    annotated,
    annotation_problems,
    exclusion_remark,
    read_annotation_lines,
)
from rigctl.runs.run_description import SESSION_FILE, RunDescription
from rigctl.runs.run_events import EVENTS_FILE, RunEvent, closed_with, journal_problems, read_journal, sound_events
from rigctl.runs.run_folder import (
    ANNOTATIONS_FILE,
    INPUTS_FOLDER,
    MANIFEST_FILE,
    Contents,
    Run,
    read_contents,
    read_run,
)
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded

State = Literal["whole", "unfinished", "damaged"]
_CLOSING_OF_OLD = ("finished", "imported")
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Wholeness:
    """Wholeness of a run, its frames apart.

    Attributes
    ----------
    state : {"whole", "unfinished", "damaged"}
        Whole is: every check holds, and the session has noted its end over these very frames.
    problems : tuple of (file, problem)
        What is damaged.
    unchecked : tuple of str
        What cannot be checked, since an older program made the run.
    """

    state: State
    problems: tuple[tuple[str, str], ...]
    unchecked: tuple[str, ...] = ()


def used_run(path: Path, *, ignore_exclusions: bool = False) -> Run:
    """Return a run whose frames are to become numbers, without those that people have excluded.

    What is not whole about it, and which frames are left out, is said in the log. `ignore_exclusions` keeps the
    excluded frames.

    Raises
    ------
    RunFolderError
        As `read_run`: a line, a frame or the session file is damaged or gone; or the annotations are damaged.
    """
    run = read_run(path)
    used = annotated(run, ignore_exclusions=ignore_exclusions)
    for remark in (wholeness_remark(run), exclusion_remark(used)):
        if remark is not None:
            _LOG.warning("%s", remark)
    return used


def wholeness_remark(run: Run) -> str | None:
    """Return in words what is not whole about a run; None where nothing is. Its frames are not looked into."""
    found = wholeness(run.path, read_contents(run.path))
    if found.state == "unfinished":
        return f"{run.path} is unfinished: {len(run.frames)} frames so far; `rigctl resume` goes on"
    if found.state == "damaged":
        text = "; ".join(f"{file}: {problem}" for file, problem in found.problems)
        return f"{run.path} is damaged, and its numbers are not to be trusted: {text}; see `rigctl verify`"
    return None


def wholeness(path: Path, contents: Contents) -> Wholeness:
    """Return how whole a run is, its frames apart: session file, manifest, events and inputs.

    Parameters
    ----------
    path : Path
        The run folder.
    contents : Contents
        What it holds.
    """
    problems = list(contents.problems)
    events: list[RunEvent] = []
    try:
        journal = read_journal(path)
        problems += [(EVENTS_FILE, text) for text in journal_problems(journal)]
        events = [event for _, event in sound_events(journal)]
        is_torn = journal.is_torn
    except RunFolderError as error:
        problems.append((EVENTS_FILE, str(error)))
        is_torn = False
    problems += [(ANNOTATIONS_FILE, text) for text in annotation_problems(read_annotation_lines(path))]
    description = contents.description
    if description is None:
        return Wholeness(state="damaged", problems=tuple(problems))
    keeps_none = not description.is_sealed and not (path / INPUTS_FOLDER).exists()
    if not keeps_none:
        problems += _input_problems(path, description, any_frames=bool(contents.frames))
    if description.is_sealed:
        is_closed, contradictions = _closing(events, contents)
        unchecked: tuple[str, ...] = ()
    else:
        is_closed, contradictions = _closing_of_old(events, description), []
        unchecked = (f"{MANIFEST_FILE}, {EVENTS_FILE} and {SESSION_FILE} carry no checksums: {description.created_by}",)
        if keeps_none and _stated_inputs(description):
            # The first programs kept none; a folder that was taken away later looks the same.
            unchecked += (f"{INPUTS_FOLDER}/ is not there: the program that made the run kept no copy of its files",)
    problems += contradictions
    if is_closed and (contents.torn_manifest_line or is_torn):
        problems.append((EVENTS_FILE if is_torn else MANIFEST_FILE, "goes on after the session had finished"))
    if problems:
        return Wholeness(state="damaged", problems=tuple(problems), unchecked=unchecked)
    return Wholeness(state="whole" if is_closed else "unfinished", problems=(), unchecked=unchecked)


def _closing(events: list[RunEvent], contents: Contents) -> tuple[bool, list[tuple[str, str]]]:
    """Return whether the last word of the events closes these very frames, and what contradicts that."""
    closings = [(place, closed) for place, event in enumerate(events) if (closed := closed_with(event)) is not None]
    if not closings:
        return False, []
    place, (frames, link) = closings[-1]
    links = contents.links
    if links and links[-1] == link:
        return True, []
    # A kill after the next frames were named, before they were closed, or while a session that had finished goes on.
    is_later = len(links) > frames and links[frames] == link
    if is_later or any(event.event == "resumed" for event in events[place + 1 :]):
        return False, []
    text = f"the session closed with {frames} frames, and these are others: {len(contents.frames)} are named"
    return False, [(MANIFEST_FILE, text)]


def _closing_of_old(events: list[RunEvent], description: RunDescription) -> bool:
    return not description.record.is_of_session or any(event.event in _CLOSING_OF_OLD for event in events)


def _input_problems(path: Path, description: RunDescription, *, any_frames: bool) -> list[tuple[str, str]]:
    """Return which of the files that the run was made from are not those that it was made from."""
    problems = []
    for what, stated in _stated_inputs(description).items():
        name = f"{INPUTS_FOLDER}/{what}.toml"
        try:
            found = hashlib.sha256(read_bounded(path / name, MOST_RECORD_BYTES)).hexdigest()
        except FileNotFoundError:
            # Once they were written after the session file: a kill in between left a run without frames and them.
            if any_frames:
                problems.append((name, "missing"))
            continue
        except OSError as error:
            problems.append((name, f"cannot be read: {error.strerror}"))
            continue
        if found != stated.removeprefix("sha256:"):
            problems.append((name, "damaged or edited: its checksum is not the one of the session file"))
    return problems


def _stated_inputs(description: RunDescription) -> dict[str, str]:
    """Return the checksums of the inputs by what they are, as the session file has them."""
    files = description.session.get("files")
    if not isinstance(files, dict):
        return {}
    found = {what: entry.get("sha256") for what, entry in files.items() if isinstance(entry, dict)}
    return {what: value for what, value in found.items() if isinstance(value, str)}
