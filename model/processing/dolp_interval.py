"""Intervals of DoLP, and a score of (S1, S2), that hold where there is hardly any polarization.

DoLP is the length of a vector: noise makes it longer, and an interval of one standard error to either side of it misses
0 most of the time. `dolp_intervals` takes every true DoLP from which the measured vector is not too far. How far
that is follows from Rice's law, between that of two degrees of freedom at 0 and that of one where noise is small.
`joint_score` holds a measured vector against a predicted one in both components at once.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments
from model.numerics import ndtri

FloatArray = NDArray[np.float64]

LEVELS = (0.6827, 0.95)
# From this signal to noise on, the first-order interval differs by less than 0.2 % of its width.
_PLAIN_SNR = 30.0
_REACH = 7.0
# Chi-square of two degrees of freedom that noise exceeds one time in twenty.
_LIMIT_95 = 5.991


def is_polarized(normalized: Moments) -> bool:
    """Return whether (S1, S2) / S0 differs from 0 at 95 %; if not, its angle is not determined."""
    return chi_square(normalized.mean, normalized.cov) > _LIMIT_95


def chi_square(vector: FloatArray, cov: FloatArray) -> float:
    """Return the square of a vector in a covariance, infinite where that leaves it no room."""
    if np.linalg.eigvalsh(cov)[0] <= 0.0:
        return np.inf if np.any(vector) else 0.0
    return float(vector @ np.linalg.solve(cov, vector))


def dolp_intervals(normalized: Moments) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the 68 and the 95 % interval of DoLP.

    Parameters
    ----------
    normalized
        Moments of (S1 / S0, S2 / S0), shape (2,).

    Notes
    -----
    The set of true lengths P whose nearest vector is within c(P) of the measured one, in its covariance. At P = 0 and
    where P is large that covers exactly, between them exactly where the covariance is alike in both directions.
    """
    vector, cov = normalized.mean, normalized.cov
    length = float(np.hypot(*vector))
    axis = vector / length if length > 0.0 else np.array([1.0, 0.0])
    across = np.array([-axis[1], axis[0]])
    along_std, across_std = (float(np.sqrt(np.maximum(one @ cov @ one, 0.0))) for one in (axis, across))
    widest = max(along_std, across_std)
    if length > _PLAIN_SNR * widest or chi_square(axis, cov) == np.inf:
        low, high = ((length - k * along_std, length + k * along_std) for k in (1.0, -float(ndtri(0.025))))
        return low, high
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


def joint_score(apart: FloatArray, cov: FloatArray) -> float | None:
    """Return how far two vectors are apart, as a standard normal score: its upper tail is that of chi-square.

    None where their covariance leaves no room.
    """
    found = chi_square(apart, cov)
    return float(-ndtri(np.exp(-0.5 * min(found, 1400.0)))) if np.isfinite(found) else None


def _where_below(at: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the ends of where values are at most 0, between their nodes."""
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
    """Return lengths in standard errors, and for each level how far a measured length may be off such a true one."""
    at = np.concatenate([np.linspace(0.0, 4.0, 41), np.linspace(4.5, 20.0, 32)])
    found = [_limits_at(length) for length in at]
    return at, tuple(np.array(one) for one in zip(*found, strict=True))


def _limits_at(length: float) -> list[float]:
    """Return c of Pr(|r - P| <= c) = level for each level, r of Rice's law with unit deviation."""
    off = np.linspace(-min(length, 6.0), 6.0, 601)
    radius, turns = length + off, (np.arange(128) + 0.5) * np.pi / 128
    # The law's Bessel function as a mean over directions, scaled by what the exponential takes away.
    bessel = np.mean(np.exp(radius[:, None] * length * (np.cos(turns) - 1.0)), axis=1)
    density = radius * np.exp(-0.5 * off**2) * bessel
    cumulated = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    sizes = np.linspace(0.5, 3.0, 1001)
    held = np.interp(sizes, off, cumulated) - np.interp(-sizes, off, cumulated)
    return [float(np.interp(level, held / cumulated[-1], sizes)) for level in LEVELS]
