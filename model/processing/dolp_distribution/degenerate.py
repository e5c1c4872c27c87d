"""Distribution of DoLP where the Stokes parameters fluctuate in a line, or in a plane through zero light.

There the directions of the Stokes parameters fill no area, and the line integral of `dolp_cone` has nothing to
integrate. In a plane through zero, DoLP is a function of a ratio of normal variables; on a line, of S0 alone.
"""

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_distribution import normal_ratio
from model.processing.dolp_distribution.frame import DolpFrame
from model.processing.dolp_distribution.normal_ratio import NormalRatio
from model.processing.dolp_distribution.tails import Tails
from model.special_functions import ndtr

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Relative thickness below which a fluctuation is a line or a plane: what is left out is of the order of its square.
_THIN = 1e-8


def on_a_line(frame: DolpFrame) -> Mask:
    """Return where only one combination of the Stokes parameters fluctuates, or none.

    Parameters
    ----------
    frame
        M distributions.

    Returns
    -------
    ndarray of bool
        Shape (M,).
    """
    swing = np.hypot(frame.excess_1, frame.excess_2) / np.abs(np.where(frame.mean_0 == 0.0, 1.0, frame.mean_0))
    return np.asarray(frame.radius_1 <= _THIN * swing)


def in_a_plane_through_zero(frame: DolpFrame) -> Mask:
    """Return where two combinations fluctuate, in a plane that holds zero light, or one with S0 known.

    Parameters
    ----------
    frame
        M distributions.

    Returns
    -------
    ndarray of bool
        Shape (M,).
    """
    flat = frame.radius_2 <= _THIN * frame.radius_1
    through_zero = (np.abs(frame.excess_2) <= 10.0 * _THIN * frame.sigma_0 * frame.radius_1) & ~_known(frame)
    return np.asarray(flat & (through_zero | _known(frame)) & ~on_a_line(frame))


def plane_tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density of DoLP for fluctuations in a plane through zero light.

    Parameters
    ----------
    frame
        M distributions.
    x
        DoLP, shape (M,), > 0 and finite.

    Returns
    -------
    Tails
        Given S0 > 0; the density is infinite at the least possible DoLP.
    """
    known = _known(frame)
    sigma = np.where(known, 1.0, frame.sigma_0)
    shift = np.where(known, 0.0, frame.slope_1 / sigma)
    least = np.abs(np.where(known, frame.mean_2 / np.where(known, frame.mean_0, 1.0), frame.slope_2 / sigma))
    ratio = NormalRatio(
        mean_y=np.where(known, frame.mean_1, frame.excess_1 / sigma),
        sigma_y=frame.radius_1,
        mean_x=frame.mean_0,
        sigma_x=np.where(known, 0.0, frame.sigma_0),
    )
    possible = x >= least
    half = np.sqrt(np.where(possible, (x - least) * (x + least), 0.0))
    inside = normal_ratio.between(ratio, -shift - half, -shift + half)
    infinite = np.full_like(x, np.inf)
    below = normal_ratio.between(ratio, -infinite, -shift - half)
    above = normal_ratio.between(ratio, -shift + half, infinite)
    both = normal_ratio.density(ratio, -shift - half) + normal_ratio.density(ratio, -shift + half)
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.where(possible, both * np.where(half > 0.0, x / half, np.inf), 0.0)
    lit = normal_ratio.positive(ratio)
    return Tails(lower=np.where(possible, inside, 0.0) / lit, upper=(below + above) / lit, density=density / lit)


def line_tails(frame: DolpFrame, x: FloatArray) -> Tails:
    """Return both tails and the density of DoLP for fluctuations on a line.

    Parameters
    ----------
    frame
        M distributions.
    x
        DoLP, shape (M,), > 0 and finite.

    Returns
    -------
    Tails
        Given S0 > 0. Where DoLP is the same all along the line, tails are steps and the density is infinite
        at the step.
    """
    limit_1, limit_2, pull_1, pull_2 = _line(frame)
    pull = np.hypot(pull_1, pull_2)
    fixed = pull == 0.0
    safe = np.where(fixed, 1.0, pull)
    along = (limit_1 * pull_1 + limit_2 * pull_2) / safe
    least = np.abs(limit_1 * pull_2 - limit_2 * pull_1) / safe
    half = np.sqrt(np.where(x > least, (x - least) * (x + least), 0.0))
    lit = ndtr(frame.snr_0)
    first, second = _s0_between(frame, (-along - half) / safe, (-along + half) / safe)
    lower = np.where(x >= least, first, 0.0)
    density = np.where(x > least, second * x / np.where(half > 0.0, half, 1.0) / safe, 0.0)
    step = np.hypot(limit_1, limit_2)
    lower = np.where(fixed, (x >= step) * lit, lower)
    upper = np.where(fixed, (x < step) * lit, np.where(x >= least, _s0_outside(frame, along, half, safe), lit))
    density = np.where(fixed, np.where(x == step, np.inf, 0.0), density)
    return Tails(lower=lower / lit, upper=upper / lit, density=density / lit)


def _known(frame: DolpFrame) -> Mask:
    """Return where S0 fluctuates so little that DoLP does not notice beside the fluctuation of S1 and S2."""
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.where(frame.sigma_0 > 0.0, frame.sigma_0 * frame.polarized / np.abs(frame.mean_0), 0.0)
    linked = np.hypot(frame.slope_1, frame.slope_2)
    return np.asarray((own + linked <= _THIN * frame.radius_1) & (frame.mean_0 > 10.0 * frame.sigma_0))


def _line(frame: DolpFrame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return k and g with (S1, S2) / S0 = k + g / S0 on the line."""
    known = frame.sigma_0 == 0.0
    sigma = np.where(known, 1.0, frame.sigma_0)
    k_1 = np.where(known, frame.mean_1 / np.where(known, frame.mean_0, 1.0), frame.slope_1 / sigma)
    k_2 = np.where(known, frame.mean_2 / np.where(known, frame.mean_0, 1.0), frame.slope_2 / sigma)
    g_1 = np.where(known, 0.0, frame.excess_1 / sigma)
    g_2 = np.where(known, 0.0, frame.excess_2 / sigma)
    return k_1, k_2, g_1, g_2


