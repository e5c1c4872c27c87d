"""Instrument control, sensor calibration and model validation for division-of-time polarimetry.

The names below are the Python interface (docs/python.md). Each is imported when it is first asked for, so that
``import rigctl`` costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.calibrations.noise import read_noise_file as load_noise
    from rigctl.calibrations.polarizer import read_polarizer_file as load_polarizer
    from rigctl.files.rig_file import load_rig
    from rigctl.files.scene_file import load_scene
    from rigctl.python import open_archive, open_run
    from rigctl.verbs.compare import compare
    from rigctl.verbs.infer import infer
    from rigctl.verbs.predict import predict, sweep
    from rigctl.verbs.session import acquire
    from rigctl.verbs.sky import sky
    from rigctl.verbs.stokes import stokes
    from rigctl.verbs.surface import surface

__all__ = [
    "acquire",
    "compare",
    "infer",
    "load_noise",
    "load_polarizer",
    "load_rig",
    "load_scene",
    "open_archive",
    "open_run",
    "predict",
    "sky",
    "stokes",
    "surface",
    "sweep",
]


# Module and name of each.
_PLACES = {
    "open_run": ("rigctl.python", "open_run"),
    "acquire": ("rigctl.verbs.session", "acquire"),
    "compare": ("rigctl.verbs.compare", "compare"),
    "infer": ("rigctl.verbs.infer", "infer"),
    "load_noise": ("rigctl.calibrations.noise", "read_noise_file"),
    "load_polarizer": ("rigctl.calibrations.polarizer", "read_polarizer_file"),
    "load_rig": ("rigctl.files.rig_file", "load_rig"),
    "load_scene": ("rigctl.files.scene_file", "load_scene"),
    "open_archive": ("rigctl.python", "open_archive"),
    "predict": ("rigctl.verbs.predict", "predict"),
    "sky": ("rigctl.verbs.sky", "sky"),
    "stokes": ("rigctl.verbs.stokes", "stokes"),
    "surface": ("rigctl.verbs.surface", "surface"),
    "sweep": ("rigctl.verbs.predict", "sweep"),
}


def __getattr__(name: str) -> Any:
    """Return a name of the interface, imported now."""
    if name not in __all__:
        raise AttributeError(f"module 'rigctl' has no attribute {name!r}")
    module, inner = _PLACES[name]
    found = getattr(importlib.import_module(module), inner)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
