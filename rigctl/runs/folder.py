"""Reads a run folder, also while it grows; annotations of people; journals and locks.

::

    RUN/session.json      the resolved session, versions, schema version
    RUN/inputs/*.toml     the files of the session
    RUN/frames/*.fits     one frame each, with its complete record in the header
    RUN/manifest.jsonl    one line per frame, appended once the frame is on the disk
    RUN/events.jsonl      events of the session with their times
    RUN/annotations.jsonl notes of people, and frames that they exclude

The manifest is the table of contents of the frames and can be made again from them. Journals only grow, each line on
the disk before the next. A lock that ends with its process excludes a second writer.
"""

import fcntl
import hashlib
import json
import os
import re
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from pydantic import JsonValue, TypeAdapter, ValidationError

from rigctl.base.durable import (
    MOST_OWN_FRAME_BYTES,
    MOST_RECORD_BYTES,
    MOST_TEXT_BYTES,
    flush_folder,
    open_plain,
    read_bounded,
    read_for_now,
    write_durably,
)
from rigctl.errors import ConfigError, DataError, RunFolderError
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.files.toml import describe
from rigctl.runs.fits import decode_record
from rigctl.runs.records import (
    FRAME_RECORD,
    SESSION_FILE,
    UNKNOWN_LINK,
    Annotation,
    FrameRecord,
    Lines,
    RunDescription,
    SessionRecord,
    excluded_frames,
    exclusions_text,
    explain_invalid,
    first_link,
    journal_bytes,
    read_description,
    read_lines,
    sealed,
)

MANIFEST_FILE = "manifest.jsonl"
FRAMES_FOLDER = "frames"
INPUTS_FOLDER = "inputs"
ANNOTATIONS_FILE = "annotations.jsonl"
LOCK_FILE = "writer.lock"
_LOOKS, _LOOK_S = 10, 0.01
# A card has 80 bytes; our headers do not have thousands of cards.
_SAMPLE_BYTES, _MOST_HEADER_BYTES = 4, 1_000_000
_MOST_BYTES_A_LOOK = 64_000_000
_ANNOTATION = TypeAdapter(Annotation)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run folder's table of contents."""

    path: Path  #: The folder.
    session: SessionRecord  #: Its origin.
    session_json: dict[str, JsonValue]  #: The whole description: rig, session, versions, hashes.
    frames: tuple[FrameRecord, ...]  #: In the order of their sequence numbers.
    created_by: str  #: Program and version that made the folder.
    created_utc: str  #: When it was made.
    excluded: tuple[FrameRecord, ...] = ()  #: Excluded frames; they are not among `frames`.
    annotations: tuple[Annotation, ...] = ()  #: Notes of people.
    #: Sequence numbers of frames whose polarizer angle was recalibrated to the angle that their files state [deg].
    written_angles_deg: Mapping[int, float | None] = field(default_factory=dict)

    def counts(self, record: FrameRecord) -> NDArray[Any]:
        """Return the samples of a frame after checking its checksum."""
        if record.sequence in self.written_angles_deg:
            record = replace(record, polarizer_angle_deg=self.written_angles_deg[record.sequence])
        return read_frame(self.path, record)


def read_run(path: Path) -> Run:
    """Return the table of contents of a run folder; the frames themselves are not opened.

    A killed writer leaves a last line of the manifest without an end; it is skipped, since its frame was never
    acknowledged. ``rigctl verify`` reports it.
    """
    return run_of(path, read_contents(path))


def run_of(path: Path, contents: "Contents") -> Run:
    """Return a run folder whose contents were read; RunFolderError if they are damaged."""
    problems = [f"{file}: {problem}" for file, problem in contents.problems]
    problems += [f"{r.file}: missing" for r in contents.frames if not (path / r.file).is_file()]
    description = contents.description
    if problems or description is None:
        raise RunFolderError(f"{path} cannot be used as a run folder:\n  " + "\n  ".join(problems))
    return _run(path, description, contents.frames)


