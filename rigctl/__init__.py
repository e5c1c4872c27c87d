"""Instrument control, sensor calibration and model validation for division-of-time polarimetry.

The names below are the Python interface (docs/python.md). Each is imported when it is first asked for, so that
``import rigctl`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.interface.calls import (
        acquire,
        compare,
        load_noise,
        load_polarizer,
        load_rig,
        load_scene,
        predict,
        sky,
        stokes,
        surface,
        sweep,
    )
    from rigctl.interface.run import open_run

__all__ = [
    "acquire",
    "compare",
    "load_noise",
    "load_polarizer",
    "load_rig",
    "load_scene",
    "open_run",
    "predict",
    "sky",
    "stokes",
    "surface",
    "sweep",
]


def __getattr__(name: str) -> Any:
    """Return a name of the interface, imported now."""
    if name not in __all__:
        raise AttributeError(f"module 'rigctl' has no attribute {name!r}")
    found = getattr(importlib.import_module("rigctl.interface.calls"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
