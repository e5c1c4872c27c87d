"""CSV tables: a header line, then rows of texts or of numbers.

Wrong cells of a table of numbers are reported at once, each with its line, up to twenty. Its lines that begin with #
are skipped.
"""

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError

Columns = dict[str, NDArray[np.float64]]
#: Rows of a table with their line numbers; the first is the header.
Lines = list[tuple[int, list[str]]]
#: Name of a column, rows with wrong numbers, and the words after "must".
Problem = tuple[str, NDArray[np.bool_], str]
_MOST_PROBLEMS = 20
_Row = TypeVar("_Row")


def csv_rows(path: Path) -> list[dict[str, str | None]]:
    """Return the rows of a table below its header; ConfigError if it cannot be read."""
    return _read(path, csv.DictReader)


def read_number_table(path: Path, *, needs: Sequence[str], may_have: Sequence[str] = ()) -> Columns:
    """Return the requested columns of a CSV file by name.

    Raises
    ------
    ConfigError
        The file cannot be read, lacks a column or a row, or cells are not finite numbers.
    """
    return columns_of(path, csv_lines(path), needs=needs, may_have=may_have)


def csv_lines(path: Path) -> Lines:
    """Return the lines of a CSV file that are neither empty nor comments."""
    rows = enumerate(_read(path, csv.reader), start=1)
    return [(k, row) for k, row in rows if "".join(row).strip() and not row[0].startswith("#")]


def _read(path: Path, reader: Callable[[Iterable[str]], Iterable[_Row]]) -> list[_Row]:
    try:
        text = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8-sig")
        return list(reader(io.StringIO(text, newline="")))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a CSV file: {error}") from error


def header_of(lines: Lines) -> list[str]:
    """Return the names of the columns."""
    return [name.strip() for name in lines[0][1]] if lines else []


def columns_of(
    path: Path,
    lines: Lines,
    *,
    needs: Sequence[str],
    may_have: Sequence[str] = (),
    problems_of: Callable[[Columns], Iterable[Problem]] = lambda _: (),
) -> Columns:
    """Return columns as numbers; `problems_of` finds numbers out of range."""
    header, rows = header_of(lines), lines[1:]
    lacking = [name for name in needs if name not in header]
    if lacking:
        raise ConfigError(f"{path}: lacks the column {', '.join(lacking)}; its first line must name {','.join(needs)}")
    if not rows:
        raise ConfigError(f"{path}: has no row of numbers under its first line")
    problems: list[str] = []

    def number(line: int, row: Sequence[str], name: str) -> float:
        place = header.index(name)
        text = row[place].strip() if place < len(row) else ""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            problems.append(f"line {line}: {name} is {text or 'empty'!r}, must be a finite number")
        return value

    names = [name for name in (*needs, *may_have) if name in header]
    numbers = [[number(line, row, name) for name in names] for line, row in rows]
    columns = dict(zip(names, np.array(numbers).T, strict=True))
    problems += [
        f"line {rows[k][0]}: {name} is {columns[name][k]:g}, must {words}"
        for name, wrong, words in problems_of(columns)
        for k in np.flatnonzero(wrong & np.isfinite(columns[name]))
    ]
    refuse(path, problems)
    return columns


def refuse(path: Path, problems: Sequence[str]) -> None:
    """Raise ConfigError if there are any problems, with the first twenty."""
    if problems:
        more = [f"and {len(problems) - _MOST_PROBLEMS} more"] if len(problems) > _MOST_PROBLEMS else []
        raise ConfigError(f"{path}:\n  " + "\n  ".join([*problems[:_MOST_PROBLEMS], *more]))
