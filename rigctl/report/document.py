"""Tables and reports. Each column of a table is declared once: what people read and what programs get.

A table gives itself to programs as CSV, JSON or a data frame, and prints itself on a terminal: upright if it fits, one
line per cell if its numbers would break. A report is a title, a verdict and sections of tables, text and pictures.
`rigctl.report.files` writes both.
"""

from __future__ import annotations

import csv
import importlib
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Flag, auto
from itertools import groupby
from operator import itemgetter
from typing import Any, Generic, Literal, TypeVar

from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table as TerminalTable

from rigctl.base.numbers import finite
from rigctl.console import anonymized

Value = str | float | int | bool | None
Backend = Literal["pandas", "polars"]
RowT = TypeVar("RowT")


class Shown(Flag):
    """Places where a column is written."""

    PAGE = auto()
    TERMINAL = auto()
    CSV = auto()
    JSON = auto()
    PEOPLE = PAGE | TERMINAL
    PROGRAMS = CSV | JSON
    EVERYWHERE = PEOPLE | PROGRAMS


@dataclass(frozen=True, kw_only=True)
class Column(Generic[RowT]):
    """A column of a table, wherever it is written."""

    title: str = ""  #: Heading for people.
    key: str = ""  #: Name for programs, in CSV and JSON; a column without one is for people only.
    #: What programs read of a row; by default its attribute `key`.
    value: Callable[[RowT], Value] | None = None
    #: What people read of a row; by default the value, or nothing if it is None.
    text: Callable[[RowT], str] | None = None
    brief: Callable[[RowT], str] | None = None  #: The text on a terminal, if it differs.
    csv: Callable[[RowT], str] | None = None  #: The value in CSV, if it differs.
    left: bool = False  #: Aligned to the left, as text is; numbers are aligned to the right.
    wide: bool = False  #: Takes the remaining width of a page, and breaks its lines.
    unbroken: bool = False  #: Keeps each cell in one line of a terminal.
    group: str = ""  #: Heading above neighbouring columns of the same group.
    shown: Shown = Shown.EVERYWHERE  #: Where it is written.

    def value_of(self, row: RowT) -> Value:
        """Return the value of a row, for programs."""
        found: Value = getattr(row, self.key) if self.value is None else self.value(row)
        return found

    def text_of(self, row: RowT, where: Shown = Shown.PAGE) -> str:
        """Return the text of a row, for people."""
        if where is Shown.TERMINAL and self.brief is not None:
            return self.brief(row)
        if self.text is not None:
            return self.text(row)
        found = self.value_of(row)
        return "" if found is None else str(found)

    def of(self, part: Callable[[Any], RowT]) -> Column[Any]:
        """Return this column for rows of which it describes a part."""
        return replace(
            self,
            value=lambda row: self.value_of(part(row)),
            text=lambda row: self.text_of(part(row)),
            brief=lambda row: self.text_of(part(row), Shown.TERMINAL),
        )


# A number that does not exist, in words.
_NO_NUMBERS = {"nan": "does not exist", "inf": "no limit", "-inf": "no limit"}
_BETWEEN_COLUMNS = 2


