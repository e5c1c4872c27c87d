"""Gain from the photon-transfer curve: temporal variance against mean."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.errors import refused
from calibration.sensor.ceiling import is_saturated
from calibration.sensor.dark_signal import QUANTISATION_VAR_DN2, DarkMatch, DarkSignal
from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.linearity import LinearityCurve, fit_linearity
from calibration.sensor.saturation import SaturationLevel, saturation_level
from calibration.sensor.scatter_fit import ScatterFit, fit_with_scatter

FloatArray = NDArray[np.float64]

# From this many levels on a bend is fitted; below it would take all the freedom there is.
BEND_LEVELS = 5
# From this many on a cubic term is fitted too, where the response of the sensor is not known.
_CUBIC_LEVELS = 8
# Upper end of the fit, as a share of saturation. The standard's is 0.7, for a fit without a bend.
RANGE_OF_SATURATION = 0.8
_BELOW_SATURATION = 0.95
_PASSES = 3
# Variance over signal of one level above both neighbours by this much, and by so many errors.
_SPIKE, _SPIKE_SIGMA = 1.1, 6.0
# Levels at the bright end that are compared, and by how much of its noise a mean is low where pixels are full.
_END_LEVELS, _CUT_OFF = 4, 0.3
_TERMS = 3


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


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotonTransfer:
    """A photon-transfer curve and the fit through it: variance = gain * signal + bend * signal^2 + cubic * signal^3.

    Attributes
    ----------
    points : TransferPoints
        All points.
    used : (n,) array of bool
        Those that the fit uses.
    fit : ScatterFit
        Gain [DN/e-], and bend and cubic term where they were fitted, from the used points' variances; the
        scatter is that of the gain [DN/e-].
    linearity : LinearityCurve or None
        The sensor's response, where the light of the levels is known; the cubic term is then its.
    saturation : SaturationLevel or None
        Where the variance is largest; None where it never falls.
    relative_gain_error_of_change : float
        Part of the gain's relative error by a change of gain that cannot be told from one of the lamp.
    """

    points: TransferPoints
    used: NDArray[np.bool_]
    fit: ScatterFit
    linearity: LinearityCurve | None
    saturation: SaturationLevel | None
    relative_gain_error_of_change: float = 0.0

    @property
    def gain_dn_per_e(self) -> float:
        """Slope of the curve at no signal [DN/e-]."""
        return float(self.fit.parameters[0])

    @property
    def bend(self) -> float:
        """Coefficient of the squared signal; 0 where none was fitted."""
        return float(self.fit.parameters[1]) if len(self.fit.parameters) > 1 else 0.0

    @property
    def cubic(self) -> float:
        """Coefficient of the cubed signal; 0 where none was fitted."""
        return float(self.fit.parameters[2]) if len(self.fit.parameters) > 2 else 0.0

    @property
    def gain_response(self) -> FloatArray:
        """Derivative of the gain by the variance of each used point [1/(e- DN)]."""
        return self.fit.response[0, : int(np.count_nonzero(self.used))]

    @property
    def gain_shifts(self) -> FloatArray:
        """Change of the gain by leaving each used point out, the weights of the others kept [DN/e-]."""
        signal, n = self.points.signal_dn[self.used], int(np.count_nonzero(self.used))
        design = signal[:, None] ** np.arange(1, len(self.fit.parameters) + 1)
        leverage = np.einsum("ij,ji->i", design, self.fit.response[:, :n])
        residual = self.points.variance_dn2[self.used] - design @ self.fit.parameters
        shifts: FloatArray = -self.gain_response * residual / np.maximum(1.0 - leverage, np.finfo(float).eps)
        return shifts

    @property
    def gain_error_of_linearity_dn_per_e(self) -> float:
        """Part of the gain's standard error that the response of the sensor has; 0 where that is not known."""
        if self.linearity is None or len(self.fit.parameters) < _TERMS:
            return 0.0
        return abs(float(self.fit.response[0, -1])) * self.gain_dn_per_e * self.linearity.variance_cubic_error_per_dn2

    @property
    def gain_error_of_black_dn_per_e(self) -> float:
        """Part of the gain's standard error that all signals share from the rounding of dark frames."""
        return abs(float(self.gain_response.sum())) * self.gain_dn_per_e * self.points.black_error_dn

    @property
    def top_dn(self) -> float:
        """Signal of the brightest point of the fit [DN]."""
        return float(self.points.signal_dn[self.used].max())

    def variance_at(self, signal_dn: FloatArray) -> FloatArray:
        """Return the fitted temporal variance above that of the dark [DN^2]."""
        variance: FloatArray = signal_dn * (self.gain_dn_per_e + signal_dn * (self.bend + signal_dn * self.cubic))
        return variance


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


def beyond_range(points: TransferPoints, usable: UsablePoints, *, full_signal_dn: float) -> NDArray[np.bool_]:
    """Return the points that are too bright for the fit and still well below saturation.

    Parameters
    ----------
    points : TransferPoints
        The curve, by ascending signal.
    usable : UsablePoints
        The points of the fit.
    full_signal_dn : float
        Signal that reaches the ceiling [DN].
    """
    end_dn = usable.saturation.signal_dn if usable.saturation else full_signal_dn
    beyond: NDArray[np.bool_] = ~points.saturated & (points.flat_variance_dn2 > 0.0)
    return beyond & (points.signal_dn > RANGE_OF_SATURATION * end_dn) & (points.signal_dn < _BELOW_SATURATION * end_dn)


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


