"""Intervals of DoLP and AoLP, and a score of (S1, S2), valid for weak polarization.

DoLP is the length of a vector: noise makes it longer, and an interval of one standard error around it usually misses 0.
`dolp_intervals` includes every true DoLP within a distance of the measured vector that follows from Rice's law: two
degrees of freedom at 0, one for small noise. `aolp_limits_rad` includes every axis that passes close enough to the
measured vector. `joint_score` compares a measured vector with a predicted one in both components. Errors estimated from
few differences widen all of these by Student's law.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.numerics import ndtri, stdtr, stdtrit

FloatArray = NDArray[np.float64]

Intervals = tuple[tuple[float, float], tuple[float, float]]

LEVELS = (0.6827, 0.95)
# Signal-to-noise ratios below which the interval includes any axis: coverage is then nominal without polarization, and
# at most 4 % more with it (by drawing vectors).
_ANY_AXIS = (1.37, 2.31)
# Signal-to-noise ratio above which the first-order interval differs by less than 0.2 % of its width.
_PLAIN_SNR = 30.0
# Degrees of freedom above which Student's law is wider by less than half a per cent.
_MANY = 300.0
_REACH, _TINY = 7.0, 1e-300


def is_polarized(normalized: Moments) -> bool:
    """Return whether the 95 % interval of the axis of (S1, S2) / S0 excludes any axis."""
    return chi_square(normalized.mean, normalized.cov) > _ANY_AXIS[1] ** 2


def half_widths(freedom: float) -> tuple[float, float]:
    """Return the half widths of intervals of both levels in standard errors, by Student's law."""
    if freedom > _MANY:
        return 1.0, -float(ndtri(0.025))
    low, high = (float(stdtrit(freedom, 0.5 + 0.5 * level)) for level in LEVELS)
    return low, high


def student_intervals(value: float, std_error: float, freedom: float) -> Intervals | None:
    """Return the intervals of a number whose error is estimated from few differences; None for the normal ones."""
    if freedom > _MANY:
        return None
    low, high = ((value - k * std_error, value + k * std_error) for k in half_widths(freedom))
    return low, high


def chi_square(vector: FloatArray, cov: FloatArray) -> float:
    """Return the squared Mahalanobis length of a vector, infinite outside a singular covariance."""
    if np.linalg.eigvalsh(cov)[0] <= 0.0:
        return np.inf if np.any(vector) else 0.0
    return float(vector @ np.linalg.solve(cov, vector))


def aolp_limits_rad(normalized: Moments, freedom: float = np.inf) -> Intervals:
    """Return the ends of the 68 and 95 % intervals of AoLP, relative to the measured one.

    Parameters
    ----------
    normalized
        Moments of (S1 / S0, S2 / S0), shape (2,), not 0.
    freedom
        Degrees of freedom of their covariance.

    Notes
    -----
    The distance of the measured vector from the line along a direction is normal for any length of the vector. If the
    vector is shorter than the allowed distance, the interval includes all axes.
    """
    if np.linalg.eigvalsh(normalized.cov)[0] <= 0.0:
        return (0.0, 0.0), (0.0, 0.0)
    root = np.linalg.cholesky(normalized.cov)
    white = np.linalg.solve(root, normalized.mean)
    length = float(np.hypot(*white))
    found = []
    for any_axis, plain, k in zip(_ANY_AXIS, half_widths(np.inf), half_widths(freedom), strict=True):
        if length < any_axis * k / plain:
            found.append((-0.5 * np.pi, 0.5 * np.pi))
            continue
        # In whitened axes, then back in the plane of S1 and S2.
        along, across = white * np.sqrt(1.0 - (k / length) ** 2), np.array([-white[1], white[0]]) * k / length
        ends = [_turn(normalized.mean, root @ (along + side * across)) / 2.0 for side in (-1.0, 1.0)]
        found.append((min(ends), max(ends)))
    return found[0], found[1]


def _turn(start: FloatArray, end: FloatArray) -> float:
    """Return the angle from one vector to another, in (-pi, pi]."""
    return float(np.arctan2(start[0] * end[1] - start[1] * end[0], start @ end))