def _score(frame: DolpFrame, inverse: FloatArray) -> FloatArray:
    """Return (1 / inverse - mean) / sigma of S0; plus infinity for an inverse of zero or less."""
    sigma = np.where(frame.sigma_0 == 0.0, 1.0, frame.sigma_0)
    some = inverse > 0.0
    safe = np.where(some, inverse, 1.0)
    return np.where(some, (1.0 - safe * frame.mean_0) / (safe * sigma), np.inf)


def _s0_between(frame: DolpFrame, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the probability of low <= 1 / S0 <= high with S0 > 0, and the sum of the densities of 1 / S0 there."""
    upper, lower = _score(frame, low), _score(frame, high)
    flip = lower > 0.0
    inside = ndtr(np.where(flip, -lower, upper)) - ndtr(np.where(flip, -upper, lower))
    return np.where(high > 0.0, inside, 0.0), _inverse_density(frame, low) + _inverse_density(frame, high)


def _inverse_density(frame: DolpFrame, inverse: FloatArray) -> FloatArray:
    sigma = np.where(frame.sigma_0 == 0.0, 1.0, frame.sigma_0)
    score = _score(frame, inverse)
    bell = np.exp(-0.5 * np.minimum(score**2, 1500.0)) / np.sqrt(2.0 * np.pi)
    return np.where(inverse > 0.0, bell / (sigma * np.where(inverse > 0.0, inverse, 1.0) ** 2), 0.0)


def _s0_outside(frame: DolpFrame, along: FloatArray, half: FloatArray, pull: FloatArray) -> FloatArray:
    """Return the probability of S0 > 0 with 1 / S0 outside of the interval in which DoLP is small enough."""
    bright = ndtr(-_score(frame, (-along - half) / pull))
    high = (-along + half) / pull
    dim = ndtr(_score(frame, np.maximum(high, 0.0))) - ndtr(-frame.snr_0)
    return np.asarray(bright + dim)
