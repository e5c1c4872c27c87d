"""Tail probabilities of quadratic forms Q = sum_j w_j (z_j + b_j)^2 of standard normal z.

This is the distribution behind the RX detector. The tail P(Q > level) is an integral over a path that leaves the real
axis between the pole at 0 and the first singularity to the right: a hyperbola through the saddle point, with the
trapezoidal rule on it. Everything is made dimensionless with that singularity at 1, so weights in any unit and of any
spread look alike. Equal weights give the chi-square distribution, in closed form.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.numerics import erfcx, gamma, gammainccinv, gammaincinv

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
LongArray = NDArray[np.longdouble]
RealArray = NDArray[np.floating]


def upper_quantile(probability: ArrayLike, degrees: int) -> FloatArray:
    """Return the value that a chi-square variable exceeds with this probability.

    Accurate to rounding from 1e-300 to 1 - 1e-16: Newton's method on the logarithm of the probability, with
    the residual taken from the closed form; above 1/2 on the lower tail 1 - probability, which is exact there. Of more
    than 200 degrees of freedom to 1e-8.
    """
    p = np.asarray(probability, dtype=np.float64)
    if degrees < 1:
        raise ValueError(f"degrees is {degrees}; allowed is 1 or more")
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError(f"probability has values from {np.min(p)} to {np.max(p)}; allowed is 0 to 1")
    inside = (p > 0.0) & (p < 1.0)
    rare, common = inside & (p <= 0.5), inside & (p > 0.5)
    half = np.where(p == 0.0, np.inf, 0.0)
    if np.any(rare):
        half[rare] = _half_of_rare(p[rare], degrees)
    if np.any(common):
        half[common] = _half_of_common(p[common], degrees)
    return 2.0 * half


_BLOCK = 256  # forms at once: what their nodes need stays in the cache
_TOLERANCE = 1e-10
_SMALLEST_TOLERANCE = 1e-12
_LOG_OF_ZERO = -1000.0  # no double is that small: the digits of such a tail concern its logarithm alone


@dataclass(frozen=True, kw_only=True)
class TailProbabilities:
    """Both tails of a quadratic form at a threshold.

    `upper` is P(Q > threshold), `lower` P(Q <= threshold), each with its own relative accuracy; `log_upper`
    and `log_lower` are their natural logarithms, which reach further than doubles do (-inf for an impossible
    event). `error` is the estimated relative error of the tail that was integrated, that is the upper one at
    and above the mean, the lower one below it; the other is 1 minus it. The estimate takes the arguments as exact.
    """

    upper: FloatArray
    lower: FloatArray
    log_upper: FloatArray
    log_lower: FloatArray
    error: FloatArray


def tail_probabilities(
    threshold: ArrayLike,
    weights: ArrayLike,
    offsets: ArrayLike,
    *,
    degrees: ArrayLike = 1.0,
    constant: ArrayLike = 0.0,
    tolerance: float = _TOLERANCE,
) -> TailProbabilities:
    """Return P(Q > threshold) and P(Q <= threshold), each accurate in its own tail.

    Inversion of the moment generating function over a hyperbola through the saddle point of the integrand,
    by the trapezoidal rule, which converges geometrically; nodes are doubled until two results agree to the
    tolerance. Along a straight line from the saddle of K(s) - s threshold at 45 to 90 degrees from the real
    axis, each factor of a component falls in modulus on the side of its own singularity; so with weights of
    one sign nothing cancels, however spread the weights and deep the tail. With both signs the path may
    climb; then it is bent the other way, or not at all, and the first that reaches the tolerance counts.
    Rounding of the arguments alone changes a tail of probability exp(-x) by about x 1e-16 relative,
    and one between components with offsets b by about b 1e-16 per standard deviation.

    Rice, SIAM J. Sci. Stat. Comput. 1, 438 (1980), doi:10.1137/0901032 (saddle-point contours);
    Imhof, Biometrika 48, 419 (1961), doi:10.1093/biomet/48.3-4.419 (the distribution).
    """
    if not _SMALLEST_TOLERANCE <= tolerance <= 0.01:
        raise ValueError(f"tolerance is {tolerance}; allowed is {_SMALLEST_TOLERANCE:g} to 0.01 (relative)")
    level, w, b, nu = _broadcast(threshold, weights, offsets, degrees, constant)
    shape = level.shape
    level, w, b = level.ravel(), w.reshape(-1, w.shape[-1]), b.reshape(-1, b.shape[-1])
    rows = [slice(start, start + _BLOCK) for start in range(0, level.size, _BLOCK)]
    blocks = [_block(level[k], w[k], b[k], nu, tolerance) for k in rows]
    if not blocks:
        blocks = [(np.zeros(0, dtype=np.longdouble), np.zeros(0, dtype=bool), np.zeros(0))]
    log_tail, above, error = (np.concatenate(part).reshape(shape) for part in zip(*blocks, strict=True))
    return _both(log_tail, above, error)


def _half_of_rare(p: FloatArray, degrees: int) -> FloatArray:
    half = np.asarray(gammainccinv(0.5 * degrees, p), dtype=np.float64)
    for _ in range(_POLISHES if degrees <= _MOST_POLISHED else 0):
        scaled = _scaled_tail(half, degrees)
        excess = (np.exp(-0.5 * half) / p) * (scaled * np.exp(-0.5 * half)) - 1.0
        half = half + np.log1p(excess) * scaled / _density(half, degrees)
    return half


_POLISHES = 2  # Newton steps; the start is good to 1e-8 or better in every release of SciPy
# Beyond so many degrees of freedom powers and factorials leave the range of a double: the start stays as it is.
_MOST_POLISHED = 200


def _scaled_tail(half: FloatArray, degrees: int) -> FloatArray:
    """Return exp(half) P(chi-square > 2 half): all terms are positive."""
    if degrees % 2:
        total, power, term = erfcx(np.sqrt(half)), 0.5, np.sqrt(half) / gamma(1.5)
    else:
        total, power, term = np.zeros_like(half), 0.0, np.ones_like(half)
    while power < 0.5 * degrees - 0.75:
        total = total + term
        power += 1.0
        term = term * half / power
    return np.asarray(total, dtype=np.float64)


def _density(half: FloatArray, degrees: int) -> FloatArray:
    """Return exp(half) times the density of the half."""
    return np.asarray(half ** (0.5 * degrees - 1.0) / gamma(0.5 * degrees), dtype=np.float64)


def _half_of_common(p: FloatArray, degrees: int) -> FloatArray:
    q = 1.0 - p
    half = np.asarray(gammaincinv(0.5 * degrees, q), dtype=np.float64)
    for _ in range(_POLISHES if degrees <= _MOST_POLISHED else 0):
        scaled = _scaled_lower_tail(half, degrees)
        excess = np.exp(-half) * scaled / q - 1.0
        half = half * (1.0 - excess * scaled / (half * _density(half, degrees)))
    return half


_SERIES_TERMS = 30  # and two a degree of freedom: the last is below 1e-17 of the sum


def _scaled_lower_tail(half: FloatArray, degrees: int) -> FloatArray:
    """Return exp(half) P(chi-square <= 2 half) for a half below the median, by its power series."""
    order = 0.5 * degrees
    term = half**order / gamma(order + 1.0)
    total = term
    for k in range(1, _SERIES_TERMS + 2 * degrees):
        term = term * half / (order + k)
        total = total + term
    return np.asarray(total, dtype=np.float64)


def _broadcast(
    threshold: ArrayLike, weights: ArrayLike, offsets: ArrayLike, degrees: ArrayLike, constant: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return threshold less constant, weights, offsets (with common leading axes) and degrees, checked."""
    raw = [np.asarray(part, dtype=np.float64) for part in (threshold, weights, offsets, degrees, constant)]
    level, w, b, nu, added = raw
    if w.ndim < 1 or b.ndim < 1:
        raise ValueError(f"weights of shape {w.shape} and offsets of shape {b.shape} need a last axis")
    for name, part in (("weights", w), ("offsets", b), ("degrees", nu), ("constant", added)):
        if not np.all(np.isfinite(part)):
            raise ValueError(f"{name} has {np.sum(~np.isfinite(part))} values that are not finite")
    if np.any(np.isnan(level)):
        raise ValueError(f"threshold has {np.sum(np.isnan(level))} values that are not a number")
    if np.any(nu <= 0.0) or nu.ndim > 1:
        raise ValueError(f"degrees has shape {nu.shape} and least {np.min(nu)}; allowed is (n,), above 0")
    lead = np.broadcast_shapes(level.shape, w.shape[:-1], b.shape[:-1], added.shape)
    count = np.broadcast_shapes(w.shape[-1:], b.shape[-1:], nu.shape)
    return (
        np.broadcast_to(level - added, lead),
        np.broadcast_to(w, lead + count),
        np.broadcast_to(b, lead + count),
        np.broadcast_to(nu, count),
    )


