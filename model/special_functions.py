"""Special functions of scipy, imported at the first call and without the package about them: many starts call none."""

import sys
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from threading import RLock
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PACKAGE, _COMPILED = "scipy.special", "scipy.special._ufuncs"
_IMPORTING = RLock()


class SpecialFunction:
    """A function of `scipy.special`, by its name and with its arguments."""

    def __init__(self, name: str) -> None:
        """Set the name."""
        self._name = name

    def __call__(self, *arguments: Any, **options: Any) -> FloatArray:
        """Return what the function returns."""
        found: FloatArray = self._function(*arguments, **options)
        return found

    @cached_property
    def _function(self) -> Any:
        with _IMPORTING:
            return getattr(_module(), self._name)


def _module() -> ModuleType:
    """Return the compiled module of these functions; the package where it is there already, or cannot do without.

    The package would import numpy's compiler of Fortran and its tests, to serve other kinds of arrays: 0.15 s.
    """
    spec = None if _PACKAGE in sys.modules or _COMPILED in sys.modules else find_spec(_PACKAGE)
    if spec is not None:
        sys.modules[_PACKAGE] = package = module_from_spec(spec)
        package.__dict__["__getattr__"] = _of_package
        try:
            return import_module(_COMPILED)
        except ImportError:
            pass
        finally:
            del sys.modules[_PACKAGE]
    return sys.modules.get(_COMPILED) or import_module(_PACKAGE)


def _of_package(name: str) -> Any:
    """Return what another thread wants of the package in the moment in which its place is taken by an empty one."""
    if name.startswith("_"):
        raise AttributeError(name)
    with _IMPORTING:
        return getattr(import_module(_PACKAGE), name)


betainccinv = SpecialFunction("betainccinv")
betaincinv = SpecialFunction("betaincinv")
chdtri = SpecialFunction("chdtri")
erfc = SpecialFunction("erfc")
erfcx = SpecialFunction("erfcx")
expn = SpecialFunction("expn")
fdtrc = SpecialFunction("fdtrc")
fdtri = SpecialFunction("fdtri")
gamma = SpecialFunction("gamma")
gammaincc = SpecialFunction("gammaincc")
gammainccinv = SpecialFunction("gammainccinv")
gammaincinv = SpecialFunction("gammaincinv")
ndtr = SpecialFunction("ndtr")
ndtri = SpecialFunction("ndtri")