def read_frame(path: Path, record: FrameRecord) -> NDArray[Any]:
    """Return the samples of a frame, if its checksum and its header agree with its line in the manifest."""
    stated, counts = decode_record(_checked(path, record), file=record.file, checksum=record.checksum)
    if stated != record:
        other = [f.name for f in fields(record) if getattr(record, f.name) != getattr(stated, f.name)]
        raise RunFolderError(f"{path / record.file}: manifest and header contradict each other: {', '.join(other)}")
    return counts


def annotated(run: Run, *, ignore_exclusions: bool = False) -> Run:
    """Return a run with its annotations and without the excluded frames."""
    if not (run.path / ANNOTATIONS_FILE).exists():
        return run
    journal = read_annotation_lines(run.path)
    problems = annotation_problems(journal)
    if problems and not ignore_exclusions:
        raise RunFolderError(
            f"{run.path / ANNOTATIONS_FILE}: {'; '.join(problems)}: the excluded frames are not known; "
            "--ignore-exclusions reads the run with all frames"
        )
    annotations = sound_annotations(journal)
    excluded = {} if ignore_exclusions else excluded_frames(annotations)
    return replace(
        run,
        frames=tuple(record for record in run.frames if record.sequence not in excluded),
        excluded=tuple(record for record in run.frames if record.sequence in excluded),
        annotations=annotations,
    )


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Contents of a run folder, sound or damaged: the readable records, and problems."""

    description: RunDescription | None  #: The session file; ``None`` if it cannot be read.
    frames: tuple[FrameRecord, ...]  #: Every readable record of the manifest, by sequence number.
    problems: tuple[tuple[str, str], ...]  #: Problems of session file and manifest.
    torn_manifest_line: bool  #: The last line of the manifest has no end: the writer was killed in the middle of it.
    links: tuple[str, ...] = ()  #: The chain of the manifest after 0, 1, 2, ... lines.
    begins_elsewhere: bool = False  #: The manifest does not belong to the session file: either is of another run.


def read_contents(path: Path) -> Contents:
    """Read session file and manifest of a run folder, even if they are damaged."""
    if path.is_file():
        raise RunFolderError(f"{path}: is a file; give a run folder")
    if not path.is_dir():
        raise RunFolderError(f"{path}: there is no such folder; a run folder is made by `rigctl acquire` or `import`")
    if not any((path / name).exists() for name in (SESSION_FILE, MANIFEST_FILE)):
        raise RunFolderError(f"{path}: is not a run folder: it has neither {SESSION_FILE} nor {MANIFEST_FILE}")
    problems: list[tuple[str, str]] = []
    description: RunDescription | None = None
    try:
        description = read_description(path / SESSION_FILE)
    except DataError as error:
        problems.append((SESSION_FILE, str(error)))
    lines = _read_manifest(path / MANIFEST_FILE, description, problems)
    return Contents(
        description=description,
        frames=_records(lines, problems),
        problems=tuple(problems),
        torn_manifest_line=lines.is_torn,
        links=lines.links,
        begins_elsewhere=lines.begins_elsewhere,
    )


def parse_record(line: bytes) -> FrameRecord:
    """Return the record that one line of a manifest stands for."""
    try:
        record = FRAME_RECORD.validate_json(line)
    except ValidationError as error:
        raise DataError(explain_invalid(error)) from error
    inside = Path(record.file).parts[:1] == (FRAMES_FOLDER,) and ".." not in Path(record.file).parts
    if not inside:
        raise DataError(f"file {record.file!r} does not lie in {FRAMES_FOLDER}/")
    return record


def file_checksum(data: bytes | memoryview) -> str:
    """Return the checksum that the manifest keeps for a file of this content."""
    return "sha256:" + hashlib.sha256(data).hexdigest()


def files_of(run: Run) -> tuple[RigFile, SessionFile]:
    """Return rig and session file as a run holds them."""
    if not run.session.is_of_session:
        raise RunFolderError(f"{run.path}: was not made by `rigctl acquire`: it cannot be resumed")
    try:
        rig_file = RigFile.model_validate(run.session_json["rig"])
        session = SessionFile.model_validate(run.session_json["session"])
    except ValidationError as error:
        raise ConfigError(describe(run.path / SESSION_FILE, error)) from error
    kept = run.path / INPUTS_FOLDER / "scene.toml"
    if rig_file.simulation is None or rig_file.simulation.scene.exists() or not kept.exists():
        return rig_file, session
    return rig_file.model_copy(
        update={"simulation": rig_file.simulation.model_copy(update={"scene": kept.resolve()})}
    ), session


def read_inputs(rig_file: RigFile, files: dict[str, Path]) -> dict[str, bytes]:
    """Return rig and session file, and the scene of a simulated rig, by their kind.

    [notify] of the rig file is left out: it may hold secrets, and a run folder is passed on to others.
    """
    scene = {} if rig_file.simulation is None else {"scene": rig_file.simulation.scene}
    try:
        inputs = {what: read_bounded(path, MOST_TEXT_BYTES) for what, path in (files | scene).items()}
        return {what: _without_notices(text) if what == "rig" else text for what, text in inputs.items()}
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be read: {error.strerror}") from error


def keep_inputs(inputs: Mapping[str, bytes], out: Path) -> None:
    """Write the inputs into the run."""
    folder = out / INPUTS_FOLDER
    if not inputs:
        return
    try:
        folder.mkdir(exist_ok=True)
        for what, content in inputs.items():
            write_durably(folder / f"{what}.toml", content)
        flush_folder(out)
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written: {error.strerror}") from error


class RunTail:
    """Follows the manifest of a run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._description: RunDescription | None = None
        self._begin_again()

    @property
    def description(self) -> RunDescription | None:
        """The content of the session file; None until it can be read."""
        return self._description

    def read(self) -> tuple[FrameRecord, ...]:
        """Return all frames of the run so far."""
        if self._description is None and (self._path / SESSION_FILE).exists():
            self._description = read_description(self._path / SESSION_FILE)
        try:
            size = (self._path / MANIFEST_FILE).stat().st_size
        except FileNotFoundError:
            self._begin_again()
            return ()
        if size < self._end:  # `resume` has repaired it
            self._begin_again()
        if size > self._end:
            self._take_in(self._read_on())
        return tuple(self._frames)

    def run(self, frames: tuple[FrameRecord, ...]) -> Run | None:
        """Return the run with some of its frames; None while it has not said what it is."""
        return None if self._description is None else _run(self._path, self._description, frames)

    def _begin_again(self) -> None:
        self._end = 0
        self._link = UNKNOWN_LINK
        self._frames: list[FrameRecord] = []
        self.problems: list[str] = []

    def _read_on(self) -> bytes:
        """Return the whole lines behind the place up to which the manifest has been read."""
        with open_plain(self._path / MANIFEST_FILE) as file:
            file.seek(self._end)
            data = file.read(_MOST_BYTES_A_LOOK)
        whole, end, _ = data.rpartition(b"\n")
        return whole + end

    def _take_in(self, data: bytes) -> None:
        if self._end == 0:
            self._link = UNKNOWN_LINK if self._description is None else first_link(self._description)
        lines = read_lines(data, self._link)
        self._end += len(data)
        self._link = lines.links[-1]
        for content, problem in lines.lines:
            self._take_line(content, problem)

    def _take_line(self, content: bytes, problem: str | None) -> None:
        if problem is not None:
            self.problems.append(f"{MANIFEST_FILE}: {problem}")
        if not content:
            return
        try:
            self._frames.append(parse_record(content))
        except DataError as error:
            self.problems.append(f"{MANIFEST_FILE}: {error}")


