"""The events of a run as they are written: each on the disk at once, the last ones even on a full disk."""

import errno
import json
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from pydantic import JsonValue

from rigctl.numbers.utc_time import utc_text
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.journal import Journal
from rigctl.runs.run_events import EVENTS_FILE, RunEvent

Clock = Callable[[], int]

# Errors of a disk that has no room.
_DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
_FILE = ".room-for-events"
_BYTES = 65536


class EventLog:
    """Notes events, each a line with the time by two clocks.

    Parameters
    ----------
    path : Path
        The run folder.
    first_link : str or None
        What the chain of its lines begins with; None in an old run, which has none.
    utc_ns, monotonic_ns : callable
        The clocks [ns].

    Raises
    ------
    OSError
        The file cannot be opened or written.
    """

    def __init__(self, path: Path, *, first_link: str | None, utc_ns: Clock, monotonic_ns: Clock) -> None:
        self._utc_ns = utc_ns
        self._monotonic_ns = monotonic_ns
        self._journal = Journal(path / EVENTS_FILE, first_link=first_link)
        self._reserve = DiskReserve(path)
        self._lock = threading.Lock()

    def note(self, name: str, facts: dict[str, JsonValue]) -> None:
        """Return once an event is on the disk; on a full one the room that is kept for events is used.

        Raises
        ------
        OSError
            It could not be written.
        """
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
        """Close the file, and give the room back. May be called twice."""
        self._journal.close()
        self._reserve.give_up()


class DiskReserve:
    """A file that takes room, until the room is needed.

    Parameters
    ----------
    path : Path
        The run folder. Where the room cannot be had there is none: a session does not fail by it.
    """

    def __init__(self, path: Path) -> None:
        self._file = path / _FILE
        with suppress(OSError):
            descriptor = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                os.posix_fallocate(descriptor, 0, _BYTES)
            finally:
                os.close(descriptor)

    def give_up(self) -> None:
        """Give the room back. May be called twice."""
        with suppress(OSError):
            self._file.unlink(missing_ok=True)


def json_line(record: FrameRecord | RunEvent) -> bytes:
    """Return the content of one line of a manifest or of the events."""
    return json.dumps(asdict(record), allow_nan=False).encode("ascii")
