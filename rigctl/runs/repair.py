"""Makes a run folder whole after a kill or a power cut: adopts whole frames, sets damaged ones aside, loses nothing."""

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import DataError, RunFolderError
from rigctl.runs.event_log import json_line
from rigctl.runs.fits.fits_frame import decode_frame
from rigctl.runs.fits.frame_header import record_from_header
from rigctl.runs.frame_record import EXPOSURE_PARTS, FrameRecord
from rigctl.runs.run_description import SESSION_FILE, first_link
from rigctl.runs.run_events import EVENTS_FILE, journal_problems, read_journal, sound_events
from rigctl.runs.run_folder import FRAMES_FOLDER, MANIFEST_FILE, Contents, file_checksum, read_contents
from rigctl.runs.run_lock import RunLock
from rigctl.runs.sealed_lines import sealed_all
from rigctl.runs.verification import Finding, frame_problems
from rigctl.storage.bounded_file import MOST_OWN_FRAME_BYTES, read_bounded
from rigctl.storage.durable_file import PART_SUFFIX, flush_folder, write_durably

DAMAGED_FOLDER = "damaged"


@dataclass(frozen=True, kw_only=True)
class Repair:
    """Changes that a repair made to a run folder.

    Attributes
    ----------
    adopted : tuple of Finding
        Whole frames that the manifest did not name, and now does.
    set_aside : tuple of Finding
        Files that are no whole frames of this run; they lie in ``damaged`` now.
    frames : tuple of FrameRecord
        What the manifest names now; every checksum holds.
    """

    adopted: tuple[Finding, ...]
    set_aside: tuple[Finding, ...]
    frames: tuple[FrameRecord, ...]


def repair_run(path: Path) -> Repair:
    """Return what had to be done until each frame of the manifest is whole, and each whole frame is in the manifest.

    Parameters
    ----------
    path : Path
        A run folder that nobody writes into.

    Raises
    ------
    RunFolderError
        It is no run folder, its session file is damaged, another process writes into it, or the disk cannot be
        written.

    Notes
    -----
    A sound folder is left as it is. The frames are the truth: a manifest with damaged lines is made again from them.
    Nothing is deleted: what is damaged is moved, so that a person can look at it.
    """
    contents = read_contents(path)
    if contents.description is None:
        problem = dict(contents.problems).get(SESSION_FILE, "is missing")
        raise RunFolderError(f"{path / SESSION_FILE}: {problem}: what was to be taken is not known")
    if contents.begins_elsewhere and _is_of_other_session(path):
        raise RunFolderError(f"{path / SESSION_FILE}: is not the one of this run: manifest and events begin elsewhere")
    try:
        lock = RunLock(path)
        try:
            return _Repairer(path, first_link(contents.description)).repair(read_contents(path))
        finally:
            lock.release()
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be repaired: {error.strerror}") from error


def _is_of_other_session(path: Path) -> bool:
    journal = read_journal(path)
    return journal.begins_elsewhere or not journal.lines


class _Repairer:
    def __init__(self, path: Path, link: str | None) -> None:
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
        """Set aside what is there of an exposure that is not whole: it is taken again as a whole."""
        parts = Counter(record.exposure_id for record in self._frames.values())
        for record in list(self._frames.values()):
            if record.exposure_id is not None and parts[record.exposure_id] < EXPOSURE_PARTS:
                del self._frames[record.sequence]
                self._adopted = [finding for finding in self._adopted if finding.file != record.file]
                self._move_aside(record.file, "other frames of the same exposure are missing")

    def _mend_events(self) -> None:
        """Keep the events that are sound by themselves; the damaged file is set aside, to be looked at."""
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
            record = record_from_header(decode_frame(data), file=final, checksum=file_checksum(data))
        except (DataError, OSError) as error:
            self._move_aside(name, str(error))
            return
        if record.sequence in self._frames:
            self._move_aside(name, f"frame {record.sequence} is in this run already")
            return
        _make_final(file, self._path / final)
        self._frames[record.sequence] = record
        self._adopted.append(Finding(file=final, problem="whole, and the manifest did not name it"))

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
