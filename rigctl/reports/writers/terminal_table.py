"""A table as the terminal shows it."""

from rich.table import Table as TerminalTable

from rigctl.reports.table import AnyTable, Shown

# A number that does not exist, in words.
_NO_NUMBERS = {"nan": "does not exist", "inf": "no limit", "-inf": "no limit"}


def terminal_table(table: AnyTable) -> TerminalTable:
    """Return a table for a console."""
    shown = TerminalTable(title=table.title or None, title_justify="left", box=None, pad_edge=False)
    for column in table.shown(Shown.TERMINAL):
        shown.add_column(column.title, justify="left" if column.left else "right", no_wrap=column.unbroken)
    for row in table.texts(Shown.TERMINAL):
        shown.add_row(*(_NO_NUMBERS.get(text, text) for text in row))
    return shown
