"""A file of lines that only grows, each on the disk before the next begins."""

import os
from pathlib import Path


class Journal:
    """A file of lines, opened for adding to it.

    Parameters
    ----------
    path : Path
        The file; made where it is not there. A last line without an end, as a killed writer leaves it, is cut
        off.

    Attributes
    ----------
    lines : int
        How many lines there are.

    Raises
    ------
    OSError
        The file cannot be opened or written.
    """

    def __init__(self, path: Path) -> None:
        present = path.read_bytes() if path.exists() else b""
        whole = present[: present.rfind(b"\n") + 1]
        self.lines = whole.count(b"\n")
        self._length = len(whole)
        self._file = path.open("ab", buffering=0)
        self._file.truncate(self._length)

    def append(self, lines: bytes) -> None:
        """Return once the lines are on the disk.

        Raises
        ------
        OSError
            They could not be written; the file is as it was.
        """
        try:
            self._write_all(lines)
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(self._length)
            raise
        self._length += len(lines)
        self.lines += lines.count(b"\n")

    def _write_all(self, data: bytes) -> None:
        # A file without a buffer may take less than it is given.
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]

    def close(self) -> None:
        """Close the file. May be called twice."""
        self._file.close()
