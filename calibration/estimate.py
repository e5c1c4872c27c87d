"""Calibrated numbers with their standard errors, and control charts of numbers that are calibrated repeatedly."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

# A calibrated number and its error

# Most digits behind the point; smaller numbers have an exponent.
_MOST_DIGITS = 6


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value with the standard deviation of its error."""

    value: float  #: in the unit that the name of the quantity ends in
    std_error: float  #: standard error, same unit, > 0
    n: int  #: number of frames it was made from


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A limit of a number that is not known itself."""

    bound: Literal["<", ">"]  #: the number is smaller, or larger
    value: float  #: than this, in the unit that the name of the quantity ends in


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCovariance:
    """Covariance of the errors of several estimates."""

    names: tuple[str, ...]
    matrix: NDArray[np.float64]


def percent_with_error(value: float, std_error: float) -> str:
    """Return a share and its standard error in percent, both to the second digit of the error."""
    digits = 1 - math.floor(math.log10(100.0 * std_error)) if 0.0 < std_error < np.inf else 2
    digits = min(max(digits, 0), _MOST_DIGITS)
    return f"{value:+.{digits}%} +- {std_error:.{digits}%}"


def number_with_error(value: float, std_error: float, *, sign: Literal["", "+"] = "") -> str:
    """Return a number and its standard error, both to the second digit of the error."""
    digits = 1 - math.floor(math.log10(std_error)) if 0.0 < std_error < np.inf else _MOST_DIGITS + 1
    if digits > _MOST_DIGITS:
        return f"{value:{sign}.3g} +- {std_error:.2g}"
    shown = max(digits, 0)
    return f"{round(value, digits):{sign}.{shown}f} +- {round(std_error, digits):.{shown}f}"


# Repeated calibrations of a number: control limits from the stated errors, and drift

FloatArray = NDArray[np.float64]

# Half width of the limits: without drift, 27 in 10 000 lie outside.
_SIGMAS = 3.0
# Errors of 0 still need a finite weight.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlChart:
    """Control limits of repeated calibrations."""

    lower: FloatArray
    upper: FloatArray
    is_inside: NDArray[np.bool_]
    drift_per_year: float | None
    drift_error: float | None


def control_chart(years: FloatArray, values: FloatArray, std_errors: FloatArray) -> ControlChart:
    """Return the control chart of a number.

    The limits come from the stated errors, not from the scatter: a steady drift has small steps and a wide scatter, and
    would hide in limits made from either.
    """
    rounding = _ROUNDING * (1.0 + np.abs(values))
    weights = 1.0 / np.maximum(std_errors, rounding) ** 2
    centre = float(np.average(values, weights=weights))
    # Each value is part of the mean, so the variance of their difference is smaller.
    half = _SIGMAS * np.sqrt(np.maximum(1.0 / weights - 1.0 / weights.sum(), 0.0))
    drift, error = _drift(years - years.mean(), values, weights)
    return ControlChart(
        lower=centre - half,
        upper=centre + half,
        is_inside=np.abs(values - centre) <= np.maximum(half, rounding),
        drift_per_year=drift,
        drift_error=error,
    )


def _drift(years: FloatArray, values: FloatArray, weights: FloatArray) -> tuple[float | None, float | None]:
    if len(values) < 3 or np.ptp(years) == 0.0:
        return None, None
    matrix = np.column_stack((np.ones_like(years), years))
    normal = matrix.T @ (weights[:, None] * matrix)
    found = np.linalg.solve(normal, matrix.T @ (weights * values))
    chi_square = float(np.sum(weights * (values - matrix @ found) ** 2)) / (len(values) - 2)
    return float(found[1]), float(np.sqrt(np.linalg.inv(normal)[1, 1] * max(1.0, chi_square)))
