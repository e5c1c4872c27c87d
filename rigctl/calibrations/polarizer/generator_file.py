"""Angles of the generator of a polarizer scan: a TOML or a CSV file."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rigctl.errors import ConfigError, DataError
from rigctl.files.config import Section, load
from rigctl.numbers.number_range import wild_numbers
from rigctl.runs.frame_record import FrameRecord
from rigctl.storage.bounded_file import MOST_TEXT_BYTES, read_bounded

GeneratorAngle = Callable[[FrameRecord], float]

_CSV_KEYS = ("sequence", "cycle")
_ANGLE = "angle_deg"


class _GeneratorFile(Section):
    schema_version: Literal[1] = 1
    angle_deg: Annotated[list[float], Field(min_length=4)]


def load_generator(path: Path) -> GeneratorAngle:
    """Return what says a frame's generator angle [deg].

    Parameters
    ----------
    path : Path
        ``.csv`` with the columns ``angle_deg`` and either ``cycle`` or ``sequence`` (the frame's number in the run);
        or TOML with ``angle_deg = [...]``, one for each cycle of the run. Angles are of the transmission axis,
        counter-clockwise from horizontal as the camera sees the scene.

    Raises
    ------
    ConfigError
        The file cannot be read, or is wrong.
    """
    key, table = _read_csv(path) if path.suffix.lower() == ".csv" else ("cycle", _read_toml(path))

    def angle_deg(record: FrameRecord) -> float:
        number = record.cycle if key == "cycle" else record.sequence
        if number is None or number not in table:
            raise DataError(f"{path}: has no generator angle for frame {record.sequence} ({key} {number})")
        return table[number]

    return angle_deg


def _read_toml(path: Path) -> dict[int, float]:
    return dict(enumerate(load(path, _GeneratorFile).angle_deg))


def _read_csv(path: Path) -> tuple[str, dict[int, float]]:
    try:
        rows = list(csv.DictReader(io.StringIO(read_bounded(path, MOST_TEXT_BYTES).decode("utf-8"))))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is no text of commas and lines: {error}") from error
    columns = set(rows[0]) if rows else set()
    keys = [key for key in _CSV_KEYS if key in columns]
    if len(keys) != 1 or _ANGLE not in columns:
        raise ConfigError(f"{path}: needs the column {_ANGLE} and one of {', '.join(_CSV_KEYS)} in its first line")
    try:
        angles = {int(row[keys[0]]): float(row[_ANGLE]) for row in rows}
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}; wanted are whole numbers of {keys[0]} and angles in degrees") from error
    wild = [f"{key}: {problem}" for key, problem in wild_numbers(angles, _ANGLE)]
    if wild:
        raise ConfigError("\n  ".join([f"{path}:", *wild]))
    return keys[0], angles
