"""What the application itself refuses. One table in ``rigctl.console`` maps each to its exit code."""

from collections.abc import Iterator
from contextlib import contextmanager


class ConfigError(Exception):
    """A command line or a file that people write is wrong; the text names every problem of it."""


class DataError(Exception):
    """Data are unfit for what was asked: refused, damaged, or missing."""


class RunFolderError(DataError):
    """A run folder, or a frame in it, is not what it must be."""


@contextmanager
def as_config_error(where: str) -> Iterator[None]:
    """Raise ValueErrors of the model as ConfigErrors about a file, such as ``scene roof``."""
    try:
        yield
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error
