"""Writes a run folder: a frame is on the disk before it is in the manifest, and an event at once."""

import errno
import json
import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from rigctl.base.durable import DiskCalls, flush_folder, write_durably
from rigctl.base.numbers import utc_text
from rigctl.errors import RunFolderError
from rigctl.runs.fits import encode_frame, header_cards
from rigctl.runs.folder import (
    FRAMES_FOLDER,
    MANIFEST_FILE,
    Journal,
    Run,
    RunLock,
    file_checksum,
    keep_inputs,
    read_run,
    released_on_error,
)
from rigctl.runs.records import (
    EVENTS_FILE,
    SCHEMA_VERSION,
    SESSION_FILE,
    FrameRecord,
    RunDescription,
    RunEvent,
    closing_facts,
    encode_description,
    first_link,
    read_description,
)
from rigctl.version import VERSION

# Errors of a disk that has no room.
_DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
_FILE = ".room-for-events"
_BYTES = 65536
Clock = Callable[[], int]


class RunWriter:
    """Writes frames and events into a run folder. A context manager: leaving it closes the files."""

    def __init__(
        self,
        path: Path,
        *,
        lock: RunLock,
        sequences: Iterable[int],
        first_link: str,
        utc_ns: Clock = time.time_ns,
        monotonic_ns: Clock = time.monotonic_ns,
        disk: DiskCalls | None = None,
    ) -> None:
        self.path = path
        self.disk = DiskCalls() if disk is None else disk
        self.listener: Callable[[str, dict[str, JsonValue]], None] | None = None
        self._lock, self._writing = lock, threading.Lock()
        self._sequences = set(sequences)
        self._manifest = Journal(path / MANIFEST_FILE, first_link=first_link)
        self._events = EventLog(path, first_link=first_link, utc_ns=utc_ns, monotonic_ns=monotonic_ns)
        flush_folder(path)

    @classmethod
    def create(
        cls,
        path: Path,
        description: dict[str, JsonValue],
        *,
        inputs: Mapping[str, bytes] | None = None,
        utc_ns: Clock = time.time_ns,
        monotonic_ns: Clock = time.monotonic_ns,
    ) -> "RunWriter":
        """Return a writer for a new run folder."""
        content = RunDescription(
            schema_version=SCHEMA_VERSION,
            created_by=f"rigctl {VERSION}",
            created_utc=utc_text(utc_ns()),
            session=description,
        )
        disk = DiskCalls()
        made: list[RunWriter] = []

        def make() -> "RunWriter":
            _make_folder(path)
            lock = RunLock(path)
            with released_on_error(lock):
                keep_inputs(inputs or {}, path)
                write_durably(path / SESSION_FILE, encode_description(content))
                link = first_link(read_description(path / SESSION_FILE))
                clocks = {"utc_ns": utc_ns, "monotonic_ns": monotonic_ns}
                made.append(cls(path, lock=lock, sequences=(), first_link=link, disk=disk, **clocks))
                return made[0]

        try:
            return disk.call(make)
        except BaseException as error:
            # Closed as soon as it exists, after a delay by a hanging disk.
            disk.end(lambda: _close_all(made))
            if not isinstance(error, OSError):
                raise
            raise RunFolderError(f"{path}: cannot make a run folder here: {error.strerror}") from error

    @classmethod
    def append(
        cls, path: Path, *, utc_ns: Clock = time.time_ns, monotonic_ns: Clock = time.monotonic_ns
    ) -> "RunWriter":
        """Return a writer that adds frames to an existing run folder."""
        read_run(path)
        try:
            lock = RunLock(path)
            with released_on_error(lock):
                sequences = _taken_sequences(read_run(path))
                link = first_link(read_description(path / SESSION_FILE))
                return cls(
                    path, lock=lock, sequences=sequences, first_link=link, utc_ns=utc_ns, monotonic_ns=monotonic_ns
                )
        except OSError as error:
            raise RunFolderError(f"{path}: no frames can be added: {error.strerror}") from error

    def __enter__(self) -> "RunWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. May be called twice."""
        self.disk.end(self._close)

    def _close(self) -> None:
        with self._writing:  # a thread that a hanging disk delayed may still finish
            self._manifest.close()
        self._events.close()
        self._lock.release()

    @property
    def next_sequence(self) -> int:
        """The lowest unused sequence number."""
        return max(self._sequences, default=-1) + 1

    def write_frame(self, record: FrameRecord, counts: NDArray[Any]) -> FrameRecord:
        """Return the record of the manifest, once the frame is on the disk.

        Order: ``.part``, flush, rename, flush of the folder, line of the manifest, flush. A frame in the manifest is
        therefore whole, even after a power cut.
        """
        return self.write_frames([(record, counts)])[0]

    def write_frames(self, frames: Iterable[tuple[FrameRecord, NDArray[Any]]]) -> tuple[FrameRecord, ...]:
        """Return the records of several frames, which are all in the run or none."""
        with self._writing:
            return self._write_frames(frames)

    def _write_frames(self, frames: Iterable[tuple[FrameRecord, NDArray[Any]]]) -> tuple[FrameRecord, ...]:
        written: list[FrameRecord] = []
        try:
            for record, counts in frames:
                written.append(self._write_file(record, counts))
            self._manifest.append([json_line(record) for record in written])
        except Exception as error:
            self._take_back(written)
            if isinstance(error, OSError):
                raise RunFolderError(f"{self.path}: a frame cannot be written: {error.strerror}") from error
            raise
        return tuple(written)

    def _write_file(self, record: FrameRecord, counts: NDArray[Any]) -> FrameRecord:
        if counts.dtype not in (np.uint16, np.float32) or counts.ndim != 2 or counts.size == 0:
            raise ValueError(
                f"counts must be a (H, W) array of uint16 or float32, not {counts.shape} of {counts.dtype}"
            )
        if record.sequence in self._sequences:
            raise ValueError(f"sequence {record.sequence} is in this run already; the next is {self.next_sequence}")
        record = replace(
            record,
            real_counts=counts.dtype == np.float32 or None,
            file=f"{FRAMES_FOLDER}/{_file_name(record)}",
            height=counts.shape[0],
            width=counts.shape[1],
            saturated_fraction=_share_from(counts, math.ceil(record.saturation_dn)),
        )
        data = encode_frame(counts, header_cards(record))
        with ThreadPoolExecutor(max_workers=1) as beside:  # the disk takes as long as the checksum
            checksum = beside.submit(file_checksum, data)
            write_durably(self.path / record.file, data)
        self._sequences.add(record.sequence)
        return replace(record, checksum=checksum.result())

    def _take_back(self, records: Iterable[FrameRecord]) -> None:
        for record in records:
            (self.path / record.file).unlink(missing_ok=True)
            self._sequences.discard(record.sequence)

    def event(self, name: str, **facts: Any) -> None:
        """Note an event with the time by both clocks."""
        try:
            self.disk.call(lambda: self._events.note(name, facts))
        except OSError as error:
            raise RunFolderError(f"{self.path}: an event cannot be noted: {error.strerror}") from error
        finally:
            if self.listener is not None:
                self.listener(name, facts)

    def closing_event(self, name: str, **facts: Any) -> None:
        """Note the end of the session; the event holds the number of frames and their chain."""
        self.event(name, **facts, **closing_facts(frames=self._manifest.lines, link=self._manifest.link))