def annotate(path: Path, annotation: Annotation) -> None:
    """Return once an annotation is on the disk, at the end of the run's annotations."""
    is_new = not (path / ANNOTATIONS_FILE).exists()
    with locked_file(path / ANNOTATIONS_FILE):
        read_annotations(path)
        journal = Journal(path / ANNOTATIONS_FILE, first_link=_link(path))
        try:
            journal.append([json.dumps(asdict(annotation), allow_nan=False).encode("ascii")])
        finally:
            journal.close()
    if is_new:
        flush_folder(path)


def exclusion_remark(run: Run) -> str | None:
    """Return a remark on the excluded frames of an annotated run; None without any."""
    stated = exclusions_text(excluded_frames(run.annotations))
    said = "are left out" if run.excluded else "are taken all the same"
    return f"{run.path}: excluded frames {said}: {stated}" if stated else None


def read_annotations(path: Path) -> tuple[Annotation, ...]:
    """Return the annotations of a run."""
    journal = read_annotation_lines(path)
    problems = annotation_problems(journal)
    if problems:
        raise RunFolderError(f"{path / ANNOTATIONS_FILE}: {'; '.join(problems)}")
    return sound_annotations(journal)


def read_annotation_lines(path: Path) -> Lines:
    """Return the lines of a run's annotations, with checked seals; none without the file."""
    return read_lines(journal_bytes(path / ANNOTATIONS_FILE), _link(path))