def _block(
    level: FloatArray, w: FloatArray, b: FloatArray, nu: FloatArray, tolerance: float
) -> tuple[LongArray, NDArray[np.bool_], FloatArray]:
    """Return the logarithm of the smaller-sided tail, whether it is the upper one, and its relative error."""
    with np.errstate(over="ignore"):
        above = level >= np.sum(w * (nu + b * b), axis=1)
    sign = np.where(above, 1.0, -1.0)
    signed, signed_level = w * sign[:, None], level * sign
    log_tail = np.full(level.shape, -np.inf, dtype=np.longdouble)
    error = np.zeros_like(level)
    # a form with no positive weight never exceeds 0; no form exceeds infinity
    top = np.max(signed, axis=1, initial=0.0)
    open_rows = np.flatnonzero(((top > 0.0) | (signed_level < 0.0)) & np.isfinite(level))
    if open_rows.size:
        tail = _dimensionless(signed[open_rows], b[open_rows], signed_level[open_rows], nu)
        log_tail[open_rows], error[open_rows] = _upper_tail(tail, tolerance)
    return log_tail, above, error


@dataclass(frozen=True, kw_only=True)
class _UpperTail:
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


def _dimensionless(w: FloatArray, b: FloatArray, level: FloatArray, nu: FloatArray) -> _UpperTail:
    """Return the problem in units of the first singularity on the right, or else of the level or the weights."""
    weight = np.asarray(w, dtype=np.longdouble)
    top = np.max(weight, axis=1)
    bounded = top > 0.0
    other = np.minimum(np.max(np.abs(weight), axis=1), np.abs(level))
    scale = np.where(bounded, top, other)
    ratio = weight / scale[:, None]
    shift = 0.5 * ratio * np.asarray(b, dtype=np.longdouble) ** 2
    unit_level = np.asarray(level, dtype=np.longdouble) / (2.0 * scale)
    used = np.any(w != 0.0, axis=0)
    return _UpperTail(ratio=ratio[:, used], shift=shift[:, used], level=unit_level, degrees=nu[used], bounded=bounded)


