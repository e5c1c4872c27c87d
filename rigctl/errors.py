"""What the application itself refuses. One table in ``rigctl.cli`` maps each to its exit code."""


class ConfigError(Exception):
    """A command line or a file that people write is wrong; the text names every problem of it."""


class DataError(Exception):
    """Data are unfit for what was asked: refused, damaged, or missing."""


class RunFolderError(DataError):
    """A run folder, or a frame in it, is not what it must be."""