def fit_photon_transfer(
    flats: Sequence[LevelStatistics],
    points: TransferPoints,
    *,
    usable: UsablePoints,
    mean_variance_dn2: FloatArray,
    wrong_light: NDArray[np.bool_] | None = None,
) -> PhotonTransfer:
    """Return gain and bend of a photon-transfer curve.

    Parameters
    ----------
    flats : sequence of LevelStatistics
        The flats of the points, in their order.
    points : TransferPoints
        The curve, by ascending signal.
    usable : UsablePoints
        The points to use.
    mean_variance_dn2 : (n,) array
        Variance of each level's mean by noise and by wander of the light from frame to frame [DN^2].
    wrong_light : (n,) array of bool or None
        Levels whose exposure or photons are not to be believed: they are left out of the response.

    Notes
    -----
    Used are levels up to 80 % of saturation with less than 0.1 % of their samples at the ceiling. No intercept:
    the dark is taken off at the same exposure.

    Weights are the inverse sampling variances, as each level's own squares scatter. On real sensors points
    scatter by more (a measured CCD: 1.1 % where sampling gives 0.3 %), by something that does not average
    away within a level; a relative scatter is estimated from the points and added to all of them, so that a
    long stack does not decide the gain alone.

    No sensor is quite linear, and in some the charge of a bright pixel spreads: both bend the curve by a few
    per cent towards the bright end, so that a straight line finds a gain that depends on its range. The gain
    is the slope at no signal. Where the light of the levels is known, mean against light gives the response
    (`calibration.sensor.linearity`), and with it the cubic term of the curve; its error makes one shared by all points.
    From 5 levels on a quadratic term is fitted with the slope, always: choosing it by its significance would make
    the error bar wrong. It holds what the response says and what spreading charge adds, and makes the gain
    independent of a lamp that drifts evenly during the sweep. Without a response, from 8 levels on, the cubic
    term is fitted too. Each term makes the standard error of the gain larger by the first's: 1, 2, 3.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 6.6, which has no weights, no bend and no errors.
    """
    used = usable.mask
    known = used if wrong_light is None else used & ~wrong_light
    linearity = _linearity(flats, points, known, mean_variance_dn2) if known.any() else None
    fit = _fit_curve(points, used, linearity)
    return PhotonTransfer(points=points, used=used, fit=fit, linearity=linearity, saturation=usable.saturation)


def _linearity(
    flats: Sequence[LevelStatistics], points: TransferPoints, known: NDArray[np.bool_], mean_variance_dn2: FloatArray
) -> LinearityCurve | None:
    chosen = [flats[index] for index in np.flatnonzero(known).tolist()]
    return fit_linearity(chosen, points.signal_dn[known], noise_dn2=mean_variance_dn2[known])


def _n_terms(n_points: int, linearity: LinearityCurve | None) -> int:
    if n_points < BEND_LEVELS:
        return 1
    return _TERMS if linearity is not None or n_points >= _CUBIC_LEVELS else _TERMS - 1


def _fit_curve(points: TransferPoints, used: NDArray[np.bool_], linearity: LinearityCurve | None) -> ScatterFit:
    signal, variance, total = points.signal_dn[used], points.variance_dn2[used], points.flat_variance_dn2[used]
    design = signal[:, None] ** np.arange(1, _n_terms(len(signal), linearity) + 1)
    relative_error = points.flat_std_error_dn2[used] / total
    model, gain = total, float(np.median(variance / signal))
    for _ in range(_PASSES):
        # A point that is low by chance claims a small error; by the model's variance it does not.
        covariance = np.diag(np.square(relative_error * model)) + points.dark_covariance_dn4[np.ix_(used, used)]
        fit = _fit_terms(design, variance, covariance, linearity if design.shape[1] == _TERMS else None, gain)
        refined = total - variance + design @ fit.parameters
        if refined.min() <= 0.0 or fit.parameters[0] <= 0.0:
            break
        model, gain = refined, float(fit.parameters[0])
    return fit


def _fit_terms(
    design: FloatArray, variance: FloatArray, covariance: FloatArray, linearity: LinearityCurve | None, gain: float
) -> ScatterFit:
    """Return the fit; what the response says of the cubic term is one more value, in the last place."""
    signal = design[:, 0]
    if linearity is None:
        return fit_with_scatter(design, variance, sampling_covariance=covariance, scatter_shape=signal)
    error = gain * linearity.variance_cubic_error_per_dn2
    size = len(signal)
    larger = np.zeros((size + 1, size + 1))
    larger[:size, :size] = covariance
    larger[size, size] = error**2
    return fit_with_scatter(
        np.vstack([design, [-linearity.variance_cubic_per_dn2, 0.0, 1.0]]),
        np.append(variance, 0.0),
        sampling_covariance=larger,
        scatter_shape=np.append(signal, 0.0),
    )
