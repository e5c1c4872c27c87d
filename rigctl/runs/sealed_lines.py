"""Lines that carry their own checksum and the chain of all before them: a line changed, moved or taken out is found."""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import RunFolderError
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded

_SEAL = re.compile(rb', "line_sha256": "([0-9a-f]{64})", "chain_sha256": "([0-9a-f]{64})"\}$')


@dataclass(frozen=True, kw_only=True)
class Line:
    """One line of a journal.

    Attributes
    ----------
    content : bytes
        What was written, without its seal; empty where the line is damaged.
    problem : str or None
        What is wrong with it or with its place.
    """

    content: bytes
    problem: str | None = None


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Lines of a journal, as they are read.

    Attributes
    ----------
    lines : tuple of Line
        In the order of the file.
    links : tuple of str
        The chain after 0, 1, 2, ... lines; empty for journals of old runs, which have none.
    is_torn : bool
        What follows the last line has no end: the writer was killed in the middle of it.
    """

    lines: tuple[Line, ...]
    links: tuple[str, ...]
    is_torn: bool

    @property
    def begins_elsewhere(self) -> bool:
        """True where the first line does not follow on what the chain begins with."""
        return bool(self.lines and self.links) and self.lines[0].problem == _NOT_FOLLOWING


_NOT_FOLLOWING = "does not follow on what stands before it: lines were taken out, put in or moved"


def sealed(content: bytes, link: str) -> tuple[bytes, str]:
    """Return a line with its seal, and the chain after it.

    Parameters
    ----------
    content : bytes
        A JSON object on one line, without the end of the line.
    link : str
        The chain before it.
    """
    own = hashlib.sha256(content).hexdigest()
    after = _link(link, own)
    return content[:-1] + f', "line_sha256": "{own}", "chain_sha256": "{after}"}}\n'.encode("ascii"), after


def sealed_all(contents: Iterable[bytes], link: str | None) -> bytes:
    """Return the whole of a journal; without a chain to begin with, its lines as they are."""
    lines = []
    for content in contents:
        line = content + b"\n"
        if link is not None:
            line, link = sealed(content, link)
        lines.append(line)
    return b"".join(lines)


def journal_bytes(file: Path) -> bytes:
    """Return the bytes of a journal; none where there is no such file.

    Raises
    ------
    RunFolderError
        The file cannot be read.
    """
    try:
        return read_bounded(file, MOST_RECORD_BYTES) if file.exists() else b""
    except OSError as error:
        raise RunFolderError(f"{file}: cannot be read: {error.strerror}") from error


def read_lines(data: bytes, first_link: str | None) -> Lines:
    """Return the lines of a journal, each held against its seal.

    Parameters
    ----------
    data : bytes
        The whole file.
    first_link : str or None
        What the chain begins with; None for journals of old runs, whose lines have no seal.
    """
    whole, end, rest = data.rpartition(b"\n")
    raw = whole.split(b"\n") if end else []
    if first_link is None:
        return Lines(lines=tuple(Line(content=line) for line in raw), links=(), is_torn=bool(rest))
    links = [first_link]
    lines = []
    for text in raw:
        line, link = _read_line(text, links[-1])
        lines.append(line)
        links.append(link)
    return Lines(lines=tuple(lines), links=tuple(links), is_torn=bool(rest))


def first_link_of(data: bytes) -> str | None:
    """Return what to read a journal from whose beginning of the chain is not known: None where it has no seals."""
    return "" if _SEAL.search(data.partition(b"\n")[0]) else None


def _read_line(text: bytes, link: str) -> tuple[Line, str]:
    seal = _SEAL.search(text)
    if seal is None:
        return Line(content=b"", problem="has no seal, or a damaged one"), link
    content = text[: seal.start()] + b"}"
    own, after = seal[1].decode("ascii"), seal[2].decode("ascii")
    if hashlib.sha256(content).hexdigest() != own:
        return Line(content=b"", problem="damaged: its checksum is another"), after
    return Line(content=content, problem=None if _link(link, own) == after else _NOT_FOLLOWING), after


def _link(before: str, own: str) -> str:
    return hashlib.sha256(f"{before} {own}".encode("ascii")).hexdigest()
