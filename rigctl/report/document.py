"""Parts of a report in any format: sections of text, tables, lists and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.report.table import AnyTable


@dataclass(frozen=True, kw_only=True)
class Paragraph:
    """Plain text."""

    text: str


@dataclass(frozen=True, kw_only=True)
class Bullets:
    """A list of plain texts."""

    items: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Terms:
    """Names, each with what there is to say of it."""

    items: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure as PNG for all writers, with its caption."""

    png: bytes
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """Pictures next to each other if there is room."""

    pictures: tuple[Picture, ...]


@dataclass(frozen=True, kw_only=True)
class Verbatim:
    """Text that keeps its lines."""

    text: str


Block = Paragraph | Bullets | Terms | AnyTable | Picture | Pictures | Verbatim


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and its content.

    `folded` sections are initially closed on a page; only `printed` ones are in the PDF.
    """

    title: str  #: empty for the content directly after the verdict
    blocks: tuple[Block, ...]
    folded: bool = False
    printed: bool = True


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Judgement of a report, which one reads first."""

    good: bool  #: Its colour.
    text: str  #: In a sentence.
    reasons: tuple[tuple[str, str], ...] = ()  #: A word in bold (or nothing) and a text.


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole report."""

    title: str  #: Heading, and what it is a report of.
    source: str
    sections: Sequence[Section]  #: What it says.
    verdict: Verdict | None = None  #: The verdict, if there is one.
