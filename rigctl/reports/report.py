"""What a report is made of, whatever it is written as: sections of text, tables, lists and pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

NOTHING = "–"


@dataclass(frozen=True, kw_only=True)
class Paragraph:
    """Plain text."""

    text: str


@dataclass(frozen=True, kw_only=True)
class Bullets:
    """A list of plain texts."""

    items: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of text under a header.

    Attributes
    ----------
    header : tuple of str
        Of the columns.
    rows : tuple of tuple of str
        As many cells each.
    off : tuple of bool
        Rows that are to be seen at once.
    left : tuple of int
        Columns of text, set to the left; numbers are set to the right.
    wide : int or None
        Column that takes the width that is left, and breaks its lines.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    off: tuple[bool, ...] = ()
    left: tuple[int, ...] = (0,)
    wide: int | None = None

    def is_off(self, row: int) -> bool:
        """Whether a row is to be seen at once."""
        return row < len(self.off) and self.off[row]


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure as PNG, with its caption."""

    png: bytes
    caption: str


@dataclass(frozen=True, kw_only=True)
class Verbatim:
    """Text that keeps its lines."""

    text: str


Block = Paragraph | Bullets | Table | Picture | Verbatim


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and what stands under it.

    `folded` ones are closed at first where a page can be.
    """

    title: str
    blocks: tuple[Block, ...]
    folded: bool = False


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole report.

    Attributes
    ----------
    title, source : str
        Heading, and what it is a report of.
    good : bool
        Colour of the verdict.
    verdict : str
        What one reads first.
    reasons : tuple of (str, str)
        What it says beside: a word in bold (or nothing) and a text.
    sections : tuple of Section
        The rest.
    """

    title: str
    source: str
    good: bool
    verdict: str
    reasons: tuple[tuple[str, str], ...]
    sections: Sequence[Section]
