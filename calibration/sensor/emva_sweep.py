"""The levels of a calibration as EMVA 1288 sees them: pairs for noise in time, two stacks for the fixed pattern."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.dark_signal import match_darks
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.saturation import saturation_level

FloatArray = NDArray[np.float64]

# A pair of frames is a point of the photon-transfer curve; more of them are a stack, for the fixed pattern.
_PAIR = 2
_LEAST_PAIRS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class EmvaSweep:
    """Points that the standard fits its lines through.

    Attributes
    ----------
    signal_dn, variance_dn2 : (n,) arrays
        Mean and temporal variance of the flats, those of the dark of the same exposure taken off; by ascending
        signal [DN, DN^2].
    light : (n,) array or None
        What the light on a pixel is proportional to: photons where known, else the exposure if that differs
        from flat to flat.
    light_is_photons : bool
        `light` is in photons.
    wander : float
        Standard deviation of a level's mean from frame to frame, relative; over the square root of two.
    exposure_s, dark_mean_dn, dark_variance_dn2 : (m,) arrays
        Dark levels by ascending exposure; exposure is 0 where it is not known.
    saturation : int or None
        The flat of largest variance; None where the variance does not fall.
    full_signal_dn : float
        Signal that reaches the ceiling [DN].
    n_frames : (n,) array of int
        Frames of each flat and of its dark.
    n_dark_frames : int
        Frames of all dark levels.
    """

    signal_dn: FloatArray
    variance_dn2: FloatArray
    light: FloatArray | None
    light_is_photons: bool
    wander: float
    exposure_s: FloatArray
    dark_mean_dn: FloatArray
    dark_variance_dn2: FloatArray
    saturation: int | None
    full_signal_dn: float
    n_frames: NDArray[np.int64]
    n_dark_frames: int

    @property
    def saturation_signal_dn(self) -> float:
        """Signal at saturation, that of the ceiling where saturation is not reached [DN]."""
        return self.full_signal_dn if self.saturation is None else float(self.signal_dn[self.saturation])

    @property
    def has_exposures(self) -> bool:
        """True where a line against the exposure of the darks has more points than parameters."""
        return len(np.unique(self.exposure_s)) > 2


def emva_sweep(flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics], *, ceiling_dn: int) -> EmvaSweep:
    """Return the sweep of a set of levels.

    Parameters
    ----------
    flats, darks : sequences of LevelStatistics
        At least one of each.
    ceiling_dn : int
        Sample of a saturated pixel [DN].

    Notes
    -----
    Where three levels or more are pairs, the others are left to the fixed pattern, as in the standard's own
    data sets; else all levels are points.
    """
    flats = sorted(_points(flats), key=lambda level: level.mean_dn)
    darks = sorted(_points(darks), key=lambda level: level.exposure_s or 0.0)
    weights = match_darks(flats, darks).weights
    dark_mean = np.array([dark.mean_dn for dark in darks])
    dark_variance = np.array([dark.temporal_variance_dn2 for dark in darks])
    signal = np.array([flat.mean_dn for flat in flats]) - weights @ dark_mean
    variance = np.array([flat.temporal_variance_dn2 for flat in flats]) - weights @ dark_variance
    peak = saturation_level(signal_dn=signal, variance_dn2=variance)
    light, light_is_photons = _light(flats)
    return EmvaSweep(
        signal_dn=signal,
        variance_dn2=variance,
        light=light,
        light_is_photons=light_is_photons,
        wander=_wander(flats),
        exposure_s=np.array([dark.exposure_s or 0.0 for dark in darks]),
        dark_mean_dn=dark_mean,
        dark_variance_dn2=dark_variance,
        saturation=None if peak is None else peak.lower,
        full_signal_dn=ceiling_dn - float(dark_mean.min()),
        n_frames=np.array([flat.n_frames for flat in flats]) + _dark_frames(weights, darks),
        n_dark_frames=sum(dark.n_frames for dark in darks),
    )


def _points(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    pairs = [level for level in levels if level.n_frames == _PAIR]
    return pairs if len(pairs) >= _LEAST_PAIRS else list(levels)


def _light(flats: Sequence[LevelStatistics]) -> tuple[FloatArray | None, bool]:
    photons = [flat.photons for flat in flats if flat.photons is not None]
    if len(photons) == len(flats):
        return np.array(photons), True
    exposures = [flat.exposure_s for flat in flats if flat.exposure_s is not None]
    swept = len(exposures) == len(flats) and len(set(exposures)) == len(flats)
    return (np.array(exposures) if swept else None), False


def _wander(flats: Sequence[LevelStatistics]) -> float:
    relative = [np.std(flat.frame_means_dn, ddof=1) / flat.mean_dn for flat in flats if flat.mean_dn > 0.0]
    return float(np.sqrt(np.mean(np.square(relative)) / _PAIR)) if relative else 0.0


def _dark_frames(weights: FloatArray, darks: Sequence[LevelStatistics]) -> NDArray[np.int64]:
    frames: NDArray[np.int64] = np.greater(weights, 0.0) @ np.array([dark.n_frames for dark in darks])
    return frames
