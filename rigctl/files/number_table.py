"""Tables of numbers that people write as CSV: a header line, then numbers."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError


def read_number_table(
    path: Path, *, needs: Sequence[str], may_have: Sequence[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a CSV file by name; columns of other names are left out.

    Raises
    ------
    ConfigError
        The file cannot be read, lacks a column or a row, or a cell is not a finite number.
    """
    try:
        lines = list(csv.reader(read_bounded(path, MOST_TEXT_BYTES).decode("utf-8-sig").splitlines()))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is no text of commas and lines: {error}") from error
    header = [name.strip() for name in lines[0]] if lines else []
    lacking = [name for name in needs if name not in header]
    if lacking:
        raise ConfigError(f"{path}: lacks the column {', '.join(lacking)}; its first line must name {','.join(needs)}")
    at = [(name, header.index(name)) for name in (*needs, *may_have) if name in header]
    rows = [[_number(path, k, name, row, i) for name, i in at] for k, row in enumerate(lines[1:], start=2) if row]
    if not rows:
        raise ConfigError(f"{path}: has no row of numbers under its first line")
    return dict(zip((name for name, _ in at), np.array(rows).T, strict=True))


def _number(path: Path, line: int, name: str, row: Sequence[str], index: int) -> float:
    text = row[index].strip() if index < len(row) else ""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"{path}, line {line}: {name} is {text or 'empty'!r}, must be a finite number")
    return number