def _upper_tail(tail: _UpperTail, tolerance: float) -> tuple[LongArray, FloatArray]:
    """Return log P(Q > level) and its relative error, by the first contour that reaches the tolerance."""
    saddle = _find_saddle(tail)
    two_sided = bool(np.any(tail.bounded & np.any(tail.ratio < 0.0, axis=1)))
    contour = _contour_through(tail, saddle, None)
    value, error = _integrate(contour, tolerance, two_sided=two_sided)
    for bend in (1.0, -1.0, 0.0):
        failed = np.flatnonzero(error > tolerance)
        if not failed.size:
            break
        other = _contour_through(tail.rows(failed), saddle.rows(failed), bend)
        again, error_again = _integrate(other, tolerance, two_sided=True)
        better = error_again < error[failed]
        value[failed[better]], error[failed[better]] = again[better], error_again[better]
    exponent, rounding = _exponent(tail, saddle)
    poor = error[exponent > _LOG_OF_ZERO]
    if np.any(poor > tolerance):
        raise ArithmeticError(
            f"the contour integral reached a relative error of {np.max(poor):.3g} only, asked were {tolerance:g}, "
            f"at {np.sum(poor > tolerance)} of {poor.size} points; try a larger tolerance, or leave out weights "
            "that are more than 12 decades below the largest"
        )
    log_tail = exponent + np.log(np.abs(value) * contour.width / saddle.at)
    return np.minimum(log_tail, np.longdouble(0.0)), error + rounding


