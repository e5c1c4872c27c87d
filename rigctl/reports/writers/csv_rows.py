"""A table as CSV: one row a line, what does not exist is empty."""

import csv
import io
import math
from typing import Any

from rigctl.reports.table import AnyTable, Column, Shown, Value


def csv_rows(table: AnyTable, *, line_end: str = "\n") -> bytes:
    """Return the columns that programs read as CSV, every number with all its digits."""
    columns = table.shown(Shown.CSV)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerow(column.key for column in columns)
    writer.writerows([_cell(column, row) for column in columns] for row in table.rows)
    return text.getvalue().encode()


def _cell(column: Column[Any], row: Any) -> Value:
    if column.csv is not None:
        return column.csv(row)
    value = column.value_of(row)
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value
