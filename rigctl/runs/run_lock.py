"""One writer a run folder: a lock that ends with its process, however that ends."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rigctl.errors import RunFolderError

LOCK_FILE = "writer.lock"
_LOOKS, _LOOK_S = 10, 0.01


class RunLock:
    """The right to write into a run folder, held until it is released or its process is gone.

    Parameters
    ----------
    path : Path
        The run folder; it must exist.

    Raises
    ------
    RunFolderError
        Another process holds it.
    OSError
        The folder cannot be written.
    """

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


def _take(descriptor: int) -> None:
    """Take the lock; whoever only asks for the writer holds it for a moment, which is waited for."""
    for _ in range(_LOOKS):
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        time.sleep(_LOOK_S)
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def released_on_error(lock: RunLock) -> Iterator[None]:
    """Release the lock where the block fails; else it stays held."""
    try:
        yield
    except BaseException:
        lock.release()
        raise


@contextmanager
def locked_file(file: Path) -> Iterator[None]:
    """Hold a file, made where it is not there, so that one process at a time adds to it; wait for the others.

    Raises
    ------
    OSError
        It cannot be opened.
    """
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def writing_process(path: Path) -> int | None:
    """Return the number of the process that writes into a run folder, or None where there is none.

    Raises
    ------
    RunFolderError
        Whether there is one cannot be told.
    """
    try:
        descriptor = os.open(path / LOCK_FILE, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RunFolderError(f"{path / LOCK_FILE}: cannot be read: {error.strerror}") from error
    try:
        # A shared lock, so that two who ask do not take each other for the writer.
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _process_in(descriptor)
    else:
        return None
    finally:
        os.close(descriptor)


def _process_in(descriptor: int) -> int:
    text = os.pread(descriptor, 32, 0).decode("ascii", errors="replace").strip()
    return int(text) if text.isdecimal() else 0