def _share_from(counts: NDArray[np.uint16], full_dn: int) -> float:
    """Return the share of pixels at or above a count; most pictures have none, which their maximum shows quickly."""
    return np.count_nonzero(counts >= full_dn) / counts.size if counts.max() >= full_dn else 0.0


def require_new_folder(path: Path) -> None:
    """Raise RunFolderError if the folder exists and is not empty."""
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise RunFolderError(f"{path}: not empty; a run needs its own folder. Choose a folder that does not exist")


class EventLog:
    """Writes events, each a line with the time by two clocks."""

    def __init__(self, path: Path, *, first_link: str, utc_ns: Clock, monotonic_ns: Clock) -> None:
        self._utc_ns = utc_ns
        self._monotonic_ns = monotonic_ns
        self._journal = Journal(path / EVENTS_FILE, first_link=first_link)
        self._reserve = DiskReserve(path)
        self._lock = threading.Lock()

    def note(self, name: str, facts: dict[str, JsonValue]) -> None:
        """Return once an event is on the disk; a full disk uses the reserve for events."""
        with self._lock:  # the writer's thread notes events too
            line = json_line(
                RunEvent(
                    id=self._journal.lines,
                    utc=utc_text(self._utc_ns()),
                    monotonic_ns=self._monotonic_ns(),
                    event=name,
                    facts=facts,
                )
            )
            try:
                self._journal.append([line])
            except OSError as error:
                if error.errno not in _DISK_FULL:
                    raise
                self._reserve.give_up()
                self._journal.append([line])

    def close(self) -> None:
        """Close the file and free the reserve. May be called twice."""
        self._journal.close()
        self._reserve.give_up()


class DiskReserve:
    """A file that reserves disk space for events."""

    def __init__(self, path: Path) -> None:
        self._file = path / _FILE
        with suppress(OSError):
            descriptor = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                os.posix_fallocate(descriptor, 0, _BYTES)
            finally:
                os.close(descriptor)

    def give_up(self) -> None:
        """Free the space. May be called twice."""
        with suppress(OSError):
            self._file.unlink(missing_ok=True)


def json_line(record: FrameRecord | RunEvent) -> bytes:
    """Return the content of one line of a manifest or of the events."""
    return json.dumps(asdict(record), allow_nan=False).encode("ascii")


def _close_all(writers: Iterable[RunWriter]) -> None:
    for writer in writers:
        writer.close()


def _make_folder(path: Path) -> None:
    require_new_folder(path)
    (path / FRAMES_FOLDER).mkdir(parents=True)
    flush_folder(path.parent)


def _taken_sequences(run: Run) -> set[int]:
    # A frame of a killed writer without a line in the manifest must not be overwritten.
    numbers = (file.name.partition("_")[0] for file in (run.path / FRAMES_FOLDER).glob("*.fits"))
    unnamed = {int(number) for number in numbers if number.isdecimal()}
    return unnamed | {record.sequence for record in run.frames}


def _file_name(record: FrameRecord) -> str:
    angle_deg = record.polarizer_angle_target_deg
    angle = "" if angle_deg is None else f"_a{round(angle_deg) % 180:03d}"
    return f"{record.sequence:06d}_{record.kind}{angle}.fits"
