"""The contour integral of a tail probability: a hyperbola through the saddle and the trapezoidal rule on it."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from model.processing.quadratic_forms.saddle_contour import FloatArray, Saddle, UpperTail

ComplexArray = NDArray[np.complex128]

# Asymptotes of the hyperbola stand atan(1/0.7) = 55 degrees off the real axis: 10 degrees on the safe side of
# 45, where the modulus of every factor stops falling, and 35 from 90, where exp(-s level) stops falling.
_SLOPE = 0.7
# Of more, such as counts behind 500 angles, the product leaves the range of a double: their logarithms are summed.
_MOST_FACTORS = 32
_NEGLIGIBLE = 1e-17  # of the integrand at the saddle; the path ends there
_NEAR_ENDS = np.arange(2.0, 9.0)  # sinh of 3 ends a Gaussian, of 7 a chi-square
_FAR_ENDS = np.arange(9.0, 100.0)  # weights of both signs and a zero level: a power law is all that ends it
_FEWEST_NODES, _FIRST_NODES = 8, 24
_NODES_PER_DIGIT = 2.4
_MOST_NODES = 1536
_TALLEST = 10.0  # times the saddle: beyond, the path climbs a wrong hill and cancellation costs digits


@dataclass(frozen=True, kw_only=True)
class Contour:
    """The integrand relative to its saddle and the path, per form, in units of the width of the saddle.

    With z the way from the saddle in widths, the integrand is
    prod_j (1 - pole_j z)^(-degrees_j/2) exp(linear z + z^2 sum_j quadratic_j/(1 - pole_j z)) / (1 + origin z);
    the linear parts of all components and of the level are summed first, so that large offsets do not cancel.
    `bend` is +1 (right), -1 (left) or 0 (a vertical line), `straight` the length of the straight middle.
    """

    pole: FloatArray
    quadratic: FloatArray
    linear: FloatArray
    origin: FloatArray
    width: FloatArray
    bend: FloatArray
    straight: FloatArray
    degrees: FloatArray

    def rows(self, chosen: NDArray[np.intp]) -> Self:
        """Return the same for the chosen forms only."""
        return type(self)(
            pole=self.pole[chosen],
            quadratic=self.quadratic[chosen],
            linear=self.linear[chosen],
            origin=self.origin[chosen],
            width=self.width[chosen],
            bend=self.bend[chosen],
            straight=self.straight[chosen],
            degrees=self.degrees,
        )


def contour_through(tail: UpperTail, saddle: Saddle, bend: float | None) -> Contour:
    """Return the contour through the saddle.

    Parameters
    ----------
    tail, saddle
        The problem and its crossing point.
    bend
        +1, -1 or 0 for every form, or None: away from the singularities where they are on one side, else
        the way the path of steepest descent turns.
    """
    at = np.asarray(saddle.at, dtype=float)
    ratio = np.asarray(tail.ratio / saddle.factor, dtype=float)
    shifted = np.asarray(tail.shift / saddle.factor / saddle.factor, dtype=float)
    central = 0.5 * tail.degrees * ratio
    second = np.sum((central + 2.0 * shifted) * ratio, axis=1) + at**-2
    third = np.sum((2.0 * central + 6.0 * shifted) * ratio**2, axis=1) - 2.0 * at**-3
    width = second**-0.5
    turn = third * width / (6.0 * second)
    way = _natural_bend(tail, turn) if bend is None else np.full_like(width, bend)
    linear = np.sum(tail.shift / saddle.factor**2, axis=1) - tail.level
    return Contour(
        pole=ratio * width[:, None],
        quadratic=shifted * ratio * width[:, None] ** 2,
        linear=np.asarray(linear, dtype=float) * width,
        origin=width / at,
        width=width,
        bend=way,
        straight=_straight(turn * way, _reach(tail, saddle, way) / width),
        degrees=tail.degrees,
    )


def integrate(contour: Contour, tolerance: float, *, two_sided: bool) -> tuple[FloatArray, FloatArray]:
    """Return the integral over the path, in units of the integrand at the saddle, and its relative error.

    Parameters
    ----------
    contour
        The forms.
    tolerance
        Relative; nodes are doubled until two results differ by less.
    two_sided
        True when weights of both signs occur: what is beyond the end of the path is then looked at too.

    Returns
    -------
    tuple of ndarray
        (1/pi) Re of the integral over the upper half of the path; estimated relative error. It is infinite
        where the path climbs so high that it is of no use.

    Notes
    -----
    The trapezoidal rule in v, z = x(sinh v) + i sinh v, converges geometrically. The error given is the
    difference to half the nodes, thus that of the coarser rule, plus what was cut off and the rounding.
    """
    end, tallest = _end(contour)
    cut_off = _beyond(contour, end) if two_sided else np.zeros_like(end)
    usable = np.flatnonzero((tallest < _TALLEST) & np.isfinite(end))
    value, error = np.ones_like(end), np.full_like(end, np.inf)
    value[usable], error[usable] = _trapezoid(contour.rows(usable), end[usable], tolerance)
    rounding = 4.0 * np.finfo(float).eps * (1.0 + tallest / np.abs(value))
    return value, error + rounding + cut_off / np.abs(value)


def _natural_bend(tail: UpperTail, turn: FloatArray) -> FloatArray:
    left_free = ~np.any(tail.ratio < 0.0, axis=1)
    either = np.where(turn >= 0.0, 1.0, -1.0)
    return np.where(~tail.bounded, -1.0, np.where(left_free, 1.0, either))


def _reach(tail: UpperTail, saddle: Saddle, way: FloatArray) -> FloatArray:
    """Return the distance to the first singularity on the side the path bends to, 0 not counted."""
    most_negative = np.asarray(np.minimum(np.min(tail.ratio, axis=1), 0.0), dtype=float)
    with np.errstate(divide="ignore"):
        left = np.asarray(saddle.at, dtype=float) + np.where(most_negative < 0.0, -1.0 / most_negative, np.inf)
    right = np.where(tail.bounded, saddle.to_pole, np.inf)
    return np.where(way > 0.0, right, left)


def _straight(turn: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the length of the straight middle from the curvature of steepest descent, within bounds."""
    curvature = np.clip(turn, 0.0625 / reach, 0.5 / reach)
    with np.errstate(divide="ignore"):
        return np.maximum(0.5 * _SLOPE / curvature, 1.0)


