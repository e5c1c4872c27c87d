"""Checks if a run is whole, unfinished or damaged, and repairs it after a kill.

`wholeness` reads session file, manifest, events and inputs; `verify_run` also reads every frame and its checksum.
`repair_run` adopts whole frames and sets damaged ones aside; it deletes nothing.
"""

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rigctl.base.durable import (
    MOST_OWN_FRAME_BYTES,
    MOST_RECORD_BYTES,
    PART_SUFFIX,
    flush_folder,
    read_bounded,
    write_durably,
)
from rigctl.console import warn
from rigctl.errors import DataError, RunFolderError
from rigctl.runs.fits import decode_record
from rigctl.runs.folder import (
    ANNOTATIONS_FILE,
    FRAMES_FOLDER,
    INPUTS_FOLDER,
    MANIFEST_FILE,
    Contents,
    Run,
    RunLock,
    annotated,
    annotation_problems,
    exclusion_remark,
    file_checksum,
    read_annotation_lines,
    read_contents,
    read_frame,
    run_of,
)
from rigctl.runs.records import (
    EVENTS_FILE,
    EXPOSURE_PARTS,
    SESSION_FILE,
    FrameRecord,
    RunDescription,
    RunEvent,
    closed_with,
    first_link,
    journal_problems,
    read_journal,
    sealed_all,
    sound_events,
)
from rigctl.runs.writer import json_line

DAMAGED_FOLDER = "damaged"
_WHOLE = "a whole frame missing from the manifest: not acknowledged"
State = Literal["whole", "unfinished", "damaged"]
Watch = Callable[[Sequence[FrameRecord]], Iterable[FrameRecord]]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A finding about one file of a run folder."""

    file: str  #: Path relative to the run folder.
    problem: str


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Findings of a verification."""

    ok: bool  #: Nothing is bad.
    frames: int  #: Number of frames in the manifest.
    bad: tuple[Finding, ...]  #: Damaged, missing, or contradicting files.
    leftovers: tuple[Finding, ...]  #: Files of a killed writer, never acknowledged.
    state: State = "whole"  #: Whole: nothing is bad, and the session has ended with exactly these frames.
    gaps: tuple[str, ...] = ()  #: Steps of the session's plan without a frame.
    unchecked: tuple[str, ...] = ()  #: Parts that this program cannot check.


def verify_run(path: Path, *, watch: Watch = iter) -> Verification:
    """Check a run folder with all its frames; the plan of its session is not compared."""
    contents = read_contents(path)
    state, problems = wholeness(path, contents)
    bad = [Finding(file=file, problem=problem) for file, problem in problems]
    for record in watch(contents.frames):
        bad += [Finding(file=record.file, problem=text) for text in frame_problems(path, record)]
    unnamed = _unnamed_files(path, contents.frames)
    damaged = {file: problem for file in unnamed if (problem := _unnamed_problem(path, file))}
    bad += [Finding(file=file, problem=problem) for file, problem in damaged.items()]
    leftovers = [_leftover(file) for file in unnamed if file not in damaged]
    if contents.torn_manifest_line:
        leftovers.append(Finding(file=MANIFEST_FILE, problem="its last line has no end: not acknowledged"))
    bad += _too_many(contents, state, [finding for finding in leftovers if finding.problem == _WHOLE])
    return Verification(
        ok=not bad,
        frames=len(contents.frames),
        bad=tuple(bad),
        leftovers=tuple(leftovers),
        state="damaged" if bad else state,
    )


def frame_problems(path: Path, record: FrameRecord) -> list[str]:
    """Return the problems of the file of one frame in the manifest."""
    if not (path / record.file).is_file():
        return ["missing"]
    try:
        read_frame(path, record)
    except DataError as error:
        return [str(error)]
    return []


@dataclass(frozen=True, kw_only=True)
class Repair:
    """Changes that a repair made to a run folder."""

    adopted: tuple[Finding, ...]  #: Whole frames that were added to the manifest.
    set_aside: tuple[Finding, ...]  #: Files that are not whole frames of this run, moved to ``damaged``.
    frames: tuple[FrameRecord, ...]  #: Frames of the manifest; every checksum holds.


def repair_run(path: Path) -> Repair:
    """Repair a run, so that each frame of the manifest is whole and each whole frame is in the manifest.

    An intact folder is left unchanged. A manifest with damaged lines is made again from the frames. Nothing is deleted:
    damaged files are moved for inspection.
    """
    contents = read_contents(path)
    if contents.description is None:
        problem = dict(contents.problems).get(SESSION_FILE, "is missing")
        raise RunFolderError(f"{path / SESSION_FILE}: {problem}: the plan of the session is not known")
    if contents.begins_elsewhere and _is_of_other_session(path):
        raise RunFolderError(f"{path / SESSION_FILE}: belongs to another run than manifest and events")
    try:
        lock = RunLock(path)
        try:
            return _Repairer(path, first_link(contents.description)).repair(read_contents(path))
        finally:
            lock.release()
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be repaired: {error.strerror}") from error


