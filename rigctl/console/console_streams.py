"""Standard output and error that may go away: a closed pipe, a full disk or a lost terminal ends no work."""

import errno
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

_KEPT = frozenset("\n\t")
# What a reader of a pipe or a terminal that is gone looks like; it needs no word.
_GONE = frozenset({errno.EPIPE, errno.EIO})


class LastingStream:
    """A text stream whose first failure is kept, and whose later output goes nowhere.

    Parameters
    ----------
    stream : text stream
        What is written to.

    Attributes
    ----------
    failure : OSError or None
        What became of it.
    """

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text, as far as it can be written; return its length."""
        with self._forgiven():
            self._stream.write(text)
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write texts one after the other."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Hand on what is buffered, as far as it can be written."""
        with self._forgiven():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        """Return what the stream itself has: its encoding, whether it is a terminal."""
        return getattr(self._stream, name)

    @contextmanager
    def _forgiven(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error
            _lead_nowhere(self._stream)


def _lead_nowhere(stream: IO[str]) -> None:
    """Make what is still buffered, and all that follows, go to no file, so that the end of the program is quiet."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, stream.fileno())
        finally:
            os.close(nowhere)


def _nowhere() -> IO[str]:
    return Path(os.devnull).open("w", encoding="utf-8")


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Keep this process's standard output and error alive within; say afterwards where a result could not be written.

    Notes
    -----
    A pipe that was closed (``rigctl status RUN --log | head -1``) and a terminal that is gone need no word. Exit codes
    stay what the work itself gives: who fills a disk with an answer is told on standard error.
    """
    # A stream that was closed before the program began is None.
    given = tuple(stream or _nowhere() for stream in (sys.stdout, sys.stderr))
    out, err = LastingStream(given[0]), LastingStream(given[1])
    for stream in given:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    sys.stdout, sys.stderr = out, err
    try:
        yield
    finally:
        out.flush()
        if out.failure is not None and out.failure.errno not in _GONE:
            err.write(f"rigctl: standard output cannot be written: {out.failure.strerror}; the answer is not whole\n")
        err.flush()
        sys.stdout, sys.stderr = given


def visible(text: str) -> str:
    r"""Return a text that a terminal shows and does not obey: control characters as ``\x1b``, lines and tabs kept.

    Parameters
    ----------
    text : str
        May hold names from files of others: of events, materials, regions, cameras.
    """
    return text if text.isprintable() else "".join(map(_visible_character, text))


def _visible_character(character: str) -> str:
    if character in _KEPT or unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp"):
        return character
    return character.encode("unicode_escape").decode("ascii")