def annotation_problems(journal: Lines) -> list[str]:
    """Return the problems of annotations, line by line."""
    found = []
    for number, (content, problem) in enumerate(journal.lines, start=1):
        if problem:
            found.append(f"line {number}: {problem}")
        elif isinstance(read := _read_line(content), str):
            found.append(f"line {number} is not an annotation: {read}")
    return found


def sound_annotations(journal: Lines) -> tuple[Annotation, ...]:
    """Return the annotations of the sound lines."""
    read = (_read_line(content) for content, _ in journal.lines if content)
    return tuple(one for one in read if isinstance(one, Annotation))


class Journal:
    """A file of lines, opened for adding to it."""

    def __init__(self, path: Path, *, first_link: str) -> None:
        present = read_bounded(path, MOST_RECORD_BYTES) if path.exists() else b""
        whole = present[: present.rfind(b"\n") + 1]
        self.lines = whole.count(b"\n")
        self.link = read_lines(whole, first_link).links[-1]
        self._length = len(whole)
        self._file = path.open("ab", buffering=0)
        self._file.truncate(self._length)

    def append(self, contents: Sequence[bytes]) -> None:
        """Return once the lines are on the disk."""
        written, link = [], self.link
        for content in contents:
            line = content + b"\n"
            if link is not None:
                line, link = sealed(content, link)
            written.append(line)
        lines = b"".join(written)
        try:
            self._write_all(lines)
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(self._length)
            raise
        self.link = link
        self._length += len(lines)
        self.lines += len(contents)

    def _write_all(self, data: bytes) -> None:
        # An unbuffered write may be partial.
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]

    def close(self) -> None:
        """Close the file. May be called twice."""
        self._file.close()


class RunLock:
    """The lock for writing into a run folder, until it is released or its process ends."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o644)
        try:
            _take(self._descriptor)
        except BlockingIOError as error:
            holder = _process_in(self._descriptor)
            os.close(self._descriptor)
            raise RunFolderError(
                f"{path}: process {holder} is writing into this run; wait for it, or `rigctl stop` it"
            ) from error
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, f"{os.getpid()}\n".encode("ascii"), 0)

    def release(self) -> None:
        """Let others write. May be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


@contextmanager
def released_on_error(lock: RunLock) -> Iterator[None]:
    """Release the lock if the block fails; otherwise keep it."""
    try:
        yield
    except BaseException:
        lock.release()
        raise


