"""Loads one module of pylablib's Thorlabs package; the package itself imports every camera, and wants numba."""

import importlib
import sys
import types
from pathlib import Path

import pylablib


def load(name: str) -> types.ModuleType:
    """Return one module of pylablib.devices.Thorlabs."""
    package = types.ModuleType("pylablib.devices.Thorlabs")
    package.__path__ = [str(Path(pylablib.__file__).parent / "devices" / "Thorlabs")]
    sys.modules[package.__name__] = package
    return importlib.import_module(f"{package.__name__}.{name}")
