"""Room on the disk that is kept for the last words of a session: a full disk is when they are wanted most."""

import errno
import os
from contextlib import suppress
from pathlib import Path

DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a disk that has no room."""
_FILE = ".room-for-events"
_BYTES = 65536


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
