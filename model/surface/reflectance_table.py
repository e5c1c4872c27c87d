"""The lobe's directional-hemispherical reflectance E(theta) as a Chebyshev series, for many angles at once."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from model.quadrature import gauss_legendre
from model.surface.lobe import Lobe
from model.surface.reflectance import lobe_reflectance

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-7
_DEGREES = (12, 24, 48, 96, 192)
_WORST_ERROR = 1e-4
_MEAN_NODES = 48


@dataclass(frozen=True, kw_only=True, eq=False)
class ReflectanceTable:
    """A piecewise series for E(theta), theta in [0, pi/2).

    Parameters
    ----------
    edges
        Ends of the pieces in the stretched angle u, ascending: pi/2 - theta = stretch sinh(u).
    coefficients
        Of Chebyshev polynomials, one read-only array for each piece.
    stretch_rad
        Width of the layer at the horizon that is resolved.
    rise
        0, or for a lobe that is not bounded at grazing the cosine c0 of a factor: the series is for
        E c / (c + c0), c = cos theta.
    error
        Estimated absolute error of E wherever E is at most 1: interpolation, measured at angles that the series
        of half the degree was not made from, plus quadrature, plus the terms dropped.
    """

    edges: FloatArray
    coefficients: tuple[FloatArray, ...]
    stretch_rad: float
    rise: float
    error: float

    def at(self, theta_rad: FloatArray) -> FloatArray:
        """Return E of unpolarised light.

        Parameters
        ----------
        theta_rad
            Zenith angle [rad], shape (N,), in [0, pi/2).

        Returns
        -------
        ndarray
            Shape (N,).
        """
        u = np.arcsinh((0.5 * np.pi - theta_rad) / self.stretch_rad)
        series = self._piece(0, u)
        for index in range(1, len(self.coefficients)):
            beyond = u > self.edges[index]
            series[beyond] = self._piece(index, u[beyond])
        if self.rise > 0.0:
            series *= 1.0 + self.rise / np.cos(theta_rad)
        return series

    def _piece(self, index: int, u: FloatArray) -> FloatArray:
        low, high = self.edges[index], self.edges[index + 1]
        position = (2.0 * u - (low + high)) / (high - low)
        return np.asarray(chebyshev.chebval(position, self.coefficients[index]))

    def mean_nodes(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and weights for the cosine-weighted mean over the hemisphere.

        Returns
        -------
        tuple of ndarray
            theta [rad] and weights; the sum of weight times f(theta) is 2 integral f cos sin d(theta).

        References
        ----------
        Definition; Gauss-Legendre in the stretched angle, piece by piece.
        """
        node, weight = gauss_legendre(_MEAN_NODES)
        widths = np.diff(self.edges)[:, None]
        u = (self.edges[:-1, None] + widths * node).ravel()
        theta = 0.5 * np.pi - self.stretch_rad * np.sinh(u)
        return theta, (widths * weight).ravel() * self.stretch_rad * np.cosh(u) * np.sin(2.0 * theta)


@lru_cache(maxsize=64)
def reflectance_table(lobe: Lobe) -> ReflectanceTable:
    """Return the series of a lobe; made once for each lobe and kept.

    Parameters
    ----------
    lobe
        Index, slopes and shadowing.

    Returns
    -------
    ReflectanceTable
        Immutable, so that threads may share it.

    Raises
    ------
    ValueError
        If its error cannot be brought below 1e-4.
    """
    stretch = min(4.0 * lobe.slope_rms, 1.0)
    rise = lobe.slope_rms if lobe.shadowing == "none" else 0.0
    # The V-cavity's branches change their order at 45 deg, and E has a kink there in a higher derivative.
    angles = [0.5 * np.pi, 0.25 * np.pi, 0.0] if lobe.shadowing == "v-cavity" else [0.5 * np.pi, 0.0]
    edges = np.arcsinh((0.5 * np.pi - np.array(angles)) / stretch)
    sampled = _Sampling(lobe=lobe, stretch=stretch, rise=rise)
    pieces = [_series(sampled, low, high) for low, high in pairwise(edges)]
    error = max(piece_error for _, piece_error in pieces)
    _require_converged(error, lobe)
    return ReflectanceTable(
        edges=edges,
        coefficients=tuple(coefficients for coefficients, _ in pieces),
        stretch_rad=stretch,
        rise=rise,
        error=error,
    )