@dataclass(frozen=True, kw_only=True)
class Table(Generic[RowT]):
    """Rows and columns."""

    columns: tuple[Column[RowT], ...]  #: In order.
    rows: tuple[RowT, ...]  #: One record, tuple or mapping each.
    title: str = ""  #: Shown on a terminal; on a page the section has a heading.
    is_off: Callable[[RowT], bool] = lambda _: False  #: Whether a row is highlighted.

    def shown(self, where: Shown) -> tuple[Column[RowT], ...]:
        """Return the columns of one place; programs get only those with a key."""
        found = (column for column in self.columns if where in column.shown)
        return tuple(column for column in found if column.key or where not in Shown.PROGRAMS)

    def texts(self, where: Shown = Shown.PAGE) -> list[tuple[str, ...]]:
        """Return the text of every cell, for people."""
        columns = self.shown(where)
        return [tuple(column.text_of(row, where) for column in columns) for row in self.rows]

    def groups(self) -> list[tuple[str, int]]:
        """Return the headings above groups of columns, each with its number of columns; empty without groups."""
        names = [column.group for column in self.shown(Shown.PAGE)]
        return [(name, len(list(same))) for name, same in groupby(names)] if any(names) else []

    def csv(self) -> str:
        """Return the columns for programs as CSV, with all digits; missing numbers are empty."""
        columns = self.shown(Shown.CSV)
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(column.key for column in columns)
        writer.writerows([_csv_cell(column, row) for column in columns] for row in self.rows)
        return text.getvalue()

    def json(self) -> list[dict[str, Value]]:
        """Return the columns for programs, one object per row; missing and infinite numbers are null."""
        columns = self.shown(Shown.JSON)
        return [{column.key: finite(column.value_of(row)) for column in columns} for row in self.rows]

    def data_frame(self, backend: Backend = "pandas") -> Any:
        """Return the columns for programs as a data frame of pandas or polars."""
        if backend not in ("pandas", "polars"):
            raise ValueError(f"backend is {backend!r}; allowed are pandas, polars")
        columns = {column.key: [column.value_of(row) for row in self.rows] for column in self.shown(Shown.CSV)}
        return optional(backend).DataFrame(columns)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Show the table; if numbers would break, one line per cell."""
        columns = self.shown(Shown.TERMINAL)
        rows = [[_NO_NUMBERS.get(text, text) for text in row] for row in self.texts(Shown.TERMINAL)]
        least = [_narrowest(column, [row[k] for row in rows]) for k, column in enumerate(columns)]
        room = options.max_width - _BETWEEN_COLUMNS * (len(columns) - 1)
        yield self._upright(columns, rows, least, room) if sum(least) <= room else self._turned(columns, rows)

    def _upright(
        self, columns: tuple[Column[Any], ...], rows: list[list[str]], least: list[int], room: int
    ) -> TerminalTable:
        shown = self._empty()
        widths = [max(map(len, (column.title, *(row[k] for row in rows)))) for k, column in enumerate(columns)]
        while sum(widths) > room:  # the widest column that can break gives way
            widths[max((k for k, width in enumerate(widths) if width > least[k]), key=widths.__getitem__)] -= 1
        for column, width in zip(columns, widths, strict=True):
            shown.add_column(column.title, justify="left" if column.left else "right", width=width)
        for row in rows:
            shown.add_row(*row)
        return shown

    def _turned(self, columns: tuple[Column[Any], ...], rows: list[list[str]]) -> TerminalTable:
        shown = self._empty()
        shown.show_header = False
        shown.add_column()
        shown.add_column()
        for row in rows:
            for column, text in zip(columns, row, strict=True):
                if text:
                    shown.add_row(column.title, text)
            shown.add_row()
        return shown

    def _empty(self) -> TerminalTable:
        return TerminalTable(title=self.title or None, title_justify="left", box=None, pad_edge=False)


AnyTable = Table[Any]


def text_columns(*titles: str, left: tuple[int, ...] = (0,), wide: int | None = None) -> tuple[Column[Any], ...]:
    """Return columns, for people only, of rows that are tuples of text."""
    return tuple(
        Column[Any](title=title, text=itemgetter(k), left=k in left, wide=k == wide) for k, title in enumerate(titles)
    )


def value_columns(*keys: str) -> tuple[Column[Any], ...]:
    """Return columns, for programs only, of rows that are tuples or arrays of values."""
    return tuple(Column[Any](key=key, value=itemgetter(k)) for k, key in enumerate(keys))


def _csv_cell(column: Column[Any], row: Any) -> Value:
    value = column.csv(row) if column.csv is not None else column.value_of(row)
    if isinstance(value, str):
        return anonymized(value)
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value


def optional(name: str) -> Any:
    """Return an optional package."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"{name} is not installed; install it with: pip install 'rigctl[notebook]'") from error


def _narrowest(column: Column[Any], texts: list[str]) -> int:
    """Return the least width of a column: headings and texts break between words, a number is never torn."""
    words = column.title.split()
    for text in texts:
        words += [text] if column.unbroken else text.split()
    return max(map(len, words), default=0)


class Verbatim(str):
    """Text that keeps its lines."""

    __slots__ = ()


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure as PNG, with its caption."""

    png: bytes
    caption: str = ""


# A paragraph, a list of texts, a text that keeps its lines, a table, a picture, or pictures next to each other.
Block = str | tuple[str, ...] | Verbatim | AnyTable | Picture | tuple[Picture, ...]


def block_kind(block: Block) -> str:
    """Return "verbatim", "paragraph", "table", "picture", "pictures" or "bullets"."""
    if isinstance(block, str):
        return "verbatim" if isinstance(block, Verbatim) else "paragraph"
    if isinstance(block, tuple):
        return "pictures" if block and isinstance(block[0], Picture) else "bullets"
    return "table" if isinstance(block, Table) else "picture"


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and its content."""

    title: str  #: empty for the content directly after the verdict
    blocks: tuple[Block, ...]
    folded: bool = False  #: initially closed on a page
    printed: bool = True  #: is in the PDF


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole report; a verdict comes first."""

    title: str
    source: str  #: a line below the title
    sections: Sequence[Section]
    verdict: str = ""  #: the judgement in a sentence, if there is one
    good: bool = True  #: its colour
    reasons: tuple[tuple[str, str], ...] = ()  #: of the verdict: a word in bold (or nothing) and a text
