"""A run folder as it is read: what was done, and the frames that came of it.

::

    RUN/session.json      the resolved session, versions, schema version
    RUN/frames/*.fits     one whole frame each, with all that is known of it in its header
    RUN/manifest.jsonl    one line a frame, appended once the frame is on the disk
    RUN/events.jsonl      what happened, and when
    RUN/annotations.jsonl what people note of it, and which frames they leave out (rigctl.runs.annotations)

The frames are the truth; the manifest is their table of contents and can be made again from them.
"""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue, ValidationError

from rigctl.errors import DataError, RunFolderError
from rigctl.runs.annotation_record import Annotation
from rigctl.runs.fits.fits_frame import FitsFrame, decode_frame
from rigctl.runs.fits.frame_header import record_from_header
from rigctl.runs.frame_record import FRAME_RECORD, FrameRecord
from rigctl.runs.run_description import SESSION_FILE, RunDescription, explain_invalid, first_link, read_description
from rigctl.runs.sealed_lines import Lines, first_link_of, read_lines
from rigctl.runs.session_record import SessionRecord
from rigctl.storage.bounded_file import MOST_OWN_FRAME_BYTES, MOST_RECORD_BYTES, read_bounded, read_for_now

# A card has 80 bytes; a header of thousands of cards is none of ours.
_SAMPLE_BYTES, _MOST_HEADER_BYTES = 2, 1_000_000
MANIFEST_FILE = "manifest.jsonl"
FRAMES_FOLDER = "frames"
INPUTS_FOLDER = "inputs"
ANNOTATIONS_FILE = "annotations.jsonl"


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run folder's table of contents.

    Attributes
    ----------
    path : Path
        The folder.
    session : SessionRecord
        How it came about.
    session_json : mapping
        All that the writer was told of that: rig, session, versions, hashes.
    frames : tuple of FrameRecord
        In the order of their sequence numbers.
    created_by : str
        Program and version that made the folder.
    created_utc : str
        When it was made.
    excluded : tuple of FrameRecord
        Frames that people have left out; they are not among `frames`.
    annotations : tuple of Annotation
        What people have noted of it.
    written_angles_deg : mapping
        Sequence numbers of frames whose polarizer angle was recalibrated to the angle that their files state [deg].
    """

    path: Path
    session: SessionRecord
    session_json: dict[str, JsonValue]
    frames: tuple[FrameRecord, ...]
    created_by: str
    created_utc: str
    excluded: tuple[FrameRecord, ...] = ()
    annotations: tuple[Annotation, ...] = ()
    written_angles_deg: Mapping[int, float | None] = field(default_factory=dict)

    def counts(self, record: FrameRecord) -> NDArray[np.uint16]:
        """Return the samples of a frame, once its checksum has been found right.

        Returns
        -------
        (H, W) array of uint16
            Samples in DN; the first row is the top of the picture. The array is the caller's own.

        Raises
        ------
        RunFolderError
            The file is gone, or is not the one that was written.
        """
        if record.sequence in self.written_angles_deg:
            record = replace(record, polarizer_angle_deg=self.written_angles_deg[record.sequence])
        return read_frame(self.path, record).counts


def read_frame(path: Path, record: FrameRecord) -> FitsFrame:
    """Return a frame, once its checksum and its header agree with its line in the manifest.

    Raises
    ------
    DataError
        The file is gone, is not the one that was written, or says something else of the frame than the manifest does.
    """
    frame = decode_frame(_checked(path, record))
    stated = record_from_header(frame, file=record.file, checksum=record.checksum)
    if stated != record:
        other = [f.name for f in fields(record) if getattr(record, f.name) != getattr(stated, f.name)]
        raise RunFolderError(f"{path / record.file}: manifest and header contradict each other: {', '.join(other)}")
    return frame


def _checked(path: Path, record: FrameRecord) -> bytes | memoryview:
    try:
        data = read_for_now(path / record.file, _largest_bytes(record))
    except OSError as error:
        raise RunFolderError(f"{path / record.file}: cannot be read: {error.strerror}") from error
    found = file_checksum(data)
    if found != record.checksum:
        raise RunFolderError(
            f"{path / record.file}: damaged or replaced: the manifest says {record.checksum}, the file has {found}"
        )
    return data


def _largest_bytes(record: FrameRecord) -> int:
    """Return what the file of a frame can have, by the size of the picture that its line in the manifest states."""
    return min(_SAMPLE_BYTES * record.height * record.width + _MOST_HEADER_BYTES, MOST_OWN_FRAME_BYTES)


def file_checksum(data: bytes | memoryview) -> str:
    """Return the checksum that the manifest keeps for a file of this content."""
    return "sha256:" + hashlib.sha256(data).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Contents of a run folder, good or bad: the records that could be read, and what is wrong with the rest.

    Attributes
    ----------
    description : RunDescription or None
        What the session file says; ``None`` where it cannot be read.
    frames : tuple of FrameRecord
        Every record of the manifest that could be read, by sequence number.
    problems : tuple of (file, problem)
        What is wrong with the session file and the manifest.
    torn_manifest_line : bool
        The last line of the manifest has no end: the writer was killed in the middle of it.
    links : tuple of str
        The chain of the manifest after 0, 1, 2, ... lines; empty for old runs.
    begins_elsewhere : bool
        The manifest does not follow on the session file: either is of another run.
    """

    description: RunDescription | None
    frames: tuple[FrameRecord, ...]
    problems: tuple[tuple[str, str], ...]
    torn_manifest_line: bool
    links: tuple[str, ...] = ()
    begins_elsewhere: bool = False


