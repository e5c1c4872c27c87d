"""Slow, literal computations that the model's results are held against."""

import mpmath
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

FloatArray = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_GRADED = np.concatenate([[0.0], np.geomspace(0.05, 1e9, 38)])
_AROUND = np.concatenate([-_GRADED[:0:-1], _GRADED])
_REACH = 38.0


def covariance(
    sigmas: tuple[float, float, float], *, r01: float = 0.0, r02: float = 0.0, r12: float = 0.0, psi_deg: float = 0.0
) -> FloatArray:
    """Return a covariance of Stokes parameters from deviations and correlations, turned by an angle."""
    correlation = np.array([[1.0, r01, r02], [r01, 1.0, r12], [r02, r12, 1.0]])
    twice = np.deg2rad(2.0 * psi_deg)
    turn = np.array([[1, 0, 0], [0, np.cos(twice), -np.sin(twice)], [0, np.sin(twice), np.cos(twice)]])
    matrix = turn @ np.diag(sigmas) @ correlation @ np.diag(sigmas) @ turn.T
    return 0.5 * (matrix + matrix.T)


def dolp_tails(mean: ArrayLike, cov: ArrayLike, x: float) -> tuple[float, float]:
    """Return Pr(DoLP <= x | S0 > 0) and its complement, by a dense double integral of positive terms.

    Given S0, (S1, S2) is integrated over the disc along one principal axis with Gauss-Legendre panels, across it in
    closed form. The parameters come from 50-digit arithmetic, so that thin covariances are exact. Relative error
    about 1e-14 times the signal-to-noise ratio, in both tails.
    """
    m0, s, m, c, r = _conditional(mean, cov)
    z, weight = _outer(m0, s, m, c, x)
    lower, upper = np.zeros_like(z), np.zeros_like(z)
    for start in range(0, z.size, 200):
        part = slice(start, start + 200)
        lower[part], upper[part] = _disc(
            x * (m0 + s * z[part]), m[0] + c[0] * z[part], m[1] + c[1] * z[part], r[0], r[1]
        )
    lit = float(mpmath.ncdf(mpmath.mpf(m0) / s)) if s > 0.0 else 1.0
    return float(weight @ lower) / lit, float(weight @ upper) / lit


def _conditional(mean: ArrayLike, cov: ArrayLike) -> tuple[float, float, list[float], list[float], list[float]]:
    """Return S0's mean and deviation, then mean, slope and deviations of (S1, S2) given S0 in principal axes."""
    with mpmath.workdps(50):
        mu = [mpmath.mpf(float(value)) for value in np.asarray(mean)]
        sigma = [[mpmath.mpf(float(value)) for value in row] for row in np.asarray(cov)]
        s = mpmath.sqrt(sigma[0][0])
        slope = [sigma[0][j] / s if s else mpmath.mpf(0) for j in (1, 2)]
        a, b = sigma[1][1] - slope[0] ** 2, sigma[2][2] - slope[1] ** 2
        h = sigma[1][2] - slope[0] * slope[1]
        larger = (a + b + mpmath.sqrt((a - b) ** 2 + 4 * h**2)) / 2
        smaller = (a * b - h**2) / larger
        angle = mpmath.atan2(2 * h, a - b) / 2
        cos, sin = mpmath.cos(angle), mpmath.sin(angle)

        def turned(pair: list[mpmath.mpf]) -> list[float]:
            return [float(cos * pair[0] + sin * pair[1]), float(cos * pair[1] - sin * pair[0])]

        radii = [float(mpmath.sqrt(value)) for value in (larger, smaller)]
        return float(mu[0]), float(s), turned(mu[1:]), turned(slope), radii


def _panels(edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    lower, upper = edges[..., :-1], edges[..., 1:]
    half = 0.5 * (upper - lower)[..., None]
    nodes = 0.5 * (lower + upper)[..., None] + half * _NODES
    return nodes.reshape(*edges.shape[:-1], -1), (half * _WEIGHTS).reshape(*edges.shape[:-1], -1)


def _outer(m0: float, s: float, m: list[float], c: list[float], x: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights over S0, graded towards every place where the disc's edge meets the mean."""
    if s == 0.0:
        return np.zeros(1), np.ones(1)
    low = max(-m0 / s, -_REACH)
    edges = [low, *np.arange(-_REACH, _REACH + 0.01, 1.0), *(-m0 / s + np.geomspace(1e-12, _REACH, 20))]
    for place in _meetings(m0, s, m, c, x):
        step = np.concatenate([[0.0], np.geomspace(1e-10, 30.0, 22)])
        edges += [*(place - step), *(place + step)]
    inside = np.array(sorted({edge for edge in edges if low <= edge <= _REACH}))
    z, weight = _panels(inside)
    return z, weight * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)


def _meetings(m0: float, s: float, m: list[float], c: list[float], x: float) -> list[float]:
    square = c[0] ** 2 + c[1] ** 2 - (x * s) ** 2
    linear = 2.0 * (m[0] * c[0] + m[1] * c[1] - x * x * m0 * s)
    constant = m[0] ** 2 + m[1] ** 2 - (x * m0) ** 2
    roots = np.roots([square, linear, constant])
    places = [float(root.real) for root in roots]
    pairs = [(sign * mean - x * m0, x * s - sign * slope) for mean, slope in zip(m, c, strict=True) for sign in (1, -1)]
    places += [above / below for above, below in pairs if below != 0.0]
    if c[0] or c[1]:
        places.append(-(m[0] * c[0] + m[1] * c[1]) / (c[0] ** 2 + c[1] ** 2))
    return places


def _disc(
    radius: FloatArray, first: FloatArray, second: FloatArray, sigma_1: float, sigma_2: float
) -> tuple[FloatArray, FloatArray]:
    """Return the probability inside and outside of discs, for normal variables of given means and deviations."""
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.clip((first[:, None] + _AROUND * sigma_1) / radius[:, None], -1.0, 1.0)
        across = np.clip((np.abs(second)[:, None] + _AROUND * sigma_2) / radius[:, None], 0.0, 1.0)
    ends = np.tile([-0.5 * np.pi, 0.5 * np.pi], (radius.size, 1))
    edges = np.concatenate([np.arcsin(along), np.arccos(across), -np.arccos(across), ends], axis=1)
    angle, weight = _panels(np.sort(edges, axis=1))
    y, half = radius[:, None] * np.sin(angle), radius[:, None] * np.cos(angle)
    bell = np.exp(-0.5 * ((y - first[:, None]) / sigma_1) ** 2) / (sigma_1 * np.sqrt(2.0 * np.pi)) * half * weight
    low, high = (-half - second[:, None]) / sigma_2, (half - second[:, None]) / sigma_2
    between = np.where(low > 0.0, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
    beside = ndtr((-radius - first) / sigma_1) + ndtr(-(radius - first) / sigma_1)
    return np.sum(bell * between, axis=1), np.sum(bell * (ndtr(low) + ndtr(-high)), axis=1) + beside
