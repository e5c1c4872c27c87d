"""Straight line through numbers with errors: the slope is their drift."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, kw_only=True)
class DriftLine:
    """A weighted straight line.

    Attributes
    ----------
    slope, std_error
        Per unit of the abscissa.
    chi_square, degrees_of_freedom
        Of what the line leaves.
    """

    slope: float
    std_error: float
    chi_square: float
    degrees_of_freedom: int


def drift_line(at: ArrayLike, values: ArrayLike, std_errors: ArrayLike) -> DriftLine:
    """Return the straight line through numbers that are weighted by their errors.

    Parameters
    ----------
    at
        Abscissa, such as a time, shape (n,), n >= 3, not all the same.
    values
        Shape (n,).
    std_errors
        Of the values, shape (n,), > 0, independent.

    Raises
    ------
    ValueError
        Fewer than three numbers, one abscissa for all, or an error that is not above 0.
    """
    x, y, s = (np.asarray(row, dtype=np.float64) for row in (at, values, std_errors))
    if x.size < 3 or np.ptp(x) == 0.0 or not np.all(s > 0.0):
        raise ValueError("a drift needs three numbers or more at different places, each with an error above 0")
    off = x - np.average(x, weights=s**-2.0)
    line, cov = np.polyfit(off, y, 1, w=1.0 / s, cov="unscaled")
    return DriftLine(
        slope=float(line[0]),
        std_error=float(np.sqrt(cov[0, 0])),
        chi_square=float(np.sum(((y - np.polyval(line, off)) / s) ** 2)),
        degrees_of_freedom=x.size - 2,
    )
