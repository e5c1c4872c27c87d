"""Mean and variance of DoLP by quadrature: an outer rule over S0, an inner one over (S1, S2) given S0.

Everything is formed as a deviation from p0 = |mean of (S1, S2)| / mean of S0, so that nothing cancels at high
signal-to-noise ratio: with Q = sqrt(S1^2 + S2^2) and q(z) = |mean of (S1, S2) given S0|,

    E[P | z] - p0 = (q - p0 S0) / S0 + (E[Q | z] - q) / S0,        var P = E var(Q | z) / S0^2 + var E[P | z].
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.processing.dolp_distribution.frame import DolpFrame
from model.processing.dolp_distribution.rice import rice_moments

FloatArray = NDArray[np.float64]

# Standard deviations of S0 that are covered; a normal variable is farther out with probability 2e-21.
_REACH = 9.5
# Share of its mean down to which S0 is followed: moments that depend on what is below do not exist.
_LEAST_INTENSITY = 0.01
_LOG_STEP = 0.1
_NODE_CLASSES = (1, 40, 80, 160, 512, 1024, 2048)


@dataclass(frozen=True, kw_only=True)
class ExactMoments:
    """Mean and standard deviation of DoLP, each of shape (M,), with estimated absolute errors.

    Parameters
    ----------
    mean, std
        Moments.
    mean_error, std_error
        Difference to the rule with half of the outer nodes, plus rounding.
    """

    mean: FloatArray
    std: FloatArray
    mean_error: FloatArray
    std_error: FloatArray


def exact_moments(frame: DolpFrame, *, refinement: int = 0) -> ExactMoments:
    """Return mean and standard deviation of DoLP by quadrature.

    Parameters
    ----------
    frame
        M distributions with S0 bounded away from zero: mean of S0 at least several standard deviations.
    refinement
        How often the step of the outer rule is halved.

    Returns
    -------
    ExactMoments
        To about 1e-13, whatever the signal-to-noise ratio of the polarization.
    """
    centre, width = _outer_map(frame)
    low, high = _outer_ends(centre, width)
    needed = 2.0**refinement * (high - low) / _LOG_STEP + 1.0
    needed[frame.sigma_0 == 0.0] = 1.0
    columns = np.zeros((4, len(frame)))
    previous = 0.0
    for count in _NODE_CLASSES:
        chosen = np.flatnonzero((needed > previous) & ((needed <= count) | (count == _NODE_CLASSES[-1])))
        for part in _chunks(chosen, count):
            rule = _outer_rule(frame[part], centre[part], width[part], count)
            columns[:, part] = _with_outer_rule(frame[part], *rule)
        previous = count
    return ExactMoments(mean=columns[0], std=columns[1], mean_error=columns[2], std_error=columns[3])


def _chunks(index: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    size = max(1, 16384 // count)
    return [index[start : start + size] for start in range(0, index.size, size)]


def _outer_map(frame: DolpFrame) -> tuple[FloatArray, FloatArray]:
    """Return centre and scale of z = centre + scale sinh(tau): where (S1, S2) given S0 passes close to zero."""
    slope_squared = frame.slope_1**2 + frame.slope_2**2
    moving = slope_squared > 0.0
    safe = np.where(moving, slope_squared, 1.0)
    nearest = -(frame.mean_1 * frame.slope_1 + frame.mean_2 * frame.slope_2) / safe
    miss = (frame.mean_1 * frame.slope_2 - frame.mean_2 * frame.slope_1) / np.sqrt(safe)
    scale = np.hypot(miss, frame.radius_2) / np.sqrt(safe)
    passes = moving & (np.abs(nearest) < _REACH) & (scale < 3.0)
    return np.where(passes, nearest, 0.0), np.where(passes, np.clip(scale, 1e-8, 3.0), 3.0)


def _outer_ends(centre: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.arcsinh((-_REACH - centre) / width), np.arcsinh((_REACH - centre) / width)


def _outer_rule(frame: DolpFrame, centre: FloatArray, width: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes z and weights, shape (M, count), for the mean over a standard normal z with S0 > 0."""
    if count == 1:
        return np.zeros((len(frame), 1)), np.ones((len(frame), 1))
    low, high = _outer_ends(centre, width)
    tau = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, count)
    z = centre[:, None] + width[:, None] * np.sinh(tau)
    weights = np.exp(-0.5 * z**2) * np.cosh(tau)
    return z, np.where(z > -(1.0 - _LEAST_INTENSITY) * frame.snr_0[:, None], weights, 0.0)