def run_to_measure(path: Path, *, ignore_exclusions: bool = False) -> Run:
    """Return a run for measurement, without excluded frames.

    Problems of the run and excluded frames are reported as warnings. `ignore_exclusions` keeps the excluded frames.
    """
    used, remarks = run_with_remarks(path, ignore_exclusions=ignore_exclusions)
    for remark in remarks:
        warn(remark)
    return used


def run_with_remarks(path: Path, *, ignore_exclusions: bool) -> tuple[Run, tuple[str, ...]]:
    """Return a run without its excluded frames, and in words what is wrong with it and which frames are excluded."""
    contents = read_contents(path)
    used = annotated(run_of(path, contents), ignore_exclusions=ignore_exclusions)
    remarks = _wholeness_remark(used, contents), exclusion_remark(used)
    return used, tuple(remark for remark in remarks if remark is not None)


def _wholeness_remark(run: Run, contents: Contents) -> str | None:
    """Return a warning if a run is not whole; None if it is. The frames are not read."""
    state, problems = wholeness(run.path, contents)
    if state == "unfinished":
        return f"{run.path} is unfinished: {len(contents.frames)} frames so far; `rigctl resume` continues"
    if state == "damaged":
        text = "; ".join(f"{file}: {problem}" for file, problem in problems)
        return f"{run.path} is damaged, and its numbers are unreliable: {text}; see `rigctl verify`"
    unused = _unnamed_files(run.path, contents.frames)
    if unused:
        return f"{run.path}: {', '.join(unused[:3])}: {len(unused)} files missing from the manifest are not used"
    return None


