"""Quadrature rules, adaptive integration, a spline, a fit, and special functions of scipy imported at the first call.

Many commands call no special function, and importing `scipy.special` takes 0.15 s. Importing `scipy.interpolate` and
`scipy.optimize` takes 0.3 s, more than a prediction.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from threading import RLock
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_PACKAGE, _COMPILED = "scipy.special", "scipy.special._ufuncs"
_IMPORTING = RLock()
# Most steps of a fit per column, which is seldom removed and added again more than a few times.
_MOST_COLUMNS = 10


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


betainccinv = SpecialFunction("betainccinv")
betaincinv = SpecialFunction("betaincinv")
chdtri = SpecialFunction("chdtri")
erfc = SpecialFunction("erfc")
erfcx = SpecialFunction("erfcx")
expn = SpecialFunction("expn")
fdtrc = SpecialFunction("fdtrc")
fdtri = SpecialFunction("fdtri")
gamma = SpecialFunction("gamma")
gammainc = SpecialFunction("gammainc")
gammaincc = SpecialFunction("gammaincc")
gammainccinv = SpecialFunction("gammainccinv")
gammaincinv = SpecialFunction("gammaincinv")
gammaln = SpecialFunction("gammaln")
i0e = SpecialFunction("i0e")
i1e = SpecialFunction("i1e")
ndtr = SpecialFunction("ndtr")
ndtri = SpecialFunction("ndtri")
stdtr = SpecialFunction("stdtr")
stdtrit = SpecialFunction("stdtrit")


@cache
def gauss_hermite(count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights for the mean of a function of a standard normal variable.

    Definition (probabilists' Hermite polynomials).
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(count)
    return nodes, weights / np.sum(weights)


@cache
def gauss_legendre(count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights for the integral over the interval from 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


class ClampedSpline:
    """Cubic spline through points, level at both ends.

    de Boor, A Practical Guide to Splines (Springer, 1978), chapter 4.
    """

    def __init__(self, x: FloatArray, y: FloatArray) -> None:
        """Set the points, x rising."""
        step, steep = np.diff(x), np.diff(y) / np.diff(x)
        rows, wanted = np.eye(x.size), np.zeros(x.size)
        inner = np.arange(1, x.size - 1)
        rows[inner, inner - 1], rows[inner, inner + 1] = step[1:], step[:-1]
        rows[inner, inner] = 2.0 * (step[1:] + step[:-1])
        wanted[inner] = 3.0 * (step[1:] * steep[:-1] + step[:-1] * steep[1:])
        slope = np.linalg.solve(rows, wanted)
        self.x = x
        self._terms = np.stack(
            [
                (slope[:-1] + slope[1:] - 2.0 * steep) / step**2,
                (3.0 * steep - 2.0 * slope[:-1] - slope[1:]) / step,
                slope[:-1],
                y[:-1],
            ]
        )

    def __call__(self, x: FloatArray) -> FloatArray:
        """Return values; beyond the ends from the outermost pieces."""
        piece = np.clip(np.searchsorted(self.x, x, side="right") - 1, 0, self.x.size - 2)
        apart = x - self.x[piece]
        cubic, square, linear, constant = self._terms
        found = cubic[piece]
        for term in (square, linear, constant):
            found = found * apart + term[piece]
        return np.asarray(found)


def fit_above_zero(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Return weights of columns, none below 0, whose sum is closest to values by least squares.

    Lawson and Hanson, Solving Least Squares Problems (SIAM, 1995), chapter 23.
    """
    count = columns.shape[1]
    weights, used = np.zeros(count), np.zeros(count, dtype=np.bool_)
    least = 10.0 * max(columns.shape) * float(np.finfo(np.float64).eps) * float(np.abs(columns).sum(axis=0).max())
    for _ in range(_MOST_COLUMNS * count):
        downhill = np.where(used, -np.inf, columns.T @ (values - columns @ weights))
        if not downhill.max() > least:
            break
        used[downhill.argmax()] = True
        while True:
            free = np.zeros(count)
            free[used] = np.linalg.lstsq(columns[:, used], values)[0]
            below = used & (free <= 0.0)
            if not below.any():
                break
            share = float(np.min(weights[below] / (weights[below] - free[below])))
            weights = weights + share * (free - weights)
            used &= weights > 1e-14 * weights.max()
            weights[~used] = 0.0
        weights = free
    return weights


@dataclass(frozen=True, kw_only=True)
class PanelIntegrals:
    """Integrals of several functions over several domains."""

    value: FloatArray
    size: FloatArray
    error: FloatArray


_MAX_HALVINGS = 48
# Open panels per domain: more than any integrand here needs, except noise.
_MAX_OPEN = 300


