"""Special functions of scipy, imported at the first call: that takes a tenth of a second, and many starts call none."""

from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
        return getattr(import_module("scipy.special"), self._name)


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
