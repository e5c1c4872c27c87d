"""Results as JSON: rows of tables, numbers that JSON cannot hold as null."""

import math
from collections.abc import Mapping
from typing import Any

from rigctl.console.json_text import json_text
from rigctl.reports.table import AnyTable, Shown, Value


def json_rows(table: AnyTable) -> list[dict[str, Value]]:
    """Return the columns that programs read, an object a row."""
    columns = table.shown(Shown.JSON)
    return [{column.key: finite(column.value_of(row)) for column in columns} for row in table.rows]


def finite(value: Value) -> Value:
    """Return a value that JSON can hold: infinity (an ideal polarizer) and what does not exist are null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_file(content: Mapping[str, Any], *, indent: int | None = 2) -> bytes:
    """Return the content of a JSON file."""
    return json_text(content, indent=indent).encode()
