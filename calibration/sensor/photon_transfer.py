"""Gain from the photon-transfer curve: temporal variance against mean."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.sensor.frame_statistics import LevelStatistics
from calibration.sensor.linearity import LinearityCurve, fit_linearity
from calibration.sensor.saturation import SaturationLevel
from calibration.sensor.scatter_fit import ScatterFit, fit_with_scatter
from calibration.sensor.transfer_points import TransferPoints, UsablePoints

FloatArray = NDArray[np.float64]

# From this many levels on a bend is fitted; below it would take all the freedom there is.
BEND_LEVELS = 5
# From this many on a cubic term is fitted too, where the response of the sensor is not known.
_CUBIC_LEVELS = 8
_PASSES = 3
_TERMS = 3


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