@contextmanager
def locked_file(file: Path) -> Iterator[None]:
    """Lock a file, created if needed, for one process at a time; wait for others."""
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def writing_process(path: Path) -> int | None:
    """Return the number of the process that writes into a run folder, or None."""
    try:
        descriptor = os.open(path / LOCK_FILE, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RunFolderError(f"{path / LOCK_FILE}: cannot be read: {error.strerror}") from error
    try:
        # A shared lock, so that two simultaneous calls do not see each other as the writer.
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _process_in(descriptor)
    else:
        return None
    finally:
        os.close(descriptor)


def _run(path: Path, description: RunDescription, frames: tuple[FrameRecord, ...]) -> Run:
    return Run(
        path=path,
        session=description.record,
        session_json=description.session,
        frames=frames,
        created_by=description.created_by,
        created_utc=description.created_utc,
    )


def _without_notices(rig_file: bytes) -> bytes:
    lines, is_notify = [], False
    for line in rig_file.splitlines(keepends=True):
        if line.lstrip().startswith(b"["):
            is_notify = line.strip().replace(b" ", b"").startswith(b"[notify]")
            lines += [b"# [notify] stays in the rig file.\n"] if is_notify else []
        if not is_notify and not re.match(rb"\s*notify\s*[.=]", line):
            lines.append(line)
    return b"".join(lines)


def _checked(path: Path, record: FrameRecord) -> bytes | memoryview:
    try:
        data = read_for_now(path / record.file, _largest_bytes(record))
    except OSError as error:
        raise RunFolderError(f"{path / record.file}: cannot be read: {error.strerror}") from error
    found = file_checksum(data)
    if found != record.checksum:
        raise RunFolderError(
            f"{path / record.file}: damaged or replaced: the manifest has {record.checksum}, the file {found}"
        )
    return data


def _largest_bytes(record: FrameRecord) -> int:
    """Return the largest size of a frame's file, by the picture size in the manifest."""
    return min(_SAMPLE_BYTES * record.height * record.width + _MOST_HEADER_BYTES, MOST_OWN_FRAME_BYTES)


def _read_manifest(file: Path, description: RunDescription | None, problems: list[tuple[str, str]]) -> Lines:
    try:
        data = read_bounded(file, MOST_RECORD_BYTES)
    except OSError as error:
        problems.append((file.name, f"cannot be read: {error.strerror}"))
        data = b""
    return read_lines(data, UNKNOWN_LINK if description is None else first_link(description))


def _records(lines: Lines, problems: list[tuple[str, str]]) -> tuple[FrameRecord, ...]:
    frames: list[FrameRecord] = []
    for number, (content, problem) in enumerate(lines.lines, start=1):
        if problem is not None and not (number == 1 and lines.begins_elsewhere and not lines.links[0]):
            problems.append((MANIFEST_FILE, f"line {number}: {problem}"))
        if content:
            try:
                frames.append(parse_record(content))
            except DataError as error:
                problems.append((MANIFEST_FILE, f"line {number}: {error}"))
    problems += [(MANIFEST_FILE, text) for text in _duplicates(frames)]
    return tuple(sorted(frames, key=lambda record: record.sequence))


def _duplicates(frames: list[FrameRecord]) -> list[str]:
    sequences = Counter(record.sequence for record in frames)
    files = Counter(record.file for record in frames)
    return [f"sequence {value} occurs {n} times" for value, n in sequences.items() if n > 1] + [
        f"file {value} occurs {n} times" for value, n in files.items() if n > 1
    ]


def _take(descriptor: int) -> None:
    """Take the lock; wait for a moment, since `writing_process` holds it briefly."""
    for _ in range(_LOOKS):
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        time.sleep(_LOOK_S)
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _process_in(descriptor: int) -> int:
    text = os.pread(descriptor, 32, 0).decode("ascii", errors="replace").strip()
    return int(text) if text.isdecimal() else 0


def _read_line(content: bytes) -> Annotation | str:
    """Return the annotation of a line, or its problem."""
    try:
        return _ANNOTATION.validate_json(content)
    except ValidationError as error:
        return explain_invalid(error)


def _link(path: Path) -> str:
    """Return the first link of the chain of a run's annotations."""
    try:
        return first_link(read_description(path / SESSION_FILE))
    except DataError:
        return UNKNOWN_LINK
