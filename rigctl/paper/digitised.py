"""Points of the paper's own figures, read off by somebody who has them."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded

COLUMNS = ("figure", "panel", "label", "x", "y")


@dataclass(frozen=True, kw_only=True)
class DigitisedPoint:
    """A point: number of the figure, letter of its panel (empty for all), which curve, and where."""

    figure: int
    panel: str
    label: str
    x: float
    y: float


def read_digitised(path: Path) -> tuple[DigitisedPoint, ...]:
    """Return the points of a CSV file with the columns figure, panel, label, x, y.

    Raises
    ------
    ConfigError
        It cannot be read, lacks a column, or a row is no point.
    """
    try:
        rows = list(csv.DictReader(read_bounded(path, MOST_TEXT_BYTES).decode("utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    if not rows or not set(COLUMNS) <= set(rows[0]):
        raise ConfigError(f"{path}: needs a first line {','.join(COLUMNS)} and a point a line")
    return tuple(_point(path, line, row) for line, row in enumerate(rows, start=2))


def _point(path: Path, line: int, row: dict[str, str]) -> DigitisedPoint:
    try:
        x, y = float(row["x"]), float(row["y"])
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ValueError("x and y must be finite")
        return DigitisedPoint(figure=int(row["figure"]), panel=row["panel"].strip(), label=row["label"], x=x, y=y)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}, line {line}: {error}") from error
