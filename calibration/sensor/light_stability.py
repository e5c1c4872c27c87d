"""Stability of the light from frame to frame, from the repeats within the levels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.frame_statistics import LevelStatistics

FloatArray = NDArray[np.float64]

_PASSES = 4
_NEIGHBOURS = 5
# Neighbours show another wander where it is more than chance makes of five, and know it to a factor of their own.
_TWICE, _FEW = 4.0, 2.5
_WILD, _WILDER = 0.03, 6.0


@dataclass(frozen=True, kw_only=True)
class LightStability:
    """Wander of a frame's mean beyond the noise of its pixels.

    Attributes
    ----------
    relative : float
        Standard deviation in proportion to the signal: a lamp that flickers.
    constant_dn : float
        Standard deviation that is the same at all signals: black level, beat of the mains with the exposure [DN].
    """

    relative: float
    constant_dn: float

    def variance_dn2(self, signal_dn: FloatArray) -> FloatArray:
        """Return the variance of a single frame's mean by wander [DN^2]."""
        variance: FloatArray = self.constant_dn**2 + np.square(self.relative * signal_dn)
        return variance


def light_stability(flats: Sequence[LevelStatistics], signal_dn: FloatArray) -> LightStability:
    """Return how much the means of frames wander that should be alike.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        Flats below saturation.
    signal_dn : (n,) array
        Their means, dark taken off [DN].

    Notes
    -----
    Least squares of the variances of frame means, less the noise of pixels, on 1 and signal^2, each weighted as a
    variance of its own size scatters; a part below 0 is none.
    """
    freedom = np.array([flat.n_frames - 1.0 for flat in flats])
    between = np.array([np.var(flat.frame_means_dn, ddof=1) for flat in flats])
    noise = np.array([flat.temporal_variance_dn2 / flat.n_pixels for flat in flats])
    design = np.column_stack([np.ones(len(flats)), np.square(signal_dn)])
    parts = np.zeros(2)
    for _ in range(_PASSES):
        weight = np.sqrt(freedom) / np.maximum(noise + design @ parts, np.finfo(float).tiny)
        parts = _not_below_zero(design * weight[:, None], (between - noise) * weight)
    return LightStability(relative=float(np.sqrt(parts[1])), constant_dn=float(np.sqrt(parts[0])))


def wander_variance_dn2(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, stability: LightStability
) -> FloatArray:
    """Return the variance of a single frame's mean by wander of the light, for each level [DN^2].

    Parameters
    ----------
    flats : sequence of LevelStatistics
        By ascending mean.
    signal_dn : (n,) array
        Their means, dark taken off [DN].
    stability : LightStability
        Of all of them.

    Notes
    -----
    By the two parts of the stability, or by what five neighbouring levels show where that is more: the beat of a lamp
    with the exposure follows neither part.
    """
    freedom = np.array([flat.n_frames - 1.0 for flat in flats])
    between = np.array([np.var(flat.frame_means_dn, ddof=1) for flat in flats])
    noise = np.array([flat.temporal_variance_dn2 / flat.n_pixels for flat in flats])
    model = stability.variance_dn2(signal_dn)
    window = np.ones(min(_NEIGHBOURS, len(flats)))
    seen, expected = (np.convolve(one * freedom, window, "same") for one in (between - noise, model + noise))
    # Neighbours wander by more or less counts as they are brighter or fainter: what is compared is what was expected.
    excess = seen / np.maximum(expected, np.finfo(float).tiny)
    local = np.where(excess > _TWICE, _FEW * excess * (model + noise), model)
    # Light that wanders by so much follows no normal law.
    wild = local > np.square(_WILD * signal_dn)
    variance: FloatArray = np.where(wild, _WILDER * local, local)
    return variance


def _not_below_zero(design: FloatArray, values: FloatArray) -> FloatArray:
    both: FloatArray = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    if both.min() >= 0.0:
        return both
    alone = np.maximum(design.T @ values, 0.0) / np.maximum(np.sum(np.square(design), axis=0), np.finfo(float).tiny)
    better = int(np.argmax(alone**2 * np.sum(np.square(design), axis=0)))
    parts: FloatArray = np.where(np.arange(2) == better, alone, 0.0)
    return parts