@dataclass(frozen=True, kw_only=True)
class _Sampling:
    lobe: Lobe
    stretch: float
    rise: float


def _series(sampling: _Sampling, low: float, high: float) -> tuple[FloatArray, float]:
    """Return coefficients between two stretched angles, and their error in E."""
    samples = _samples(sampling, low, high, _DEGREES[0])
    for degree in _DEGREES[1:]:
        coarse = chebyshev.chebval(_nodes(degree)[1::2], _coefficients(samples[0]))
        between = _samples(sampling, low, high, degree, odd_only=True)
        miss = float(np.max(np.abs(between[0] - coarse)))
        samples = _interleaved(samples, between)
        if miss < _TOLERANCE:
            break
    values, quadrature_error, factor = samples
    coefficients, dropped = _trimmed(_coefficients(values))
    coefficients.flags.writeable = False
    # An error of the series is larger in E; what counts is E up to 1 (and what rounding adds to 1).
    amplification = float(np.max(1.0 / factor, where=values <= 1.001 * factor, initial=1.0))
    return coefficients, (miss + float(np.max(quadrature_error)) + dropped) * amplification


def _nodes(degree: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * np.arange(degree + 1) / degree))


def _samples(sampling: _Sampling, low: float, high: float, degree: int, *, odd_only: bool = False) -> FloatArray:
    """Return rows of the tabulated function, its quadrature error, and the factor from E to it, at nodes."""
    position = _nodes(degree)[1::2] if odd_only else _nodes(degree)
    u = low + 0.5 * (position + 1.0) * (high - low)
    theta = np.clip(0.5 * np.pi - sampling.stretch * np.sinh(u), 0.0, 0.5 * np.pi)
    factor = np.cos(theta) / (np.cos(theta) + sampling.rise)
    reflectance = lobe_reflectance(theta, lobe=sampling.lobe)
    return np.stack([reflectance.s0 * factor, reflectance.error * factor, factor])


def _interleaved(even: FloatArray, odd: FloatArray) -> FloatArray:
    """Return samples at all nodes of a degree from those of half of it and those between."""
    together = np.empty((even.shape[0], even.shape[1] + odd.shape[1]))
    together[:, ::2], together[:, 1::2] = even, odd
    return together


def _coefficients(values: FloatArray) -> FloatArray:
    """Series through values at cos(pi j / degree), by the discrete cosine sum."""
    degree = values.size - 1
    j = np.arange(degree + 1)
    halved = values.copy()
    halved[[0, -1]] *= 0.5
    coefficients = np.cos(np.pi * np.outer(j, j) / degree) @ halved * (2.0 / degree)
    coefficients[[0, -1]] *= 0.5
    return np.asarray(coefficients)


def _trimmed(coefficients: FloatArray) -> tuple[FloatArray, float]:
    """Return the series without the tail that only costs time, and the sum of what was dropped."""
    tail = np.cumsum(np.abs(coefficients[::-1]))[::-1]
    count = max(int(np.sum(tail > 0.1 * _TOLERANCE)), 1)
    return coefficients[:count].copy(), float(np.sum(np.abs(coefficients[count:])))


def _require_converged(error: float, lobe: Lobe) -> None:
    if error > _WORST_ERROR:
        raise ValueError(
            f"the reflectance of the lobe n = {lobe.n:g}, k = {lobe.k:g}, slope_rms = {lobe.slope_rms:g} is known "
            f"to {error:.1g} only; allowed is {_WORST_ERROR:g}. A real index below 1 has a critical angle at which "
            "the quadrature is slow: give the absorption k, or leave out dhr"
        )
