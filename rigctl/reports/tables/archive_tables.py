"""Rows of an archive as a table."""

from collections.abc import Callable, Mapping, Sequence

from rigctl.archive.columns import COLUMNS, IndexColumn
from rigctl.archive.run_facts import Fact
from rigctl.reports.table import Column, Shown, Table

# What fits a terminal; programs get all.
_FOR_PEOPLE = ("run", "utc", "sun_zenith", "state", "verdict", "region", "dolp", "dolp_sigma", "aolp_deg")
_UTC_MINUTES = 16
_Row = Mapping[str, Fact]


def found_table(rows: Sequence[_Row]) -> Table[_Row]:
    """Return rows of an archive, every column of the index for programs."""
    return Table(columns=tuple(map(_column, COLUMNS)), rows=tuple(rows))


def _column(column: IndexColumn) -> Column[_Row]:
    shown = Shown.EVERYWHERE if column.name in _FOR_PEOPLE else Shown.PROGRAMS
    return Column(
        title=column.name,
        key=column.name,
        value=lambda row: row[column.name],
        text=_text(column.name),
        left=column.kind == "text",
        shown=shown,
    )


def _text(name: str) -> Callable[[_Row], str]:
    def text(row: _Row) -> str:
        value = row[name]
        if value is None:
            return ""
        if isinstance(value, str):
            return value[:_UTC_MINUTES] if name == "utc" else value
        return f"{value:.5g}"

    return text