@dataclass(frozen=True, kw_only=True)
class _Saddle:
    """The crossing point s = `at`, its distance to the singularity at 1, and 1 - ratio_j s there.

    The three agree with each other to extended precision, also where `at` rounds to 1.
    """

    at: NDArray[np.longdouble]
    to_pole: FloatArray
    factor: NDArray[np.longdouble]

    def rows(self, chosen: NDArray[np.intp]) -> Self:
        """Return the same for the chosen forms only."""
        return type(self)(at=self.at[chosen], to_pole=self.to_pole[chosen], factor=self.factor[chosen])


_BRACKET = 80.0  # |logit| of the saddle: exp(-80) is far below any ratio that double precision can form
_ENOUGH = 0.05  # distance from the saddle, in widths of the saddle, that costs the integral nothing
_MAX_STEPS = 200


def _find_saddle(tail: _UpperTail) -> _Saddle:
    """Return a point close to the real minimum of K(s) - s level - ln s, for every form.

    The condition K'(s) = level + 1/s is written as a balance of positive terms, growing against falling, and
    solved for ln or logit of s, where both sides are nearly power laws: Newton's method on the logarithm of
    their quotient takes 3 to 6 steps, a bracket catches what it overshoots. The integral does not depend on
    the point chosen, so a twentieth of the width of the saddle is near enough.
    """
    low, high = _bracket(tail)
    logit = np.clip(_first_guess(tail), low, high)
    for _ in range(_MAX_STEPS):
        gap, slope, distance = _balance(tail, logit)
        if bool(np.all(distance < _ENOUGH)):
            break
        low = np.where(gap < 0.0, logit, low)
        high = np.where(gap < 0.0, high, logit)
        step = logit - gap / slope
        inside = (step > low) & (step < high)
        moved = np.where(inside, step, 0.5 * (low + high))
        logit = np.where(distance < _ENOUGH, logit, moved)
    at, to_pole, factor = _point(tail.ratio, tail.bounded, logit)
    return _Saddle(at=at, to_pole=np.asarray(to_pole, dtype=np.float64), factor=factor)


def _bracket(tail: _UpperTail) -> tuple[FloatArray, FloatArray]:
    """Return limits of logit s (bounded forms) or of ln s, from upper bounds of each term (others)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.asarray(np.abs(tail.level), dtype=float)
        offsets = np.where(tail.ratio != 0.0, 2.0 * tail.shift / tail.ratio, 0.0)
        terms = 1.0 + 0.5 * np.sum(tail.degrees + offsets.astype(float), axis=1)
        lowest = np.where(tail.bounded, -_BRACKET, -np.log(size))
        highest = np.where(tail.bounded, _BRACKET, np.log(terms) - np.log(size))
    return lowest, highest


def _first_guess(tail: _UpperTail) -> FloatArray:
    """Return logit s of one standard deviation of Q (bounded), or ln s of a chi-square lower tail."""
    ratio, shift, level = (np.asarray(part, dtype=float) for part in (tail.ratio, tail.shift, tail.level))
    one_sided = np.where(tail.bounded[:, None], ratio, 0.0)
    variance: FloatArray = np.sum((0.5 * tail.degrees * one_sided + 2.0 * shift) * one_sided, axis=1)
    with np.errstate(divide="ignore"):
        unbounded = np.log1p(0.5 * np.sum(tail.degrees)) - np.log(np.abs(level))
    guess: FloatArray = np.where(tail.bounded, -0.5 * np.log(1.0 + variance), unbounded)
    return guess


def _balance(tail: _UpperTail, logit: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ln(growing/falling), its slope in the logit, and the distance to the saddle in widths."""
    ratio, shift, level = (np.asarray(part, dtype=float) for part in (tail.ratio, tail.shift, tail.level))
    at, to_pole, factor = _point(ratio, tail.bounded, logit)
    central = 0.5 * tail.degrees * ratio / factor
    shifted = shift / factor / factor
    first = central + shifted
    second = (central + 2.0 * shifted) * ratio / factor
    positive = ratio > 0.0
    growing = np.sum(first, axis=1, where=positive) + np.maximum(-level, 0.0)
    falling = 1.0 / at + np.maximum(level, 0.0) - np.sum(first, axis=1, where=~positive)
    growth = np.sum(second, axis=1, where=positive)
    fall = -1.0 / at**2 - np.sum(second, axis=1, where=~positive)
    slope = (growth / growing - fall / falling) * np.where(tail.bounded, at * to_pole, at)
    distance = np.abs(growing - falling) / np.sqrt(growth - fall)
    return np.log(growing / falling), slope, distance


