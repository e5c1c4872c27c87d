"""Tails and density of DoLP given S0 > 0, for pairs of a distribution and a value, each to relative precision."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_distribution.border import BorderIntegrals, border_integrals
from model.processing.dolp_distribution.cone import Border
from model.processing.dolp_distribution.frame import DolpFrame
from model.quadrature import integrate_panels
from model.special_functions import ndtr

FloatArray = NDArray[np.float64]

# Below this share of what it is a difference of, a tail is integrated from the density instead (which is slower).
_CANCELLED_LOWER = 1e-3
_CANCELLED_UPPER = 1e-2


@dataclass(frozen=True, kw_only=True)
class Tails:
    """Distribution of DoLP given S0 > 0 at M values, each of shape (M,).

    Parameters
    ----------
    lower
        Pr(DoLP <= x | S0 > 0).
    upper
        Pr(DoLP > x | S0 > 0).
    density
        Probability density at x.
    """

    lower: FloatArray
    upper: FloatArray
    density: FloatArray


def tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density for pairs of a distribution and a value.

    Parameters
    ----------
    frame
        M distributions with radius_1 > 0 whose plane of fluctuation, if thin, does not hold the apex.
    x
        DoLP, shape (M,), > 0 and finite.

    Returns
    -------
    Tails
        Given S0 > 0.
    """
    border = Border(frame=frame, a=np.ones_like(x), b=x)
    found = border_integrals(border)
    lower, upper = _from_turns(frame, border.gap > 0.0, found)
    lit = ndtr(frame.snr_0)
    small = lower < _CANCELLED_LOWER * found.turn_size
    if np.any(small):
        lower[small] = _near_zero(frame[small], x[small])
    far = upper < _CANCELLED_UPPER * np.minimum(np.maximum(1.0 - lit, found.turn_size), 1.0)
    if np.any(far):
        upper[far] = _far_out(frame[far], x[far])
    return Tails(lower=lower / lit, upper=upper / lit, density=found.density / lit)


def _from_turns(frame: DolpFrame, inside: NDArray[np.bool_], found: BorderIntegrals) -> tuple[FloatArray, FloatArray]:
    """Return the probabilities inside and outside of the cone, with S0 > 0."""
    lit, dark = ndtr(frame.snr_0), ndtr(-frame.snr_0)
    # With the complement, the line integral misses the pole opposite to the mean where that is in the cone.
    opposite = (frame.mean_0 < 0.0) & found.close & ~inside
    near = found.turn + opposite
    lower = np.where(found.close, near, np.where(inside, 1.0 - found.turn, -found.turn))
    outside = np.where(found.close, 1.0 - near, np.where(inside, found.turn, 1.0 + found.turn))
    upper = np.where(frame.mean_0 > 0.0, outside - dark, lit - lower)
    return lower, upper


def _near_zero(frame: DolpFrame, x: FloatArray) -> FloatArray:
    """Return the probability inside of a slender cone as the integral of a positive density."""

    def integrand(index: NDArray[np.int64], values: FloatArray) -> FloatArray:
        inside = frame[np.repeat(index, values.shape[1])]
        found = border_integrals(Border(frame=inside, a=np.ones(values.size), b=values.ravel()))
        return found.density.reshape(1, *values.shape)

    return _integral(integrand, x)


def _far_out(frame: DolpFrame, x: FloatArray) -> FloatArray:
    """Return the probability beyond a wide cone, from the density of the inverse of DoLP."""

    def integrand(index: NDArray[np.int64], values: FloatArray) -> FloatArray:
        inside = frame[np.repeat(index, values.shape[1])]
        found = border_integrals(Border(frame=inside, a=values.ravel(), b=np.ones(values.size)))
        return found.density.reshape(1, *values.shape)

    return _integral(integrand, 1.0 / x)


def _integral(integrand: Callable[[NDArray[np.int64], FloatArray], FloatArray], end: FloatArray) -> FloatArray:
    # At zero itself a direction of a singular covariance may have no density.
    cuts = np.stack([1e-15 * end, end], axis=1)
    found = integrate_panels(integrand, cuts=cuts, tolerance=1e-11, noise=np.full(end.shape, 1e-12), degree=12)
    return np.asarray(found.value[:, 0])
