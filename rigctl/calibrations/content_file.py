"""Calibration files in JSON: written whole or not at all, read once all that the program uses has been found right."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from rigctl.errors import ConfigError, DataError
from rigctl.files.config import describe
from rigctl.storage.bounded_file import MOST_RECORD_BYTES, read_bounded
from rigctl.storage.durable_file import write_durably

Record = TypeVar("Record")


def write_content(path: Path, content: Mapping[str, Any]) -> None:
    """Write a calibration: whole under its name, or not at all. A file that is there is replaced.

    Raises
    ------
    ConfigError
        The file cannot be written there.
    """
    write_whole(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode("ascii"))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file of a calibration: whole under its name, or not at all.

    Raises
    ------
    ConfigError
        The file cannot be written there.
    """
    try:
        write_durably(path, data)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; its folder has to exist") from error


def read_record(path: Path, record: type[Record], *, made_by: str) -> Record:
    """Return the record of a calibration file.

    Parameters
    ----------
    path : Path
        The file. Keys that the record does not have are for those who put them there.
    record : type
        A frozen dataclass: its annotations say what has to be right.
    made_by : str
        What makes such a file, for the message, such as "a noise calibration is made by `rigctl calibrate noise`".

    Raises
    ------
    DataError
        The file cannot be read, or is not as the record says: every problem at once, each with its key.
    """
    try:
        text = read_bounded(path, MOST_RECORD_BYTES)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return TypeAdapter(record).validate_json(text)
    except ValidationError as error:
        raise DataError(f"{describe(path, error)}\n  {made_by}") from error