def _point(ratio: RealArray, bounded: NDArray[np.bool_], logit: FloatArray) -> tuple[RealArray, RealArray, RealArray]:
    """Return s, its distance to the singularity at 1, and 1 - ratio s, in the precision of the ratios."""
    inverse = np.asarray(np.exp(-logit), dtype=ratio.dtype)
    to_pole = inverse / (1.0 + inverse)
    at = np.where(bounded, 1.0 / (1.0 + inverse), 1.0 / inverse)
    # For poles on the right written with the distance to the first, so that nothing cancels close to it.
    near = (1.0 - ratio) + ratio * to_pole[:, None]
    return at, to_pole, np.where(ratio > 0.0, near, 1.0 - ratio * at[:, None])


@dataclass(frozen=True, kw_only=True)
class _Contour:
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


def _contour_through(tail: _UpperTail, saddle: _Saddle, bend: float | None) -> _Contour:
    """Return the contour through the saddle."""
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
    return _Contour(
        pole=ratio * width[:, None],
        quadratic=shifted * ratio * width[:, None] ** 2,
        linear=np.asarray(linear, dtype=float) * width,
        origin=width / at,
        width=width,
        bend=way,
        straight=_straight(turn * way, _reach(tail, saddle, way) / width),
        degrees=tail.degrees,
    )


def _natural_bend(tail: _UpperTail, turn: FloatArray) -> FloatArray:
    left_free = ~np.any(tail.ratio < 0.0, axis=1)
    either = np.where(turn >= 0.0, 1.0, -1.0)
    return np.where(~tail.bounded, -1.0, np.where(left_free, 1.0, either))


# Asymptotes of the hyperbola stand atan(1/0.7) = 55 degrees off the real axis: 10 degrees on the safe side of
# 45, where the modulus of every factor stops falling, and 35 from 90, where exp(-s level) stops falling.
_SLOPE = 0.7