def integrate_panels(
    function: Callable[[IntArray, FloatArray], FloatArray],
    *,
    cuts: FloatArray,
    tolerance: float,
    noise: FloatArray,
    degree: int = 24,
) -> PanelIntegrals:
    """Return integrals of vector-valued functions over domains cut into panels, by adaptive halving.

    A panel is accepted when its two nested rules agree to `tolerance` times the domain's absolute integral over the
    number of panels, or to `noise`. After 48 halvings, or with 300 open panels per domain, the remaining panels are
    accepted; `error` includes their errors.
    """
    owner, lower, upper = _nonempty_panels(cuts)
    total = _Totals(cuts.shape[0])
    for halving in range(_MAX_HALVINGS + 1):
        value, size, error = _panel(function, owner, lower, upper, degree)
        allowed = _allowance(total, owner, size, tolerance / cuts.shape[1])
        good = np.all(error <= np.maximum(allowed, noise[owner] * size), axis=0)
        if halving == _MAX_HALVINGS or owner.size > _MAX_OPEN * cuts.shape[0]:
            good[:] = True
        total.add(owner[good], value[:, good], size[:, good], error[:, good])
        if np.all(good):
            break
        owner, lower, upper = _halves(owner[~good], lower[~good], upper[~good])
    return PanelIntegrals(value=total.value.T, size=total.size.T, error=total.error.T)


def _nonempty_panels(cuts: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    lower, upper = cuts[:, :-1], cuts[:, 1:]
    domain, panel = np.nonzero(upper > lower)
    return domain, lower[domain, panel], upper[domain, panel]


class _Totals:
    """Running sums over accepted panels."""

    def __init__(self, domains: int) -> None:
        self.domains = domains
        self.value = np.zeros((1, domains))
        self.size = np.zeros((1, domains))
        self.error = np.zeros((1, domains))

    def add(self, owner: IntArray, value: FloatArray, size: FloatArray, error: FloatArray) -> None:
        self.value = self.value + self.by_domain(owner, value)
        self.size = self.size + self.by_domain(owner, size)
        self.error = self.error + self.by_domain(owner, error)

    def by_domain(self, owner: IntArray, rows: FloatArray) -> FloatArray:
        return np.stack([np.bincount(owner, weights=row, minlength=self.domains) for row in rows])


def _panel(
    function: Callable[[IntArray, FloatArray], FloatArray],
    owner: IntArray,
    lower: FloatArray,
    upper: FloatArray,
    degree: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    nodes, weights = clenshaw_curtis(degree)
    half = 0.5 * (upper - lower)
    # From each end, so that a panel beside zero keeps the relative precision of its abscissae.
    from_lower = lower[:, None] + half[:, None] * (1.0 + nodes)
    from_upper = upper[:, None] - half[:, None] * (1.0 - nodes)
    near_lower = np.abs(lower) <= np.abs(upper)
    values = function(owner, np.where(near_lower[:, None], from_lower, from_upper))
    fine = values @ weights * half
    coarse = values[..., ::2] @ clenshaw_curtis(degree // 2)[1] * half
    return fine, np.abs(values) @ weights * half, np.abs(fine - coarse)


@cache
def clenshaw_curtis(degree: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of the Clenshaw-Curtis rule on [-1, 1].

    C. W. Clenshaw and A. R. Curtis, Numer. Math. 2 (1960) 197, doi:10.1007/BF01386223.
    """
    angle = np.pi * np.arange(degree + 1) / degree
    even = np.arange(0, degree + 1, 2)
    # Integral of the Chebyshev polynomial T_k is 2 / (1 - k^2) for even k; end terms of both sums count half.
    half = np.where((even == 0) | (even == degree), 0.5, 1.0)
    weights = (2.0 / degree) * np.cos(np.outer(angle, even)) @ (half * 2.0 / (1.0 - even**2))
    weights[[0, -1]] *= 0.5
    return np.cos(angle), weights


def _allowance(total: _Totals, owner: IntArray, size: FloatArray, tolerance: float) -> FloatArray:
    known = total.size + total.by_domain(owner, size)
    return np.asarray(tolerance * known[:, owner])


def _halves(owner: IntArray, lower: FloatArray, upper: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    middle = 0.5 * (lower + upper)
    return (
        np.concatenate([owner, owner]),
        np.concatenate([lower, middle]),
        np.concatenate([middle, upper]),
    )


def _module() -> ModuleType:
    """Return the compiled module of these functions, or the package if it is loaded or needed.

    The package would spend 0.15 s on imports for other kinds of arrays.
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
    """Return a name of the package to another thread while the empty stand-in is in its place."""
    if name.startswith("_"):
        raise AttributeError(name)
    with _IMPORTING:
        return getattr(import_module(_PACKAGE), name)