def wholeness(path: Path, contents: Contents) -> tuple[State, list[tuple[str, str]]]:
    """Return the state of a run without reading its frames, and the problems of session file, manifest, events, inputs.

    A run is whole if every check holds and the session ended with exactly these frames.
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
        return "damaged", problems
    problems += _input_problems(path, description, any_frames=bool(contents.frames))
    is_closed, contradictions = _closing(events, contents)
    problems += contradictions
    if is_closed and (contents.torn_manifest_line or is_torn):
        problems.append((EVENTS_FILE if is_torn else MANIFEST_FILE, "continues after the session had finished"))
    if problems:
        return "damaged", problems
    return "whole" if is_closed else "unfinished", []


def _closing(events: list[RunEvent], contents: Contents) -> tuple[bool, list[tuple[str, str]]]:
    """Return whether the last closing event is about exactly these frames, and contradictions."""
    closings = [(place, closed) for place, event in enumerate(events) if (closed := closed_with(event)) is not None]
    if not closings:
        return False, []
    place, (frames, link) = closings[-1]
    links = contents.links
    if links and links[-1] == link:
        return True, []
    # A kill after more frames were added and before the run was closed, or while a finished session is resumed.
    is_later = len(links) > frames and links[frames] == link
    if is_later or any(event.event == "resumed" for event in events[place + 1 :]):
        return False, []
    text = f"the session closed with {frames} other frames; the manifest has {len(contents.frames)}"
    return False, [(MANIFEST_FILE, text)]


def _input_problems(path: Path, description: RunDescription, *, any_frames: bool) -> list[tuple[str, str]]:
    """Return the input files that are missing or differ from those of the session."""
    problems = []
    for what, stated in _stated_inputs(description).items():
        name = f"{INPUTS_FOLDER}/{what}.toml"
        try:
            found = hashlib.sha256(read_bounded(path / name, MOST_RECORD_BYTES)).hexdigest()
        except FileNotFoundError:
            # A kill before they are written leaves a run without frames.
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
    """Return the checksums of the inputs in the session file, by kind."""
    files = description.session.get("files")
    if not isinstance(files, dict):
        return {}
    found = {what: entry.get("sha256") for what, entry in files.items() if isinstance(entry, dict)}
    return {what: value for what, value in found.items() if isinstance(value, str)}


def _too_many(contents: Contents, state: State, whole: list[Finding]) -> list[Finding]:
    """Return a finding if more whole frames lack a line than a kill can cause."""
    description = contents.description
    if description is None or not whole:
        return []
    if state == "whole":
        return [Finding(file=finding.file, problem="not of this run, which has finished") for finding in whole]
    may_be_left = 1 if description.record.cell_deg is None else EXPOSURE_PARTS
    if len(whole) > may_be_left and description.record.is_of_session:
        text = f"{len(whole)} whole frames have no line, and a kill causes at most {may_be_left}: lines were removed"
        return [Finding(file=MANIFEST_FILE, problem=text)]
    return []


def _unnamed_files(path: Path, frames: Iterable[FrameRecord]) -> list[str]:
    named = {record.file for record in frames}
    present = sorted((path / FRAMES_FOLDER).rglob("*")) + sorted(path.glob(f"*{PART_SUFFIX}"))
    files = [file.relative_to(path).as_posix() for file in present if file.is_file()]
    return [file for file in files if file not in named]


def _unnamed_problem(path: Path, file: str) -> str | None:
    if file.endswith(PART_SUFFIX):
        return None
    try:
        data = read_bounded(path / file, MOST_OWN_FRAME_BYTES)
        decode_record(data, file=file, checksum=file_checksum(data))
    except (DataError, OSError) as error:
        text = error.strerror if isinstance(error, OSError) else error
        return f"not in the manifest, and not a whole frame: {text}"
    return None


def _leftover(file: str) -> Finding:
    if file.endswith(PART_SUFFIX):
        return Finding(file=file, problem="begun and not finished")
    return Finding(file=file, problem=_WHOLE)


def _is_of_other_session(path: Path) -> bool:
    journal = read_journal(path)
    return journal.begins_elsewhere or not journal.lines


class _Repairer:
    def __init__(self, path: Path, link: str) -> None:
        self._path, self._first_link = path, link
        self._frames: dict[int, FrameRecord] = {}
        self._adopted: list[Finding] = []
        self._set_aside: list[Finding] = []

    def repair(self, contents: Contents) -> Repair:
        for record in contents.frames:
            self._check(record)
        for file in self._unnamed():
            self._adopt(file)
        self._set_parts_aside()
        frames = tuple(self._frames[sequence] for sequence in sorted(self._frames))
        if frames != contents.frames or contents.problems or contents.torn_manifest_line:
            lines = sealed_all((json_line(record) for record in frames), self._first_link)
            write_durably(self._path / MANIFEST_FILE, lines)
        self._mend_events()
        return Repair(adopted=tuple(self._adopted), set_aside=tuple(self._set_aside), frames=frames)

    def _set_parts_aside(self) -> None:
        """Set aside the parts of an incomplete exposure, which is taken again."""
        parts = Counter(record.exposure_id for record in self._frames.values())
        for record in list(self._frames.values()):
            if record.exposure_id is not None and parts[record.exposure_id] < EXPOSURE_PARTS:
                del self._frames[record.sequence]
                self._adopted = [finding for finding in self._adopted if finding.file != record.file]
                self._move_aside(record.file, "other frames of the same exposure are missing")

    def _mend_events(self) -> None:
        """Keep the valid events; the damaged file is set aside for inspection."""
        journal = read_journal(self._path)
        if not journal_problems(journal):
            return
        text = "; ".join(journal_problems(journal))
        contents = [content for content, _ in sound_events(journal)]
        self._move_aside(EVENTS_FILE, text)
        write_durably(self._path / EVENTS_FILE, sealed_all(contents, self._first_link))

    def _check(self, record: FrameRecord) -> None:
        problems = frame_problems(self._path, record)
        if not problems and record.sequence not in self._frames:
            self._frames[record.sequence] = record
        elif (self._path / record.file).exists() and problems:
            self._move_aside(record.file, "; ".join(problems))
        elif problems:
            self._set_aside.append(Finding(file=record.file, problem="missing"))

    def _unnamed(self) -> Iterable[Path]:
        named = {record.file for record in self._frames.values()}
        files = sorted((self._path / FRAMES_FOLDER).iterdir()) + sorted(self._path.glob(f"*{PART_SUFFIX}"))
        return [file for file in files if file.relative_to(self._path).as_posix() not in named]

    def _adopt(self, file: Path) -> None:
        name = file.relative_to(self._path).as_posix()
        final = name.removesuffix(PART_SUFFIX)
        try:
            data = read_bounded(file, MOST_OWN_FRAME_BYTES)
            record, _ = decode_record(data, file=final, checksum=file_checksum(data))
        except (DataError, OSError) as error:
            self._move_aside(name, str(error))
            return
        if record.sequence in self._frames:
            self._move_aside(name, f"frame {record.sequence} is in this run already")
            return
        _make_final(file, self._path / final)
        self._frames[record.sequence] = record
        self._adopted.append(Finding(file=final, problem="whole, but missing from the manifest"))

    def _move_aside(self, name: str, problem: str) -> None:
        folder = self._path / DAMAGED_FOLDER
        folder.mkdir(exist_ok=True)
        source = self._path / name
        taken = sum(1 for file in folder.iterdir() if file.name.startswith(source.name))
        source.replace(folder / (f"{source.name}.{taken}" if taken else source.name))
        flush_folder(folder)
        flush_folder(source.parent)
        self._set_aside.append(Finding(file=name, problem=problem))


def _make_final(file: Path, final: Path) -> None:
    """Give a whole file its final name; a killed writer may not have flushed it."""
    descriptor = os.open(file, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    file.replace(final)
    flush_folder(final.parent)
