"""Tail probabilities of Q = sum_j w_j (z_j + b_j)^2, z standard normal: the distribution behind RX and behind DoLP."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing.quadratic_forms.contour_integral import contour_through, integrate
from model.processing.quadratic_forms.saddle_contour import FloatArray, Saddle, UpperTail, find_saddle

LongArray = NDArray[np.longdouble]

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

    Parameters
    ----------
    threshold
        Leading shape (...), any real number or infinity.
    weights
        w, shape (..., n), finite: positive, negative or zero in any mixture. A zero weight counts for nothing,
        whatever its offset; a component without spread belongs into `constant`.
    offsets
        b, shape (..., n), finite.
    degrees
        Component j is w_j times a chi-square variable of this many degrees of freedom and non-centrality
        b_j^2; shape (n,), positive. The default of 1 is the square of one normal variable.
    constant
        Added to Q, leading shape (...).
    tolerance
        Relative, 1e-12 to 0.01; of the tail that is integrated.

    Returns
    -------
    TailProbabilities
        Arrays of the leading shape that `threshold`, `weights`, `offsets` and `constant` broadcast to.

    Raises
    ------
    ValueError
        If an argument is out of its range or shapes do not fit.
    ArithmeticError
        If no contour reaches the tolerance for a probability that a double can hold: not seen for weights of one
        sign, or for weights of both within 12 decades of each other.

    Notes
    -----
    Inversion of the moment generating function over a hyperbola through the saddle point of the integrand,
    by the trapezoidal rule, which converges geometrically; nodes are doubled until two results agree to the
    tolerance. Along a straight line from the saddle of K(s) - s threshold at 45 to 90 degrees from the real
    axis, each factor of a component falls in modulus on the side of its own singularity; so with weights of
    one sign nothing cancels, however spread the weights and deep the tail. With both signs the path may
    climb; then it is bent the other way, or not at all, and the first that reaches the tolerance counts.
    Rounding of the arguments alone changes a tail of probability exp(-x) by about x 1e-16 relative,
    and one between components with offsets b by about b 1e-16 per standard deviation.

    References
    ----------
    Rice, SIAM J. Sci. Stat. Comput. 1, 438 (1980), doi:10.1137/0901032 (saddle-point contours);
    Imhof, Biometrika 48, 419 (1961), doi:10.1093/biomet/48.3-4.419 (the distribution).
    """
    _require_tolerance(tolerance)
    level, w, b, nu = _broadcast(threshold, weights, offsets, degrees, constant)
    shape = level.shape
    level, w, b = level.ravel(), w.reshape(-1, w.shape[-1]), b.reshape(-1, b.shape[-1])
    rows = [slice(start, start + _BLOCK) for start in range(0, level.size, _BLOCK)]
    blocks = [_block(level[k], w[k], b[k], nu, tolerance) for k in rows]
    if not blocks:
        blocks = [(np.zeros(0, dtype=np.longdouble), np.zeros(0, dtype=bool), np.zeros(0))]
    log_tail, above, error = (np.concatenate(part).reshape(shape) for part in zip(*blocks, strict=True))
    return _both(log_tail, above, error)


def _require_tolerance(tolerance: float) -> None:
    if not _SMALLEST_TOLERANCE <= tolerance <= 0.01:
        raise ValueError(f"tolerance is {tolerance}; allowed is {_SMALLEST_TOLERANCE:g} to 0.01 (relative)")


def _require_converged(error: FloatArray, tolerance: float) -> None:
    if np.any(error > tolerance):
        raise ArithmeticError(
            f"the contour integral reached a relative error of {np.max(error):.3g} only, asked were {tolerance:g}, "
            f"at {np.sum(error > tolerance)} of {error.size} points; try a larger tolerance, or leave out weights "
            "that are more than 12 decades below the largest"
        )


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


def _dimensionless(w: FloatArray, b: FloatArray, level: FloatArray, nu: FloatArray) -> UpperTail:
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
    return UpperTail(ratio=ratio[:, used], shift=shift[:, used], level=unit_level, degrees=nu[used], bounded=bounded)


def _upper_tail(tail: UpperTail, tolerance: float) -> tuple[LongArray, FloatArray]:
    """Return log P(Q > level) and its relative error, by the first contour that reaches the tolerance."""
    saddle = find_saddle(tail)
    two_sided = bool(np.any(tail.bounded & np.any(tail.ratio < 0.0, axis=1)))
    contour = contour_through(tail, saddle, None)
    value, error = integrate(contour, tolerance, two_sided=two_sided)
    for bend in (1.0, -1.0, 0.0):
        failed = np.flatnonzero(error > tolerance)
        if not failed.size:
            break
        other = contour_through(tail.rows(failed), saddle.rows(failed), bend)
        again, error_again = integrate(other, tolerance, two_sided=True)
        better = error_again < error[failed]
        value[failed[better]], error[failed[better]] = again[better], error_again[better]
    exponent, rounding = _exponent(tail, saddle)
    _require_converged(error[exponent > _LOG_OF_ZERO], tolerance)
    log_tail = exponent + np.log(np.abs(value) * contour.width / saddle.at)
    return np.minimum(log_tail, np.longdouble(0.0)), error + rounding


def _exponent(tail: UpperTail, saddle: Saddle) -> tuple[LongArray, FloatArray]:
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