def _straight(turn: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the length of the straight middle from the curvature of steepest descent, within bounds."""
    curvature = np.clip(turn, 0.0625 / reach, 0.5 / reach)
    with np.errstate(divide="ignore"):
        return np.maximum(0.5 * _SLOPE / curvature, 1.0)


def _reach(tail: _UpperTail, saddle: _Saddle, way: FloatArray) -> FloatArray:
    """Return the distance to the first singularity on the side the path bends to, 0 not counted."""
    most_negative = np.asarray(np.minimum(np.min(tail.ratio, axis=1), 0.0), dtype=float)
    with np.errstate(divide="ignore"):
        left = np.asarray(saddle.at, dtype=float) + np.where(most_negative < 0.0, -1.0 / most_negative, np.inf)
    right = np.where(tail.bounded, saddle.to_pole, np.inf)
    return np.where(way > 0.0, right, left)


# Of more, such as counts behind 500 angles, the product leaves the range of a double: their logarithms are summed.
_MOST_FACTORS = 32
_NEGLIGIBLE = 1e-17  # of the integrand at the saddle; the path ends there
_NEAR_ENDS = np.arange(2.0, 9.0)  # sinh of 3 ends a Gaussian, of 7 a chi-square
_FAR_ENDS = np.arange(9.0, 100.0)  # weights of both signs and a zero level: a power law is all that ends it
_FEWEST_NODES, _FIRST_NODES = 8, 24
_NODES_PER_DIGIT = 2.4
_MOST_NODES = 1536
_TALLEST = 10.0  # times the saddle: beyond, the path climbs a wrong hill and cancellation costs digits


def _integrate(contour: _Contour, tolerance: float, *, two_sided: bool) -> tuple[FloatArray, FloatArray]:
    """Return the integral over the path, in units of the integrand at the saddle, and its relative error.

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


def _end(contour: _Contour) -> tuple[FloatArray, FloatArray]:
    """Return the v where the integrand becomes negligible, and the greatest height on the way there."""
    end, tallest = _first_crossing(contour, _NEAR_ENDS)
    far = np.flatnonzero(~np.isfinite(end))
    if far.size:
        further, higher = _first_crossing(contour.rows(far), _FAR_ENDS)
        end[far], tallest[far] = further, np.maximum(tallest[far], higher)
    return end, tallest


def _first_crossing(contour: _Contour, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    count = contour.linear.size
    height = _height(contour, np.broadcast_to(ends, (count, ends.size)))
    small = height < _NEGLIGIBLE
    first = np.argmax(small, axis=1)
    found = np.any(small, axis=1)
    before = np.arange(ends.size) < np.where(found, first, ends.size)[:, None]
    tallest = np.max(height, axis=1, where=before, initial=1.0)
    end = _between(height, ends, first)
    return np.where(found, end, np.inf), tallest


def _height(contour: _Contour, v: FloatArray) -> FloatArray:
    """Return the modulus of integrand times dz/dv; infinite where it overflows."""
    z, speed = _path(contour, v)
    with np.errstate(over="ignore", invalid="ignore"):
        modulus = np.abs(_relative_integrand(contour, z) * speed)
    return np.where(np.isfinite(modulus), modulus, np.inf)


def _path(contour: _Contour, v: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return z(v) and (dz/dv)/i."""
    height = np.sinh(v)
    middle = np.where(np.isfinite(contour.straight), contour.straight, 1.0)[:, None]
    slope = (_SLOPE * contour.bend * np.isfinite(contour.straight))[:, None]
    radius = np.sqrt(height * height + middle * middle)
    steepness = slope * height / radius
    aside = height * steepness * radius / (radius + middle)
    speed = np.sqrt(1.0 + height * height)
    return aside + 1j * height, speed - 1j * (speed * steepness)


def _relative_integrand(contour: _Contour, z: ComplexArray) -> ComplexArray:
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


def _beyond(contour: _Contour, end: FloatArray) -> FloatArray:
    """Return a bound of what the end of the path leaves out.

    The path may be closed by a vertical line from its end: no singularity is off the real axis, and far up
    the integrand falls as a power. The greatest |integrand z| there bounds the remainder to a factor of ten.
    """
    finite = np.where(np.isfinite(end), end, 1.0)
    z, _ = _path(contour, finite[:, None])
    up = np.abs(z) * 2.0 ** np.arange(-3.0, 60.0, 1.5)
    height = np.abs(_relative_integrand(contour, z + 1j * up)) * (np.abs(z) + up)
    return np.asarray(np.max(np.where(np.isfinite(height), height, np.inf), axis=1), dtype=np.float64)


def _trapezoid(contour: _Contour, end: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray]:
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


def _sum(contour: _Contour, step: FloatArray, numbers: FloatArray) -> FloatArray:
    z, speed = _path(contour, step[:, None] * numbers)
    integrand = _relative_integrand(contour, z)
    total: FloatArray = np.sum(integrand.real * speed.real - integrand.imag * speed.imag, axis=1)
    return total


def _exponent(tail: _UpperTail, saddle: _Saddle) -> tuple[LongArray, FloatArray]:
    """Return K(s) - s level at the saddle, in extended precision, and what rounding does to it."""
    shifted = tail.shift * saddle.at[:, None] / saddle.factor
    central = -0.5 * tail.degrees * np.log(saddle.factor)
    linear = tail.level * saddle.at
    exponent = np.sum(shifted + central, axis=1) - linear
    size = np.sum(np.abs(shifted) + np.abs(central), axis=1) + np.abs(linear)
    return exponent, np.asarray(np.finfo(np.longdouble).eps * size, dtype=np.float64)


def _both(long_log: LongArray, above: NDArray[np.bool_], error: FloatArray) -> TailProbabilities:
    log_tail = np.asarray(long_log, dtype=np.float64)
    with np.errstate(under="ignore"):
        tail = np.asarray(np.exp(long_log), dtype=np.float64)
    other = 1.0 - tail
    with np.errstate(divide="ignore"):
        log_other = np.log1p(-tail)
    return TailProbabilities(
        upper=np.where(above, tail, other),
        lower=np.where(above, other, tail),
        log_upper=np.where(above, log_tail, log_other),
        log_lower=np.where(above, log_other, log_tail),
        error=error,
    )