def read_run(path: Path) -> Run:
    """Return the table of contents of a run folder; the frames themselves are not opened.

    Parameters
    ----------
    path : Path
        The run folder.

    Raises
    ------
    RunFolderError
        There is no such folder, or its session file or manifest is damaged, or frames are gone: every
        problem at once.

    Notes
    -----
    A last line of the manifest without an end is what a killed writer leaves; it is passed over, since its
    frame was never acknowledged. ``rigctl verify`` reports it.
    """
    contents = read_contents(path)
    problems = [f"{file}: {problem}" for file, problem in contents.problems]
    problems += [f"{r.file}: missing" for r in contents.frames if not (path / r.file).is_file()]
    description = contents.description
    if problems or description is None:
        raise RunFolderError(f"{path} cannot be used as a run folder:\n  " + "\n  ".join(problems))
    return Run(
        path=path,
        session=description.record,
        session_json=description.session,
        frames=contents.frames,
        created_by=description.created_by,
        created_utc=description.created_utc,
    )


def read_contents(path: Path) -> Contents:
    """Return what a run folder's session file and manifest say, whatever state they are in.

    Raises
    ------
    RunFolderError
        There is no such folder, or it is no run folder at all.
    """
    if path.is_file():
        raise RunFolderError(f"{path}: is a file, a run folder is wanted")
    if not path.is_dir():
        raise RunFolderError(f"{path}: there is no such folder; a run folder is made by `rigctl acquire` or `import`")
    if not any((path / name).exists() for name in (SESSION_FILE, MANIFEST_FILE)):
        raise RunFolderError(f"{path}: not a run folder: it has neither {SESSION_FILE} nor {MANIFEST_FILE}")
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


def _read_manifest(file: Path, description: RunDescription | None, problems: list[tuple[str, str]]) -> Lines:
    try:
        data = read_bounded(file, MOST_RECORD_BYTES)
    except OSError as error:
        problems.append((file.name, f"cannot be read: {error.strerror}"))
        data = b""
    return read_lines(data, first_link_of(data) if description is None else first_link(description))


def _records(lines: Lines, problems: list[tuple[str, str]]) -> tuple[FrameRecord, ...]:
    frames: list[FrameRecord] = []
    for number, line in enumerate(lines.lines, start=1):
        if line.problem is not None and not (number == 1 and lines.begins_elsewhere and not lines.links[0]):
            problems.append((MANIFEST_FILE, f"line {number}: {line.problem}"))
        if line.content:
            try:
                frames.append(parse_record(line.content))
            except DataError as error:
                problems.append((MANIFEST_FILE, f"line {number}: {error}"))
    problems += [(MANIFEST_FILE, text) for text in _duplicates(frames)]
    return tuple(sorted(frames, key=lambda record: record.sequence))


def parse_record(line: bytes) -> FrameRecord:
    """Return the record that one line of a manifest stands for.

    Raises
    ------
    DataError
        The line is no JSON, lacks a key, has an unknown one or a value of the wrong kind: all at once.
    """
    try:
        record = FRAME_RECORD.validate_json(line)
    except ValidationError as error:
        raise DataError(explain_invalid(error)) from error
    inside = Path(record.file).parts[:1] == (FRAMES_FOLDER,) and ".." not in Path(record.file).parts
    if not inside:
        raise DataError(f"file {record.file!r} does not lie in {FRAMES_FOLDER}/")
    return record


def _duplicates(frames: list[FrameRecord]) -> list[str]:
    sequences = Counter(record.sequence for record in frames)
    files = Counter(record.file for record in frames)
    return [f"sequence {value} stands {n} times" for value, n in sequences.items() if n > 1] + [
        f"file {value} stands {n} times" for value, n in files.items() if n > 1
    ]
