"""Arithmetic in twice the working precision, for differences of products that cancel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Splits a double into two halves of 26 bits.
_SPLITTER = 2.0**27 + 1.0


@dataclass(frozen=True)
class DoubleDouble:
    """Unevaluated sum of two arrays of doubles, the second one below half an ulp of the first.

    Parameters
    ----------
    high, low
        Parts, of one shape.
    """

    high: FloatArray
    low: FloatArray

    @property
    def value(self) -> FloatArray:
        """The sum, rounded to a double."""
        return np.asarray(self.high + self.low)

    def __add__(self, other: "DoubleDouble") -> "DoubleDouble":
        total, error = _two_sum(self.high, other.high)
        low_total, low_error = _two_sum(self.low, other.low)
        high, low = _quick_two_sum(total, error + low_total)
        return DoubleDouble(*_quick_two_sum(high, low + low_error))

    def __sub__(self, other: "DoubleDouble") -> "DoubleDouble":
        return self + DoubleDouble(-other.high, -other.low)

    def __mul__(self, other: "DoubleDouble") -> "DoubleDouble":
        exact = product(self.high, other.high)
        cross = self.high * other.low + self.low * other.high
        return DoubleDouble(*_quick_two_sum(exact.high, exact.low + cross))


def product(first: FloatArray, second: FloatArray) -> DoubleDouble:
    """Return the product of two arrays of doubles without rounding.

    Parameters
    ----------
    first, second
        They broadcast; below 1e150 in size, and their product above 1e-280 for the low part to exist.

    Returns
    -------
    DoubleDouble
        The exact product.

    References
    ----------
    T. J. Dekker, Numer. Math. 18 (1971) 224, doi:10.1007/BF01397083.
    """
    high = first * second
    first_high, first_low = _split(first)
    second_high, second_low = _split(second)
    error = first_high * second_high - high
    error = error + first_high * second_low + first_low * second_high
    return DoubleDouble(high, error + first_low * second_low)


def _split(array: FloatArray) -> tuple[FloatArray, FloatArray]:
    scaled = _SPLITTER * array
    high = scaled - (scaled - array)
    return high, array - high


def _two_sum(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    total = first + second
    shadow = total - first
    return total, (first - (total - shadow)) + (second - shadow)


def _quick_two_sum(larger: FloatArray, smaller: FloatArray) -> tuple[FloatArray, FloatArray]:
    total = larger + smaller
    return total, smaller - (total - larger)
