"""Packages that are not needed for the rest: imported when asked for, named with their pip line where missing."""

import importlib
from typing import Any, Literal

Backend = Literal["pandas", "polars"]
BACKENDS = ("pandas", "polars")


def optional(name: str) -> Any:
    """Return an optional package.

    Raises
    ------
    ImportError
        It is not installed; the text has the line that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"{name} is not installed; install it with: pip install 'rigctl[notebook]'") from error
