"""A file of lines that only grows, each on the disk before the next begins."""

import os
from collections.abc import Sequence
from pathlib import Path

from rigctl.runs.sealed_lines import read_lines, sealed
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded


class Journal:
    """A file of lines, opened for adding to it.

    Parameters
    ----------
    path : Path
        The file; made where it is not there. A last line without an end, as a killed writer leaves it, is cut
        off.
    first_link : str or None
        What the chain of its lines begins with; None for a journal without seals, as old runs have them.

    Attributes
    ----------
    lines : int
        How many lines there are.
    link : str or None
        The chain after all of them.

    Raises
    ------
    OSError
        The file cannot be opened or written.
    """

    def __init__(self, path: Path, *, first_link: str | None) -> None:
        present = read_bounded(path, MOST_RECORD_BYTES) if path.exists() else b""
        whole = present[: present.rfind(b"\n") + 1]
        self.lines = whole.count(b"\n")
        self.link = first_link if first_link is None else read_lines(whole, first_link).links[-1]
        self._length = len(whole)
        self._file = path.open("ab", buffering=0)
        self._file.truncate(self._length)

    def append(self, contents: Sequence[bytes]) -> None:
        """Return once the lines are on the disk.

        Parameters
        ----------
        contents : sequence of bytes
            JSON objects, one a line, without the ends of the lines.

        Raises
        ------
        OSError
            They could not be written; the file is as it was.
        """
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
        # A file without a buffer may take less than it is given.
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]

    def close(self) -> None:
        """Close the file. May be called twice."""
        self._file.close()
