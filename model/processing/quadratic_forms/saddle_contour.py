"""Saddle point of the contour integral of a tail probability, where the contour crosses the real axis.

The tail P(Q > level) of a quadratic form is an integral over a path that leaves the real axis between the
pole at 0 and the first singularity to the right. Everything here is made dimensionless with that singularity
at 1, so weights in any unit and of any spread look alike.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BRACKET = 80.0  # |logit| of the saddle: exp(-80) is far below any ratio that double precision can form
_ENOUGH = 0.05  # distance from the saddle, in widths of the saddle, that costs the integral nothing
_MAX_STEPS = 200


@dataclass(frozen=True, kw_only=True)
class UpperTail:
    """P(Q > level) for many forms at once, level not below the mean, in dimensionless variables.

    The cumulant function is K(s) = sum_j [ -degrees_j/2 ln(1 - ratio_j s) + shift_j s / (1 - ratio_j s) ].
    `bounded` says that some ratio is positive; the largest is then 1 and s lies in (0, 1), else in (0, inf).
    Rows are forms, columns are components. Extended precision where the platform has it: the exponent of a
    deep tail is a small difference of large terms.
    """

    ratio: NDArray[np.longdouble]
    shift: NDArray[np.longdouble]
    level: NDArray[np.longdouble]
    degrees: FloatArray
    bounded: NDArray[np.bool_]

    def rows(self, chosen: NDArray[np.intp]) -> Self:
        """Return the same for the chosen forms only."""
        return type(self)(
            ratio=self.ratio[chosen],
            shift=self.shift[chosen],
            level=self.level[chosen],
            degrees=self.degrees,
            bounded=self.bounded[chosen],
        )


@dataclass(frozen=True, kw_only=True)
class Saddle:
    """The crossing point s = `at`, its distance to the singularity at 1, and 1 - ratio_j s there.

    The three agree with each other to extended precision, also where `at` rounds to 1.
    """

    at: NDArray[np.longdouble]
    to_pole: FloatArray
    factor: NDArray[np.longdouble]

    def rows(self, chosen: NDArray[np.intp]) -> Self:
        """Return the same for the chosen forms only."""
        return type(self)(at=self.at[chosen], to_pole=self.to_pole[chosen], factor=self.factor[chosen])


def find_saddle(tail: UpperTail) -> Saddle:
    """Return a point close to the real minimum of K(s) - s level - ln s, for every form.

    Parameters
    ----------
    tail
        Forms and levels.

    Notes
    -----
    The condition K'(s) = level + 1/s is written as a balance of positive terms, growing against falling, and
    solved for ln or logit of s, where both sides are nearly power laws: Newton's method on the logarithm of
    their quotient takes 3 to 6 steps, a bracket catches what it overshoots. The integral does not depend on
    the point chosen, so a twentieth of the width of the saddle is near enough.
    """
    ratio, shift, level = (np.asarray(part, dtype=float) for part in (tail.ratio, tail.shift, tail.level))
    low, high = _bracket(tail)
    logit = np.clip(_first_guess(ratio, shift, level, tail), low, high)
    for _ in range(_MAX_STEPS):
        gap, slope, distance = _balance(ratio, shift, level, tail.degrees, _point(ratio, tail.bounded, logit))
        if bool(np.all(distance < _ENOUGH)):
            break
        low = np.where(gap < 0.0, logit, low)
        high = np.where(gap < 0.0, high, logit)
        step = logit - gap / slope
        inside = (step > low) & (step < high)
        moved = np.where(inside, step, 0.5 * (low + high))
        logit = np.where(distance < _ENOUGH, logit, moved)
    return _exact_point(tail, logit)


def _bracket(tail: UpperTail) -> tuple[FloatArray, FloatArray]:
    """Return limits of logit s (bounded forms) or of ln s, from upper bounds of each term (others)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.asarray(np.abs(tail.level), dtype=float)
        offsets = np.where(tail.ratio != 0.0, 2.0 * tail.shift / tail.ratio, 0.0)
        terms = 1.0 + 0.5 * np.sum(tail.degrees + offsets.astype(float), axis=1)
        lowest = np.where(tail.bounded, -_BRACKET, -np.log(size))
        highest = np.where(tail.bounded, _BRACKET, np.log(terms) - np.log(size))
    return lowest, highest


def _first_guess(ratio: FloatArray, shift: FloatArray, level: FloatArray, tail: UpperTail) -> FloatArray:
    """Return logit s of one standard deviation of Q (bounded), or ln s of a chi-square lower tail."""
    one_sided = np.where(tail.bounded[:, None], ratio, 0.0)
    variance: FloatArray = np.sum((0.5 * tail.degrees * one_sided + 2.0 * shift) * one_sided, axis=1)
    with np.errstate(divide="ignore"):
        unbounded = np.log1p(0.5 * np.sum(tail.degrees)) - np.log(np.abs(level))
    guess: FloatArray = np.where(tail.bounded, -0.5 * np.log(1.0 + variance), unbounded)
    return guess


@dataclass(frozen=True, kw_only=True)
class _Point:
    at: FloatArray
    chain: FloatArray  # ds/d(logit)
    factor: FloatArray


def _point(ratio: FloatArray, bounded: NDArray[np.bool_], logit: FloatArray) -> _Point:
    inverse = np.exp(-logit)
    to_pole = inverse / (1.0 + inverse)
    at = np.where(bounded, 1.0 / (1.0 + inverse), 1.0 / inverse)
    # for poles on the right written with the distance to the first, so that nothing cancels close to it
    near = (1.0 - ratio) + ratio * to_pole[:, None]
    factor = np.where(ratio > 0.0, near, 1.0 - ratio * at[:, None])
    return _Point(at=at, chain=np.where(bounded, at * to_pole, at), factor=factor)


def _exact_point(tail: UpperTail, logit: FloatArray) -> Saddle:
    one = np.longdouble(1.0)
    inverse = np.asarray(np.exp(-logit), dtype=np.longdouble)
    to_pole = inverse / (one + inverse)
    at = np.where(tail.bounded, one / (one + inverse), one / inverse)
    near = (one - tail.ratio) + tail.ratio * to_pole[:, None]
    factor = np.where(tail.ratio > 0.0, near, one - tail.ratio * at[:, None])
    return Saddle(at=at, to_pole=np.asarray(to_pole, dtype=np.float64), factor=factor)


def _balance(
    ratio: FloatArray, shift: FloatArray, level: FloatArray, degrees: FloatArray, point: _Point
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ln(growing/falling), its slope in the logit, and the distance to the saddle in widths."""
    central = 0.5 * degrees * ratio / point.factor
    shifted = shift / point.factor / point.factor
    first = central + shifted
    second = (central + 2.0 * shifted) * ratio / point.factor
    positive = ratio > 0.0
    growing = np.sum(first, axis=1, where=positive) + np.maximum(-level, 0.0)
    falling = 1.0 / point.at + np.maximum(level, 0.0) - np.sum(first, axis=1, where=~positive)
    growth = np.sum(second, axis=1, where=positive)
    fall = -1.0 / point.at**2 - np.sum(second, axis=1, where=~positive)
    slope = (growth / growing - fall / falling) * point.chain
    distance = np.abs(growing - falling) / np.sqrt(growth - fall)
    return np.log(growing / falling), slope, distance
