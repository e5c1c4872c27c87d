"""Bounded reads of plain files, durable and atomic writes, and calls to a hung disk that end in time.

Files of people or other programs are read only through `read_bounded` and `open_plain`, which a test checks.
"""

import errno
import hashlib
import io
import math
import os
import stat
import threading
import zipfile
from collections.abc import Callable, Collection
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from drivers.caller import Caller, LeftBehindError
from rigctl.errors import DataError, RunFolderError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BYTES_PER_MB = 1_000_000
# Files that people write by hand.
MOST_TEXT_BYTES = 8 * _BYTES_PER_MB
# Files of the program other than pictures: calibrations, events. A manifest has some 1.5 kB per frame.
MOST_RECORD_BYTES = 512 * _BYTES_PER_MB
# Samples of one picture without --max-frame-mb: 134 million pixels of 16 bits.
MOST_FRAME_MB = 268
MOST_FRAME_BYTES = MOST_FRAME_MB * _BYTES_PER_MB
# A run's own frames, without an option: 20 000 x 20 000 pixels of 16 bits and a header.
MOST_OWN_FRAME_BYTES = 801 * _BYTES_PER_MB


def open_plain(path: Path, most_bytes: int | None = None) -> BufferedReader:
    """Open a file for reading; OSError for folders, pipes and devices, which may never answer, and for large files."""
    facts = path.stat()
    if stat.S_ISDIR(facts.st_mode):
        raise IsADirectoryError(errno.EISDIR, "is a folder", str(path))
    if not stat.S_ISREG(facts.st_mode):
        raise OSError(errno.EINVAL, "is not a plain file but a device, a pipe or a socket", str(path))
    if most_bytes is not None and facts.st_size > most_bytes:
        raise OSError(errno.EFBIG, f"has {_mb(facts.st_size)} MB; at most {_mb(most_bytes)} MB are read", str(path))
    return path.open("rb")


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file, checked before it is read."""
    with open_plain(path, most_bytes) as file:
        # One byte more than its size, to notice growth; then one more than allowed.
        size = os.fstat(file.fileno()).st_size
        data = file.read(size + 1)
        if len(data) > size:
            data += file.read(most_bytes + 1 - len(data))
    if len(data) > most_bytes:
        raise OSError(errno.EFBIG, f"grows, and at most {_mb(most_bytes)} MB are read", str(path))
    return data


class _Kept(threading.local):
    """Reused memory of a thread."""

    buffer = bytearray()


_KEPT = _Kept()


def read_for_now(path: Path, most_bytes: int) -> memoryview:
    """Return the content of a file, checked before it is read, until this thread's next call.

    The next call reuses the memory: new memory for each of a thousand pictures, or a memory map, takes longer than
    reading them from the cache of the system.
    """
    with open_plain(path, most_bytes) as file:
        size = os.fstat(file.fileno()).st_size
        if len(_KEPT.buffer) <= size:
            _KEPT.buffer = bytearray(size + 1)
        view, filled = memoryview(_KEPT.buffer), 0
        while count := file.readinto(view[filled : size + 1]):
            filled += count
    if filled > size:
        raise OSError(errno.EFBIG, "grows while it is read", str(path))
    return view[:filled].toreadonly()


def _mb(size: int) -> str:
    return f"{size / _BYTES_PER_MB:.4g}"


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal, for the provenance of results."""
    with open_plain(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def source_of(path: Path) -> dict[str, Any]:
    """Return a file that something was made from, as JSON holds it."""
    return {"path": str(path), "sha256": sha256_of(path)}


Result = TypeVar("Result")

STALLED_S = 30.0


class DiskCalls:
    """Makes calls in its own thread, which is abandoned if the disk hangs."""

    def __init__(self, *, stalled_s: float | None = None) -> None:
        self.stalled_s = STALLED_S if stalled_s is None else stalled_s
        self.is_hung = False
        self._caller: Caller | None = None

    def call(self, job: Callable[[], Result]) -> Result:
        """Return what a call returns."""
        if self.is_hung:
            raise RunFolderError(self.message())
        if self._caller is None:
            self._caller = Caller("calls to the disk")
        try:
            return self._caller.call(job, within_s=self.stalled_s)
        except LeftBehindError as error:
            self.is_hung = True
            raise RunFolderError(self.message()) from error

    def give_up(self) -> None:
        """Stop waiting, since a hanging disk was noticed elsewhere."""
        self.is_hung = True

    def end(self, last: Callable[[], object]) -> None:
        """Make a last call, abandoned if the disk hangs. May be called twice."""
        if self._caller is None:
            last()
            return
        caller, self._caller = self._caller, None
        try:
            if not self.is_hung:
                caller.call(last, within_s=self.stalled_s)
        except LeftBehindError:
            self.is_hung = True
        finally:
            caller.end(last if self.is_hung else _nothing)

    def message(self) -> str:
        """Return the error message of a hanging disk."""
        return (
            f"the disk hangs: a write has not returned for {self.stalled_s:g} s. Check its cable and `dmesg`, then "
            "`rigctl resume`"
        )


def _nothing() -> None:
    """Do nothing: the last task of the thread."""


PART_SUFFIX = ".part"


def write_durably(path: Path, data: bytes) -> None:
    """Return once the data are on the disk under their name.

    Written as ``NAME.part``, flushed to the disk, renamed, and the folder flushed. Without the first flush a rename can
    leave an empty file; without the second the last file may be missing after a power cut.
    """
    part = path.with_name(path.name + PART_SUFFIX)
    try:
        _write_and_flush(part, data)
        part.replace(path)
    except BaseException as error:
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)  # the error of a full disk has no file name
        part.unlink(missing_ok=True)
        raise
    flush_folder(path.parent)


def flush_folder(folder: Path) -> None:
    """Return once the names in a folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _write_and_flush(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


_MOST_HEADER_BYTES = 4096


def read_arrays(path: Path, *, only: Collection[str] | None = None) -> dict[str, "NDArray[Any]"]:
    """Return the arrays of an archive (.npz) that others may have made, after checking its headers."""
    import numpy as np

    try:
        data = read_bounded(path, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        _require_size(data)
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files if only is None or name in only}
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    except Exception as error:  # errors of zipfile and numpy for a damaged archive
        raise DataError(f"{path}: is not a readable numpy archive (.npz): {error}") from error


def _require_size(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        unpacked = sum(member.file_size for member in members)
        if unpacked > MOST_RECORD_BYTES:
            raise DataError(f"unpacks to {unpacked / 1e6:.4g} MB, and at most {MOST_RECORD_BYTES / 1e6:.4g} are read")
        for member in members:
            with archive.open(member) as file:
                declared = _declared_bytes(file.read(_MOST_HEADER_BYTES))
            if declared > member.file_size:
                raise DataError(f"{member.filename} declares {declared} bytes and has {member.file_size}")


def _declared_bytes(start: bytes) -> int:
    import numpy as np

    header = io.BytesIO(start)
    version = np.lib.format.read_magic(header)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(header)
    return math.prod(shape) * int(dtype.itemsize)
