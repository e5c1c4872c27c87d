"""Results as files for programs: tables as CSV and JSON, images as FITS."""

import csv
import io
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.console.anonymity import told, told_content
from rigctl.console.json_text import Json, json_text
from rigctl.reports.table import AnyTable, Column, Shown, Value
from rigctl.runs.fits.fits_card import CardValue
from rigctl.runs.fits.fits_frame import encode_image
from rigctl.version import VERSION


def csv_rows(table: AnyTable, *, line_end: str = "\n") -> bytes:
    """Return the columns that programs read as CSV, every number with all its digits."""
    columns = table.shown(Shown.CSV)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerow(column.key for column in columns)
    writer.writerows([_cell(column, row) for column in columns] for row in table.rows)
    return text.getvalue().encode()


def _cell(column: Column[Any], row: Any) -> Value:
    value = column.csv(row) if column.csv is not None else column.value_of(row)
    if isinstance(value, str):
        return told(value)
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value


def json_rows(table: AnyTable) -> list[dict[str, Value]]:
    """Return the columns that programs read, an object a row."""
    columns = table.shown(Shown.JSON)
    return [{column.key: finite(column.value_of(row)) for column in columns} for row in table.rows]


def finite(value: Value) -> Value:
    """Return a value that JSON can hold: infinity (an ideal polarizer) and what does not exist are null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def json_file(content: Mapping[str, Json], *, indent: int | None = 2) -> bytes:
    """Return the content of a JSON file."""
    return json_text(told_content(content), indent=indent).encode()


def fits_image(image: NDArray[np.generic], *, unit: str, what: str) -> bytes:
    """Return an image, or a stack of them, as the bytes of a FITS file.

    Parameters
    ----------
    image : (..., H, W) array
        First row on top.
    unit : str
        Of the samples; empty for none.
    what : str
        What the samples are, up to 60 characters or so.
    """
    cards: dict[str, tuple[CardValue, str]] = {
        "BUNIT": (unit, "unit of the samples"),
        "ROWORDER": ("TOP-DOWN", "first row is the top of the picture"),
        "CONTENT": (what, ""),
        "SWVER": (f"rigctl {VERSION}", ""),
    }
    return encode_image(image, cards)