def dolp_intervals(normalized: Moments, freedom: float = np.inf) -> Intervals:
    """Return the 68 and the 95 % interval of DoLP.

    Parameters
    ----------
    normalized
        Moments of (S1 / S0, S2 / S0), shape (2,).
    freedom
        Degrees of freedom of their covariance.

    Notes
    -----
    The set of true lengths P whose nearest vector is within c(P) of the measured one, in its covariance. The coverage
    is exact at P = 0 and for large P, and between for an isotropic covariance.
    """
    vector, cov = normalized.mean, normalized.cov
    length = float(np.hypot(*vector))
    axis = vector / length if length > 0.0 else np.array([1.0, 0.0])
    across = np.array([-axis[1], axis[0]])
    along_std, across_std = (float(np.sqrt(np.maximum(one @ cov @ one, 0.0))) for one in (axis, across))
    widest = max(along_std, across_std)
    if length > _PLAIN_SNR * widest or chi_square(axis, cov) == np.inf:
        low, high = ((length - k * along_std, length + k * along_std) for k in half_widths(freedom))
        return low, high
    if freedom <= _MANY:
        wider = [k / plain for k, plain in zip(half_widths(freedom), half_widths(np.inf), strict=True)]
        first, second = (dolp_intervals(Moments(mean=vector, cov=cov * k**2)) for k in wider)
        return first[0], second[1]
    lengths = np.linspace(max(length - _REACH * widest, 0.0), length + _REACH * widest, 281)
    turns = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    inverse = np.linalg.inv(cov)
    unit = np.cos(turns)[:, None] * axis + np.sin(turns)[:, None] * across
    # |v - P u|^2 in the covariance, for every P and u.
    squares = np.einsum("ti,ij,tj->t", unit, inverse, unit)
    apart = lengths[:, None] ** 2 * squares - 2.0 * lengths[:, None] * (unit @ inverse @ vector)
    nearest = apart.min(axis=1) + float(vector @ inverse @ vector)
    at, limits = _limits()
    low, high = (_where_below(lengths, nearest - np.interp(lengths / across_std, at, limit) ** 2) for limit in limits)
    return low, high


def joint_score(apart: FloatArray, cov: FloatArray, freedom: float = np.inf) -> float | None:
    """Return the difference of two vectors as a standard normal score with the upper tail of chi-square, or of F.

    None if their covariance is zero.
    """
    found = min(chi_square(apart, cov), 1400.0) if np.linalg.eigvalsh(cov)[0] > 0.0 else np.inf
    if not np.isfinite(found):
        return None
    tail = np.exp(-0.5 * found) if freedom > _MANY else (1.0 + found / freedom) ** (-0.5 * freedom)
    return float(-ndtri(tail))


def student_score(score: float, freedom: float) -> float:
    """Return the standard normal score with the tail of one by Student's law."""
    return (
        score if freedom > _MANY else float(np.copysign(ndtri(max(float(stdtr(freedom, -abs(score))), _TINY)), score))
    )


def _where_below(at: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the ends of the range of values up to 0, interpolated between nodes."""
    below = np.flatnonzero(values <= 0.0)
    first, last = int(below[0]), int(below[-1])
    low, high = float(at[first]), float(at[last])
    if first > 0:
        low = float(np.interp(0.0, values[[first, first - 1]], at[[first, first - 1]]))
    if last + 1 < at.size:
        high = float(np.interp(0.0, values[[last, last + 1]], at[[last, last + 1]]))
    return low, high


@cache
def _limits() -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Return true lengths in standard errors, and for each level the allowed deviation of a measured length."""
    at = np.concatenate([np.linspace(0.0, 4.0, 41), np.linspace(4.5, 20.0, 32)])
    found = [_limits_at(length) for length in at]
    return at, tuple(np.array(one) for one in zip(*found, strict=True))


def _limits_at(length: float) -> list[float]:
    """Return c of Pr(|r - P| <= c) = level for each level, r of Rice's law with unit deviation."""
    off = np.linspace(-min(length, 6.0), 6.0, 601)
    radius, turns = length + off, (np.arange(128) + 0.5) * np.pi / 128
    # The law's Bessel function as a mean over directions, scaled against underflow.
    bessel = np.mean(np.exp(radius[:, None] * length * (np.cos(turns) - 1.0)), axis=1)
    density = radius * np.exp(-0.5 * off**2) * bessel
    cumulated = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    sizes = np.linspace(0.5, 3.0, 1001)
    held = np.interp(sizes, off, cumulated) - np.interp(-sizes, off, cumulated)
    return [float(np.interp(level, held / cumulated[-1], sizes)) for level in LEVELS]