def _with_outer_rule(frame: DolpFrame, z: FloatArray, weights: FloatArray) -> FloatArray:
    """Return mean, standard deviation and their estimated errors, shape (4, M)."""
    p0 = (frame.polarized / frame.mean_0)[:, None]
    deviation, variance = _given_intensity(frame, z, weights, p0)
    mean, std = _combined(deviation, variance, weights)
    every_other = np.zeros_like(weights)
    every_other[:, ::2] = weights[:, ::2]
    coarse_mean, coarse_std = _combined(deviation, variance, every_other)
    rounding = 1e-15 * p0[:, 0]
    return np.stack(
        [
            p0[:, 0] + mean,
            std,
            np.abs(mean - coarse_mean) + 1e-14 * np.abs(mean) + rounding,
            np.abs(std - coarse_std) + 1e-13 * std,
        ]
    )


def _combined(deviation: FloatArray, variance: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    share = weights / np.sum(weights, axis=1, keepdims=True)
    mean = np.sum(share * deviation, axis=1)
    spread = np.sum(share * (variance + (deviation - mean[:, None]) ** 2), axis=1)
    return mean, np.sqrt(spread)


def _given_intensity(
    frame: DolpFrame, z: FloatArray, weights: FloatArray, p0: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return E[P | z] - p0 and var(P | z), shape (M, count)."""
    used = weights > 0.0
    s0 = np.where(used, frame.mean_0[:, None] + frame.sigma_0[:, None] * z, 1.0)
    first = frame.mean_1[:, None] + frame.slope_1[:, None] * z
    second = frame.mean_2[:, None] + frame.slope_2[:, None] * z
    length = np.hypot(first, second)
    row, column = np.nonzero(used)
    pulled, spread = np.zeros_like(z), np.zeros_like(z)
    pulled[row, column], spread[row, column] = rice_moments(
        first[row, column], second[row, column], frame.radius_1[row], frame.radius_2[row]
    )
    slide = _slide(frame, z, length, p0, s0)
    return (slide + pulled) / s0, spread / s0**2


def _slide(frame: DolpFrame, z: FloatArray, length: FloatArray, p0: FloatArray, s0: FloatArray) -> FloatArray:
    """Return |mean of (S1, S2) given S0| - p0 S0 as a difference of squares, from the excess over a common factor."""
    excess = frame.mean_1 * frame.excess_1 + frame.mean_2 * frame.excess_2
    linear = -2.0 * z * (excess / np.where(frame.sigma_0 > 0.0, frame.mean_0, 1.0))[:, None]
    square = _slope_square(frame)[:, None] * z**2
    total = length + p0 * s0
    return np.where(total > 0.0, (linear + square) / np.where(total > 0.0, total, 1.0), 0.0)


def _slope_square(frame: DolpFrame) -> FloatArray:
    """Return |slope|^2 - p0^2 sigma_0^2, with slope = (sigma_0 mean - excess) / mean_0."""
    total = 0.0 * frame.mean_0
    for mean, slope, excess in (
        (frame.mean_1, frame.slope_1, frame.excess_1),
        (frame.mean_2, frame.slope_2, frame.excess_2),
    ):
        total = total - (excess / frame.mean_0) * (slope + frame.sigma_0 * mean / frame.mean_0)
    return total
