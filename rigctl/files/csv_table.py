"""Tables that people write as CSV: rows as texts by the names of their columns."""

import csv
import io
from pathlib import Path

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError


def csv_rows(path: Path) -> list[dict[str, str | None]]:
    """Return the rows of a table below its first line, which names the columns; ConfigError if it cannot be read."""
    try:
        text = read_bounded(path, MOST_TEXT_BYTES).decode("utf-8-sig")
        return list(csv.DictReader(io.StringIO(text, newline="")))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is no text of commas and lines: {error}") from error
