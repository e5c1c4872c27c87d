"""The rows of comparisons as CSV."""

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

from rigctl.comparison.rows import Row

_COLUMNS = tuple(field.name for field in fields(Row))


def rows_csv(rows: Iterable[Row], facts: Iterable[Mapping[str, Any]] | None = None) -> str:
    """Return rows as CSV: one number a line; what does not exist is empty.

    Parameters
    ----------
    rows : iterable of Row
        Of one comparison or several.
    facts : iterable of mapping or None
        What stands before each row, such as its run and the sun; the same keys for all.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    before = None if facts is None else list(facts)
    writer.writerow((*(() if not before else before[0]), *_COLUMNS))
    for k, row in enumerate(rows):
        own = () if before is None else tuple(before[k].values())
        writer.writerow(_text(value) for value in (*own, *(getattr(row, name) for name in _COLUMNS)))
    return buffer.getvalue()


def _text(value: Any) -> Any:
    return "" if value is None else value
