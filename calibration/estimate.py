"""A calibrated number, and how well it is known."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

# Digits behind the point that numbers are written with; what is smaller has an exponent.
_MOST_DIGITS = 6


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value with the standard deviation of its error.

    Attributes
    ----------
    value : float
        In the unit that the name of the quantity ends in.
    std_error : float
        Standard error, same unit, > 0.
    n : int
        Number of frames it was made from.
    """

    value: float
    std_error: float
    n: int


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A limit of a number that is not known itself.

    Attributes
    ----------
    bound : {"<", ">"}
        The number is smaller, or larger.
    value : float
        Than this, in the unit that the name of the quantity ends in.
    """

    bound: Literal["<", ">"]
    value: float


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCovariance:
    """Covariance of the errors of several estimates.

    Attributes
    ----------
    names : tuple of str
        The quantities, in the order of the rows.
    matrix : (n, n) array
        Covariance of the errors; an element has the product of the units of its two quantities. The diagonal
        holds the squares of the standard errors.
    """

    names: tuple[str, ...]
    matrix: NDArray[np.float64]


def percent_with_error(value: float, std_error: float) -> str:
    """Return a share and its standard error in percent, both to the second digit of the error.

    Parameters
    ----------
    value, std_error : float
        Relative; the error > 0 or not finite.
    """
    digits = 1 - math.floor(math.log10(100.0 * std_error)) if 0.0 < std_error < np.inf else 2
    digits = min(max(digits, 0), _MOST_DIGITS)
    return f"{value:+.{digits}%} +- {std_error:.{digits}%}"


def number_with_error(value: float, std_error: float, *, sign: Literal["", "+"] = "") -> str:
    """Return a number and its standard error, both to the second digit of the error.

    Parameters
    ----------
    value, std_error : float
        In one unit.
    sign : {"", "+"}
        Whether a number above 0 has its sign too.
    """
    digits = 1 - math.floor(math.log10(std_error)) if 0.0 < std_error < np.inf else _MOST_DIGITS + 1
    if digits > _MOST_DIGITS:
        return f"{value:{sign}.3g} +- {std_error:.2g}"
    shown = max(digits, 0)
    return f"{round(value, digits):{sign}.{shown}f} +- {round(std_error, digits):.{shown}f}"
