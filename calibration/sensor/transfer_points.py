"""Points of a photon-transfer curve: temporal variance against mean, and which of them a fit may use."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import refused
from calibration.sensor.ceiling import is_saturated
from calibration.sensor.dark_signal import QUANTISATION_VAR_DN2, DarkMatch, DarkSignal
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.saturation import SaturationLevel, saturation_level

FloatArray = NDArray[np.float64]

# Upper end of the fit, as a share of saturation. The standard's is 0.7, for a fit without a bend.
RANGE_OF_SATURATION = 0.8
# Between the range of the fit and saturation a response may bend by so much more than below.
_NEAR_SATURATION = 0.95
_BEND_BEYOND = (0.01, 0.015)
# Variance over signal of one level above both neighbours by this much, and by so many errors.
_SPIKE, _SPIKE_SIGMA = 1.1, 6.0
# Levels at the bright end that are compared, and by how much of its noise a mean is low where pixels are full.
_END_LEVELS, _CUT_OFF = 4, 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class TransferPoints:
    """The points of a photon-transfer curve, by ascending signal.

    Attributes
    ----------
    signal_dn : (n,) array
        Mean of each flat level less that of its dark [DN].
    variance_dn2 : (n,) array
        Temporal variance of each flat level less that of its dark [DN^2].
    flat_variance_dn2, flat_std_error_dn2 : (n,) arrays
        Temporal variance of the flat itself, and its sampling error [DN^2].
    dark_covariance_dn4 : (n, n) array
        Covariance of the errors that the points have from their darks [DN^4].
    black_error_dn : float
        Standard error that all signals share from the rounding of dark frames without noise [DN].
    saturated : (n,) array of bool
        More than 0.1 % of the samples are at the ceiling.
    """

    signal_dn: FloatArray
    variance_dn2: FloatArray
    flat_variance_dn2: FloatArray
    flat_std_error_dn2: FloatArray
    dark_covariance_dn4: FloatArray
    black_error_dn: float
    saturated: NDArray[np.bool_]

    @property
    def std_error_dn2(self) -> FloatArray:
        """Sampling error of `variance_dn2` [DN^2]."""
        error: FloatArray = np.sqrt(np.square(self.flat_std_error_dn2) + np.diag(self.dark_covariance_dn4))
        return error


def transfer_points(
    flats: Sequence[LevelStatistics], dark: DarkSignal, match: DarkMatch, *, ceiling_dn: int
) -> TransferPoints:
    """Return the points of the photon-transfer curve.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        By ascending mean.
    dark : DarkSignal
        The dark levels.
    match : DarkMatch
        Which darks belong to which flat.
    ceiling_dn : int
        Sample of a saturated pixel [DN].
    """
    signal = np.array([flat.mean_dn for flat in flats]) - match.weights @ dark.means_dn
    total = np.array([flat.temporal_variance_dn2 for flat in flats]) - _breakthrough_dn2(flats, signal)
    return TransferPoints(
        signal_dn=signal,
        variance_dn2=total - match.weights @ dark.variances_dn2,
        flat_variance_dn2=total,
        flat_std_error_dn2=np.array([flat.temporal_std_error_dn2 for flat in flats]),
        dark_covariance_dn4=match.weights @ dark.variance_covariance_dn4 @ match.weights.T,
        black_error_dn=float(np.sqrt(QUANTISATION_VAR_DN2)) if dark.quantisation_limited else 0.0,
        saturated=np.array([is_saturated(flat, ceiling_dn=ceiling_dn) for flat in flats]),
    )


def _breakthrough_dn2(flats: Sequence[LevelStatistics], signal_dn: FloatArray) -> FloatArray:
    """Return the variance that the fixed pattern adds to differences of frames whose light differs [DN^2].

    Pixels differ in their response, and by as much in what they see of a change of the light.
    """
    step_dn2 = np.array([0.5 * np.mean(np.square(np.diff(flat.frame_means_dn))) for flat in flats])
    noise_dn2 = np.array([flat.temporal_variance_dn2 / flat.n_pixels for flat in flats])
    spatial_dn2 = np.array([flat.spatial_variance_dn2 for flat in flats])
    bright = signal_dn >= 0.5 * signal_dn.max()
    pattern = max(float(np.median(spatial_dn2[bright] / np.square(signal_dn[bright]))), 0.0) if bright.any() else 0.0
    breakthrough: FloatArray = pattern * np.maximum(step_dn2 - noise_dn2, 0.0)
    return np.minimum(breakthrough, 0.5 * np.array([flat.temporal_variance_dn2 for flat in flats]))


@dataclass(frozen=True, kw_only=True, eq=False)
class UsablePoints:
    """Points of a photon-transfer curve that a fit may use.

    Attributes
    ----------
    mask : (n,) array of bool
        Up to 80 % of saturation.
    saturation : SaturationLevel or None
        Where the variance is largest; None where it never falls.
    """

    mask: NDArray[np.bool_]
    saturation: SaturationLevel | None


def usable_points(points: TransferPoints, *, full_signal_dn: float, light: FloatArray | None = None) -> UsablePoints:
    """Return the points up to 80 % of saturation with less than 0.1 % of their samples at the ceiling.

    Parameters
    ----------
    points : TransferPoints
        The curve, by ascending signal.
    full_signal_dn : float
        Signal that reaches the ceiling [DN]; it stands for saturation where the curve does not reach it.
    light : (n,) array or None
        What the light of the levels is proportional to, where that is known.

    Raises
    ------
    RefusedFramesError
        No level is brighter than its dark and below saturation.
    """
    saturation = _saturation(points, ~_spikes(points) & ~_proportional_end(points, light))
    top_dn = RANGE_OF_SATURATION * (saturation.signal_dn if saturation else full_signal_dn)
    used = (points.signal_dn > 0.0) & (points.signal_dn <= top_dn) & (points.flat_variance_dn2 > 0.0)
    used &= ~points.saturated
    if not used.any():
        raise refused(
            "no_usable_level",
            f"no flat level can be used: signals are {points.signal_dn.min():.4g} to {points.signal_dn.max():.4g} DN "
            f"above dark, {int(points.saturated.sum())} of {len(used)} levels are saturated; wanted are levels with "
            f"noise, brighter than dark and below {top_dn:.0f} DN: take flats at other exposures",
        )
    return UsablePoints(mask=used, saturation=saturation)


def beyond_range(points: TransferPoints, usable: UsablePoints, *, full_signal_dn: float) -> FloatArray:
    """Return by how much of itself the mean of each point may bend, that is too bright for the fit and not saturated.

    It is 0 for all others; 1 % of the mean up to 95 % of saturation, 1.5 % there.

    Parameters
    ----------
    points : TransferPoints
        The curve, by ascending signal.
    usable : UsablePoints
        The points of the fit.
    full_signal_dn : float
        Signal that reaches the ceiling [DN].
    """
    share = points.signal_dn / (usable.saturation.signal_dn if usable.saturation else full_signal_dn)
    beyond = ~points.saturated & (points.flat_variance_dn2 > 0.0) & (share > RANGE_OF_SATURATION) & (share < 1.0)
    bend: FloatArray = np.where(beyond, np.interp(share, [_NEAR_SATURATION, 1.0], _BEND_BEYOND), 0.0)
    return bend


def _saturation(points: TransferPoints, smooth: NDArray[np.bool_]) -> SaturationLevel | None:
    places = np.flatnonzero(smooth)
    found = saturation_level(signal_dn=points.signal_dn[smooth], variance_dn2=points.variance_dn2[smooth])
    return found and replace(found, lower=int(places[found.lower]), upper=int(places[found.upper]))


def _proportional_end(points: TransferPoints, light: FloatArray | None) -> NDArray[np.bool_]:
    """Return the brightest point alone, where its mean is as proportional to the light as that of its neighbours.

    Pixels that are full take off the mean what they take off the noise, some 0.4 standard deviations.
    """
    end = np.zeros(len(points.signal_dn), dtype=bool)
    if light is None or len(end) < _END_LEVELS or points.saturated[-1] or light[-_END_LEVELS:].min() <= 0.0:
        return end
    rate = points.signal_dn[-_END_LEVELS:] / light[-_END_LEVELS:]
    off = abs(float(rate[-1] / np.median(rate[:-1])) - 1.0)
    noise = float(np.sqrt(max(points.variance_dn2[-_END_LEVELS:-1].max(), 0.0)) / points.signal_dn[-1])
    end[-1] = off < _CUT_OFF * noise and points.variance_dn2[-1] < points.variance_dn2[:-1].max()
    return end


def _spikes(points: TransferPoints) -> NDArray[np.bool_]:
    """Return which points have more variance for their signal than both neighbours: not how a sensor saturates."""
    ratio = points.variance_dn2 / np.maximum(points.signal_dn, np.finfo(float).tiny)
    error = points.std_error_dn2 / np.maximum(points.signal_dn, np.finfo(float).tiny)
    padded = np.concatenate([[ratio[0]], ratio, [ratio[-1]]])
    beside = np.maximum(padded[:-2], padded[2:])
    spike: NDArray[np.bool_] = (ratio > _SPIKE * beside) & (ratio > beside + _SPIKE_SIGMA * error)
    spike[[0, -1]] = False
    return spike
