"""A table as the terminal shows it: upright where it fits, turned where its numbers would break."""

from dataclasses import dataclass
from typing import Any, Literal

from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table as TerminalTable

from rigctl.reports.table import AnyTable, Column, Shown

# A number that does not exist, in words.
_NO_NUMBERS = {"nan": "does not exist", "inf": "no limit", "-inf": "no limit"}
_BETWEEN_COLUMNS = 2


@dataclass(frozen=True, kw_only=True)
class FittingTable:
    """A table that a console shows by the room that it has."""

    table: AnyTable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Show the table, or each row as a list of its columns where numbers would have to break."""
        columns = self.table.shown(Shown.TERMINAL)
        rows = [[_NO_NUMBERS.get(text, text) for text in row] for row in self.table.texts(Shown.TERMINAL)]
        needed = sum(_narrowest(column, [row[k] for row in rows]) for k, column in enumerate(columns))
        if needed + _BETWEEN_COLUMNS * (len(columns) - 1) <= options.max_width:
            yield self._upright(columns, rows)
        else:
            yield self._turned(columns, rows)

    def _upright(self, columns: tuple[Column[Any], ...], rows: list[list[str]]) -> TerminalTable:
        shown = self._empty()
        for k, column in enumerate(columns):
            least = _narrowest(column, [row[k] for row in rows])
            justify: Literal["left", "right"] = "left" if column.left else "right"
            shown.add_column(column.title, justify=justify, no_wrap=column.unbroken, min_width=least)
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
        return TerminalTable(title=self.table.title or None, title_justify="left", box=None, pad_edge=False)


def terminal_table(table: AnyTable) -> FittingTable:
    """Return a table for a console."""
    return FittingTable(table=table)


def _narrowest(column: Column[Any], texts: list[str]) -> int:
    """Return the least width of a column: headings and texts break between words, a number is never torn."""
    words = column.title.split()
    for text in texts:
        words += [text] if column.unbroken else text.split()
    return max(map(len, words), default=0)
