"""Inverted Rice distributions: the true length behind a measured one, in units of the noise, tabulated once.

Each estimator inverts one curve between the true length v and the measured one r, both over the standard
deviation of a component. In u = 1/r^2 the ratio (v/r)^2 falls smoothly from 1 at u = 0 to 0 at the largest u that
the curve knows (below that r the estimate is 0); it is tabulated there and interpolated by a cubic spline, so that
one table serves up to any length. With 512 intervals the error of v is below 1e-9, see the tests.
"""

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e, i1e

from model.processing.quadratic_forms.quadratic_form import tail_probabilities

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]

_INTERVALS = 512
_BISECTIONS = 60
_NEWTON_STEPS = 8


@cache
def share_curve(estimator: str) -> "CubicSpline":
    """Return (v/r)^2 as a spline in 1/r^2, from 0 to 1/r^2 of the shortest length that gives more than 0.

    Parameters
    ----------
    estimator
        "wardle_kronberg", "maximum_likelihood", "mean" or "median".
    """
    from scipy.interpolate import CubicSpline  # a quarter of a second, wanted for two estimators only

    square = _SQUARES[estimator]
    inverse = np.linspace(0.0, 1.0 / zero_threshold(estimator) ** 2, _INTERVALS + 1)
    share = np.ones_like(inverse)
    share[1:-1] = square(1.0 / inverse[1:-1]) * inverse[1:-1]
    share[-1] = 0.0
    return CubicSpline(inverse, share)


def zero_threshold(estimator: str) -> float:
    """Return the measured length at and below which the estimate is 0 (0 where there is none).

    Parameters
    ----------
    estimator
        One of the names of `model.processing.estimators`.
    """
    return _THRESHOLDS[estimator]


def _bessel_ratio(y: FloatArray) -> FloatArray:
    return np.asarray(i1e(y) / i0e(y), dtype=np.float64)


def _square_of_likelihood(measured: FloatArray) -> FloatArray:
    """Return v^2 that makes r most likely: v = r I1(r v)/I0(r v)."""
    y = _bisect(lambda y: y / _bessel_ratio(y), measured)
    return y * _bessel_ratio(y)


def _square_of_mode(measured: FloatArray) -> FloatArray:
    """Return v^2 for which r is the most frequent length: r^2 = 1 + r v I1(r v)/I0(r v)."""
    y = _bisect(lambda y: 1.0 + y * _bessel_ratio(y), measured)
    return y**2 / measured


def _square_of_mean(measured: FloatArray) -> FloatArray:
    """Return v^2 for which r is the mean length."""
    return _bisect(lambda square: mean_length(square) ** 2, measured)


def mean_length(square: FloatArray) -> FloatArray:
    """Return the mean of the Rice distribution whose true length has this square.

    Parameters
    ----------
    square
        Square of what the true length is over the deviation of a component, any shape, 0 or more.

    References
    ----------
    Rice, Bell Syst. Tech. J. 24, 46 (1945), doi:10.1002/j.1538-7305.1945.tb00453.x.
    """
    x = 0.25 * square
    mean = np.sqrt(0.5 * np.pi) * ((1.0 + 2.0 * x) * i0e(x) + 2.0 * x * i1e(x))
    return np.asarray(mean, dtype=np.float64)


def _square_of_median(measured: FloatArray) -> FloatArray:
    """Return v^2 for which r is the median length: Newton in v^2 on P(length <= r) = 1/2."""
    length = np.sqrt(measured)
    square = measured - 2.0 * np.log(2.0)
    for _ in range(_NEWTON_STEPS):
        true = np.sqrt(square)
        below = tail_probabilities(measured, np.ones((measured.size, 1)), true[:, None], degrees=[2.0]).lower
        # dP/dv = -r exp(-(r^2 + v^2)/2) I1(r v)
        slope = -length * np.exp(-0.5 * (length - true) ** 2) * i1e(length * true) / (2.0 * true)
        square = np.maximum(square - (below - 0.5) / slope, 0.5 * square)
    return np.asarray(square, dtype=np.float64)


def _bisect(curve: Callable[[FloatArray], FloatArray], value: FloatArray) -> FloatArray:
    """Return the argument in (0, 2 value + 2) at which the rising curve takes the value."""
    low, high = np.zeros_like(value), 2.0 * value + 2.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = curve(middle) < value
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


_SQUARES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "wardle_kronberg": _square_of_mode,
    "maximum_likelihood": _square_of_likelihood,
    "mean": _square_of_mean,
    "median": _square_of_median,
}
_THRESHOLDS = {
    "naive": 0.0,
    "asymptotic": 1.0,
    "wardle_kronberg": 1.0,
    "maximum_likelihood": float(np.sqrt(2.0)),
    "mean": float(np.sqrt(0.5 * np.pi)),
    "median": float(np.sqrt(2.0 * np.log(2.0))),
    "mas": 0.0,
}