def _path(contour: Contour, v: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return z(v) and (dz/dv)/i."""
    height = np.sinh(v)
    middle = np.where(np.isfinite(contour.straight), contour.straight, 1.0)[:, None]
    slope = (_SLOPE * contour.bend * np.isfinite(contour.straight))[:, None]
    radius = np.sqrt(height * height + middle * middle)
    steepness = slope * height / radius
    aside = height * steepness * radius / (radius + middle)
    speed = np.sqrt(1.0 + height * height)
    return aside + 1j * height, speed - 1j * (speed * steepness)


def _relative_integrand(contour: Contour, z: ComplexArray) -> ComplexArray:
    """Return the integrand at z over that at the saddle."""
    exponent = contour.linear[:, None] * z
    denominator = 1.0 + contour.origin[:, None] * z
    square = z * z
    for j, degrees in enumerate(contour.degrees):
        step = contour.pole[:, j, None] * z
        factor = 1.0 - step
        if np.any(contour.quadratic[:, j]):
            exponent += square * (contour.quadratic[:, j, None] / factor)
        if degrees == 1.0 and len(contour.degrees) <= _MOST_FACTORS:
            denominator *= np.sqrt(factor)
        else:
            exponent -= (0.5 * degrees) * _log_one_minus(step)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return np.asarray(np.exp(exponent) / denominator, dtype=np.complex128)


def _log_one_minus(step: ComplexArray) -> ComplexArray:
    """Return log(1 - step), without loss where the step is small: it is multiplied by up to millions of degrees."""
    x, y = step.real, step.imag
    return 0.5 * np.log1p(x * (x - 2.0) + y * y) - 1j * np.arctan2(y, 1.0 - x)


def _height(contour: Contour, v: FloatArray) -> FloatArray:
    """Return the modulus of integrand times dz/dv; infinite where it overflows."""
    z, speed = _path(contour, v)
    with np.errstate(over="ignore", invalid="ignore"):
        modulus = np.abs(_relative_integrand(contour, z) * speed)
    return np.where(np.isfinite(modulus), modulus, np.inf)


def _end(contour: Contour) -> tuple[FloatArray, FloatArray]:
    """Return the v where the integrand becomes negligible, and the greatest height on the way there."""
    end, tallest = _first_crossing(contour, _NEAR_ENDS)
    far = np.flatnonzero(~np.isfinite(end))
    if far.size:
        further, higher = _first_crossing(contour.rows(far), _FAR_ENDS)
        end[far], tallest[far] = further, np.maximum(tallest[far], higher)
    return end, tallest


def _first_crossing(contour: Contour, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    count = contour.linear.size
    height = _height(contour, np.broadcast_to(ends, (count, ends.size)))
    small = height < _NEGLIGIBLE
    first = np.argmax(small, axis=1)
    found = np.any(small, axis=1)
    before = np.arange(ends.size) < np.where(found, first, ends.size)[:, None]
    tallest = np.max(height, axis=1, where=before, initial=1.0)
    end = _between(height, ends, first)
    return np.where(found, end, np.inf), tallest


def _between(height: FloatArray, ends: FloatArray, first: NDArray[np.intp]) -> FloatArray:
    """Return the crossing between grid points: ln(-ln height) is all but linear in v."""
    last = np.maximum(first - 1, 0)
    rows = np.arange(first.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        here = np.log(np.clip(-np.log(height[rows, last]), 1.0, None))
        there = np.log(np.clip(-np.log(np.maximum(height[rows, first], 1e-300)), 1.0, None))
        share = (np.log(-np.log(_NEGLIGIBLE)) - here) / (there - here)
    share = np.where(first > 0, np.clip(share, 0.0, 1.0), 1.0)
    return np.asarray(ends[last] + share * (ends[first] - ends[last]), dtype=np.float64)


def _beyond(contour: Contour, end: FloatArray) -> FloatArray:
    """Return a bound of what the end of the path leaves out.

    The path may be closed by a vertical line from its end: no singularity is off the real axis, and far up
    the integrand falls as a power. The greatest |integrand z| there bounds the remainder to a factor of ten.
    """
    finite = np.where(np.isfinite(end), end, 1.0)
    z, _ = _path(contour, finite[:, None])
    up = np.abs(z) * 2.0 ** np.arange(-3.0, 60.0, 1.5)
    height = np.abs(_relative_integrand(contour, z + 1j * up)) * (np.abs(z) + up)
    return np.asarray(np.max(np.where(np.isfinite(height), height, np.inf), axis=1), dtype=np.float64)


def _trapezoid(contour: Contour, end: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray]:
    nodes = round(np.clip(-_NODES_PER_DIGIT * np.log10(tolerance), _FEWEST_NODES, _FIRST_NODES))
    step = end / nodes
    value = step * (0.5 + _sum(contour, step, np.arange(1.0, nodes + 1)))
    error = np.full_like(value, np.inf)
    open_rows = np.arange(value.size)
    while open_rows.size and nodes < _MOST_NODES:
        part, width = contour.rows(open_rows), step[open_rows]
        middle = width * _sum(part, width, np.arange(0.5, nodes))
        refined = 0.5 * (value[open_rows] + middle)
        error[open_rows] = np.abs(refined - value[open_rows]) / np.abs(refined)
        value[open_rows], step[open_rows] = refined, 0.5 * width
        nodes *= 2
        open_rows = open_rows[error[open_rows] > tolerance]
    return value / np.pi, error


def _sum(contour: Contour, step: FloatArray, numbers: FloatArray) -> FloatArray:
    z, speed = _path(contour, step[:, None] * numbers)
    integrand = _relative_integrand(contour, z)
    total: FloatArray = np.sum(integrand.real * speed.real - integrand.imag * speed.imag, axis=1)
    return total
