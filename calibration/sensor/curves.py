"""Curves through the levels of a sweep: dark signal, photon transfer, response, saturation, dark-current doubling.

*Dark signal*: mean and temporal variance of dark levels grow with the exposure; the slope of the mean is the dark
current, the values at no exposure are black level and read noise.

*Photon transfer*: the variance of photon noise is proportional to the signal, and the slope is the gain. The dark part
of each flat is subtracted first, at the same exposure (`match_darks`).

*Response*: mean against light. A nonlinear sensor also bends the photon-transfer curve, by a known
factor.

*Saturation*: the signal of largest temporal variance; beyond it pixels are full and their noise vanishes.

All signals and variances are in counts (DN) here; `calibration.sensor.noise` converts them to electrons.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from calibration.estimate import Estimate, number_with_error
from calibration.results import CalibrationError, refused
from calibration.sensor.fits import ScatterFit, fit_with_scatter
from calibration.sensor.levels import LevelStatistics, column, pattern_variances
from model.counts import ROUNDING_VAR_DN2, least_variance, rounding_error_rms, variance_error_rms

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
LightKind = Literal["exposure", "photons"]

# Below this temporal variance noise does not dither the rounding, and the measured variance is meaningless.
QUANTISATION_LIMIT_DN2 = 0.24
# The variance of unresolved noise is taken as uniform between that of rounding and the limit.
_UNRESOLVED_VARIANCE_DN2 = 0.5 * (ROUNDING_VAR_DN2 + QUANTISATION_LIMIT_DN2)
_UNRESOLVED_VARIANCE_ERROR_DN2 = (QUANTISATION_LIMIT_DN2 - ROUNDING_VAR_DN2) / np.sqrt(12.0)
_TINY = np.finfo(float).tiny

# Least share of samples at the ceiling in a saturated level.
SATURATED_FRACTION = 1e-3
# Noise alone puts a few samples of a level at its largest value, a few per mille if rounding is coarse.
_PILED_FRACTION, _ALIKE_LEVELS = 0.5, 2
# Fall of the variance at saturation; real points scatter by a per cent or two.
_FALL = 0.1

# Light that wanders: passes of the weighted fit; neighbours that are compared, the excess over the model that chance
# does not make of five, and how well they know it; relative wander that follows no normal law, and its factor.
_WANDER_PASSES, _NEIGHBOURS = 4, 5
_EXCESS, _FEW = 4.0, 2.5
_WILD, _WILDER = 0.03, 6.0

# Relative difference of exposures that count as equal.
_EXPOSURE_TOLERANCE = 1e-3
# Exposures from which on a bend of the dark mean is looked for, the chance that there is none where one is found, and
# the largest degree.
_BEND_EXPOSURES, _FALSE_BEND, _LARGEST_DEGREE = 6, 1e-4, 4

# Upper end of the photon-transfer fit, as a share of saturation. The standard's is 0.7, for a fit without a bend.
RANGE_OF_SATURATION = 0.8
# Factor by which a response may bend more between the range of the fit and saturation than below.
_NEAR_SATURATION, _BEND_BEYOND = 0.95, (0.01, 0.015)
# Least excess of a level's variance over signal above both neighbours, relative and in errors.
_SPIKE, _SPIKE_SIGMA = 1.1, 6.0
# Levels compared at the bright end, and how far full pixels lower a mean, in its noise.
_END_LEVELS, _CUT_OFF = 4, 0.3
# From this many levels on a bend is fitted; below it would take all the freedom there is. From the second number on a
# cubic term is fitted too where the response of the sensor is not known.
BEND_LEVELS, _CUBIC_LEVELS = 5, 8
_TRANSFER_PASSES = 3

# Least levels for a response: its cubic with an offset has four terms; three more levels show the scatter about it.
LINEARITY_LEVELS, _RESPONSE_TERMS = 7, 4
# Relative spread of photons per exposure within one lamp setting; exposures are then more accurate than photons.
_ONE_LAMP = 0.02
_ROOT_STEPS, _STEP_OF_ERROR, _NEWTON_STEPS = 5, 1e-3, 6

# Least dark current for a doubling interval, in standard errors.
_RESOLVED_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkSignal:
    """Dark signal against exposure."""

    mean_fit: ScatterFit  #: black level [DN], growth [DN/s] and, where known, higher powers
    variance_fit: ScatterFit | None  #: likewise of the temporal variance [DN^2]; None where rounding hides it
    has_slope: bool  #: the mean is a straight line of known exposures
    is_curved: bool  #: the mean is a polynomial of higher degree because the dark current changed
    means_dn: FloatArray  #: (n,): of each dark level; temporal variance with its errors
    variances_dn2: FloatArray
    variance_covariance_dn4: FloatArray  #: (n, n)
    quantisation_limited: bool  #: rounding hides the noise of dark frames
    shared_error_dn: float  #: error common to all means, from rounding or from a stated black level

    def mean_at(self, exposure_s: FloatArray) -> FloatArray:
        """Return the fitted mean at an exposure [DN]."""
        return np.asarray(np.polynomial.polynomial.polyval(exposure_s, self.mean_fit.parameters), dtype=np.float64)

    def variance_at(self, exposure_s: FloatArray) -> FloatArray | None:
        """Return the fitted temporal variance at an exposure [DN^2], None where there is no fit."""
        if self.variance_fit is None:
            return None
        along = self.mean_at(exposure_s) - self.mean_fit.parameters[0] if self.is_curved else exposure_s
        return np.asarray(np.polynomial.polynomial.polyval(along, self.variance_fit.parameters), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class LightStability:
    """Scatter of frame means beyond the noise of their pixels."""

    relative: float
    constant_dn: float


@dataclass(frozen=True, kw_only=True)
class SaturationLevel:
    """The signal of largest variance, between two levels of a sweep."""

    signal_dn: float
    std_error_dn: float
    lower: int  #: the level of largest variance, and the first with a variance a tenth smaller
    upper: int


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearityCurve:
    """The response `signal = x (1 + quadratic x + cubic x^2)`, x [DN] proportional to the light."""

    light: LightKind
    quadratic_per_dn: float
    cubic_per_dn2: float
    covariance: FloatArray  #: (2, 2): of both
    relative_scatter: float  #: of the means about the curve
    dn_per_photon: float | None  #: slope where the light is 0; None where photons are not stated
    dn_per_photon_std_error: float

    @property
    def variance_cubic_per_dn2(self) -> float:
        """Relative term in signal^2 of the photon-transfer curve due to the response [DN^-2].

        The response multiplies photon noise by its slope: variance = gain x (d signal / d x)^2, which is
        gain signal (1 + 3 quadratic signal + (5 cubic - 2 quadratic^2) signal^2 + ...).
        """
        return 5.0 * self.cubic_per_dn2 - 2.0 * self.quadratic_per_dn**2

    @property
    def variance_cubic_error_per_dn2(self) -> float:
        """Standard error of `variance_cubic_per_dn2` [DN^-2].

        A lamp that drifts evenly makes a quadratic term b and a cubic one of 2 b^2 but no term of the
        photon-transfer curve, 8 b^2 less than computed. The data do not tell whether b is the sensor's or the lamp's.
        """
        gradient = np.array([-4.0 * self.quadratic_per_dn, 5.0])
        of_the_lamp = 8.0 * self.quadratic_per_dn**2 / np.sqrt(3.0)
        return float(np.hypot(np.sqrt(gradient @ self.covariance @ gradient), of_the_lamp))

    def departure(self, x_dn: float) -> float:
        """Return the relative departure of the response from its slope at zero light."""
        return (self.quadratic_per_dn + self.cubic_per_dn2 * x_dn) * x_dn

    def slope(self, x_dn: float) -> float:
        """Return the slope of the response."""
        return 1.0 + (2.0 * self.quadratic_per_dn + 3.0 * self.cubic_per_dn2 * x_dn) * x_dn


@dataclass(frozen=True, kw_only=True, eq=False)
class TransferPoints:
    """The points of a photon-transfer curve, by ascending signal."""

    signal_dn: FloatArray  #: mean above dark
    variance_dn2: FloatArray  #: temporal variance above dark
    flat_variance_dn2: FloatArray  #: temporal variance of the flats, and its sampling error
    flat_std_error_dn2: FloatArray
    dark_covariance_dn4: FloatArray  #: (n, n): of the subtracted dark variances
    black_error_dn: float  #: error common to all signals
    saturated: Mask

    @property
    def std_error_dn2(self) -> FloatArray:
        """Sampling error of `variance_dn2` [DN^2]."""
        error: FloatArray = np.sqrt(np.square(self.flat_std_error_dn2) + np.diag(self.dark_covariance_dn4))
        return error


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotonTransfer:
    """A photon-transfer curve and the fit through it: variance = gain * signal + bend * signal^2 + cubic * signal^3."""

    points: TransferPoints  #: all points
    used: Mask  #: (n,): those that the fit uses
    #: gain [DN/e-], and bend and cubic term where they were fitted, from the used points' variances; the scatter is
    #: that of the gain [DN/e-]
    fit: ScatterFit
    #: the sensor's response if the light of the levels is known; it then gives the cubic term
    linearity: LinearityCurve | None
    saturation: SaturationLevel | None  #: where the variance is largest; None where it never falls
    #: part of the gain's relative error: a change of gain with level looks like a change of the lamp
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
        """Derivative of the gain with respect to the variance of each used point [1/(e- DN)]."""
        return self.fit.response[0, : int(np.count_nonzero(self.used))]

    @property
    def gain_shifts(self) -> FloatArray:
        """Change of the gain without each used point, at equal weights of the others [DN/e-]."""
        signal, n = self.points.signal_dn[self.used], int(np.count_nonzero(self.used))
        design = signal[:, None] ** np.arange(1, len(self.fit.parameters) + 1)
        leverage = np.einsum("ij,ji->i", design, self.fit.response[:, :n])
        residual = self.points.variance_dn2[self.used] - design @ self.fit.parameters
        shifts: FloatArray = -self.gain_response * residual / np.maximum(1.0 - leverage, np.finfo(float).eps)
        return shifts

    @property
    def gain_by_black(self) -> float:
        """Derivative of the gain by the black level [1/e-]."""
        return float(self.gain_response.sum()) * self.gain_dn_per_e

    @property
    def gain_variance_beyond_sampling(self) -> float:
        """Variance of the gain from scatter, change of the gain, response, and the common error of all signals."""
        scattered = self.gain_response * self.points.signal_dn[self.used]
        of_change = self.relative_gain_error_of_change * self.gain_dn_per_e
        of_response = 0.0
        if self.linearity is not None and len(self.fit.parameters) > 2:
            by_cubic = abs(float(self.fit.response[0, -1]))
            of_response = by_cubic * self.gain_dn_per_e * self.linearity.variance_cubic_error_per_dn2
        of_black = abs(self.gain_by_black) * self.points.black_error_dn
        return float(scattered @ scattered) * self.fit.scatter**2 + of_change**2 + of_response**2 + of_black**2

    @property
    def top_dn(self) -> float:
        """Signal of the brightest point of the fit [DN]."""
        return float(self.points.signal_dn[self.used].max())

    def variance_at(self, signal_dn: FloatArray) -> FloatArray:
        """Return the fitted temporal variance above that of the dark [DN^2]."""
        variance: FloatArray = signal_dn * (self.gain_dn_per_e + signal_dn * (self.bend + signal_dn * self.cubic))
        return variance


@dataclass(frozen=True, kw_only=True)
class DoublingTemperature:
    """The doubling interval of a dark current."""

    value_k: float  #: rise of temperature that doubles the dark current [K]
    std_error_k: float
    n_temperatures: int  #: temperatures it was made from
    chi2_per_dof: float | None  #: how the points fit an exponential; None with two of them


# Ceiling of the samples, and saturation


def sample_ceiling_dn(levels: Sequence[LevelStatistics], *, bit_depth: int) -> int:
    """Return the counts of a saturated pixel [DN].

    Full scale, unless no sample reaches it and flats end at a smaller value: one flat with half of its samples there,
    or two with 0.1 % each. This happens in cameras that subtract the black level after the converter.
    """
    full_scale_dn = (1 << bit_depth) - 1
    largest = max(level.samples.max_dn for level in levels)
    at_largest = [
        level.samples.max_fraction for level in levels if level.kind == "flat" and is_saturated(level, largest)
    ]
    if not at_largest or (max(at_largest) < _PILED_FRACTION and len(at_largest) < _ALIKE_LEVELS):
        return full_scale_dn
    return min(largest, full_scale_dn)


def is_saturated(level: LevelStatistics, ceiling_dn: int) -> bool:
    """Return whether more than 0.1 % of a level's samples are at the ceiling [DN]."""
    return level.samples.max_dn >= ceiling_dn and level.samples.max_fraction > SATURATED_FRACTION


def saturation_level(*, signal_dn: FloatArray, variance_dn2: FloatArray) -> SaturationLevel | None:
    """Return the signal of largest temporal variance, None unless the variance rises and falls.

    The variance rises with the signal and then falls within a few of its own square roots, often between two levels
    of the sweep. The peak lies below the first level whose variance is a tenth less than the largest, and not below
    the signal at which a proportional rise from the level before reaches the largest variance. The result is the
    middle of this interval, with its error.

    EMVA Standard 1288, Release 4.0 Linear, section 6.7, which takes the sampled level itself.
    """
    peak = int(np.argmax(variance_dn2))
    fallen = np.flatnonzero(variance_dn2[peak:] < (1.0 - _FALL) * variance_dn2[peak])
    if peak == 0 or fallen.size == 0:
        return None
    upper = peak + int(fallen[0])
    low = float(signal_dn[peak])
    if variance_dn2[peak - 1] > 0.0:
        low = min(low, float(variance_dn2[peak] * signal_dn[peak - 1] / variance_dn2[peak - 1]))
    high = float(signal_dn[upper])
    return SaturationLevel(
        signal_dn=0.5 * (low + high), std_error_dn=(high - low) / np.sqrt(12.0), lower=peak, upper=upper
    )


# Instability of the light from frame to frame, from repeats within levels


def light_stability(flats: Sequence[LevelStatistics], signal_dn: FloatArray) -> LightStability:
    """Return the scatter of frame means within levels.

    Least squares of the variances of frame means, less the noise of pixels, on 1 and signal^2, weighted by
    their own sampling errors; a part below 0 counts as 0.
    """
    freedom, between, noise = _frame_scatter(flats)
    design = np.column_stack([np.ones(len(flats)), np.square(signal_dn)])
    parts = np.zeros(2)
    for _ in range(_WANDER_PASSES):
        weight = np.sqrt(freedom) / np.maximum(noise + design @ parts, _TINY)
        parts = _not_below_zero(design * weight[:, None], (between - noise) * weight)
    return LightStability(relative=float(np.sqrt(parts[1])), constant_dn=float(np.sqrt(parts[0])))


def wander_variance_dn2(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, stability: LightStability
) -> FloatArray:
    """Return the variance of a frame's mean due to unsteady light, for each level [DN^2].

    From the two parts of the stability, or from the scatter of five neighbouring levels if that is larger: the beat of
    a lamp with the exposure follows neither part.
    """
    freedom, between, noise = _frame_scatter(flats)
    model = stability.constant_dn**2 + np.square(stability.relative * signal_dn)
    window = np.ones(min(_NEIGHBOURS, len(flats)))
    measured, expected = (np.convolve(one * freedom, window, "same") for one in (between - noise, model + noise))
    # Scatter grows with brightness, so neighbours are compared with their expectation.
    excess = measured / np.maximum(expected, _TINY)
    local = np.where(excess > _EXCESS, _FEW * excess * (model + noise), model)
    # Such unsteady light follows no normal law.
    wild = local > np.square(_WILD * signal_dn)
    variance: FloatArray = np.where(wild, _WILDER * local, local)
    return variance


def _frame_scatter(levels: Sequence[LevelStatistics]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return degrees of freedom and variance of the means of each level's frames, and the part that pixels make."""
    between = np.array([np.var(level.frame_means_dn, ddof=1) for level in levels])
    noise = column(levels, "temporal_variance_dn2") / column(levels, "n_pixels")
    return column(levels, "n_frames") - 1.0, between, noise


def _not_below_zero(design: FloatArray, values: FloatArray) -> FloatArray:
    both: FloatArray = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    if both.min() >= 0.0:
        return both
    squares = np.sum(np.square(design), axis=0)
    alone = np.maximum(design.T @ values, 0.0) / np.maximum(squares, _TINY)
    better = int(np.argmax(alone**2 * squares))
    parts: FloatArray = np.where(np.arange(2) == better, alone, 0.0)
    return parts


# Dark signal


def fit_dark_signal(darks: Sequence[LevelStatistics]) -> DarkSignal:
    """Return the straight lines through mean and variance of dark levels.

    With one exposure, or unknown ones, the lines have no slope, and the dark current of that exposure counts as black
    level and read noise.

    EMVA Standard 1288, Release 4.0 Linear, sections 6.5 and 7.1.
    """
    exposures, means = column(darks, "exposure_s"), column(darks, "mean_dn")
    variances, ones = column(darks, "temporal_variance_dn2"), np.ones(len(darks))
    has_slope = not np.isnan(exposures).any() and len(np.unique(exposures)) > 1
    design = np.column_stack([ones, exposures]) if has_slope else ones[:, None]
    sampling = mean_sampling_variance(darks)
    mean_fit = fit_with_scatter(design, means, sampling_covariance=np.diag(sampling), scatter_shape=ones)
    limited = bool(np.median(variances) < QUANTISATION_LIMIT_DN2)
    bent = None if limited or not has_slope else _bent_fit(mean_fit, exposures, means, sampling)
    if bent is not None:
        # Dark electrons add equally to mean and variance, even if the dark current changes.
        mean_fit = bent
        along = np.polynomial.polynomial.polyval(exposures, bent.parameters) - bent.parameters[0]
        design = np.column_stack([ones, along])
    # Rounding that noise hardly dithers moves all means alike: that at no exposure by one error, the slope by two of
    # them over the range of exposures.
    rounding_dn2 = ROUNDING_VAR_DN2 if limited else float(np.max(_mean_rounding_variance(darks)))
    by_rounding = np.zeros_like(mean_fit.covariance)
    by_rounding[0, 0] = rounding_dn2
    if has_slope:
        by_rounding[1, 1] = 2.0 * rounding_dn2 / float(np.ptp(exposures)) ** 2
    mean_fit = replace(mean_fit, covariance=mean_fit.covariance + by_rounding)
    variance_fit, covariance = None, np.full((len(darks), len(darks)), _UNRESOLVED_VARIANCE_ERROR_DN2**2)
    if not limited:
        shared_dn4 = _shared_variance_error_dn2(darks) ** 2
        variance_fit = _fit_variance(darks, design, variances, shared_dn4)
        own = _smoothed_variance_error(darks, design @ variance_fit.parameters) + variance_fit.scatter**2
        covariance = np.diag(own) + shared_dn4
    return DarkSignal(
        mean_fit=mean_fit,
        variance_fit=variance_fit,
        has_slope=has_slope and bent is None,
        is_curved=bent is not None,
        means_dn=means,
        variances_dn2=variances if variance_fit else np.full(len(darks), _UNRESOLVED_VARIANCE_DN2),
        variance_covariance_dn4=covariance,
        quantisation_limited=limited,
        shared_error_dn=float(np.sqrt(ROUNDING_VAR_DN2)) if limited else 0.0,
    )


def stated_dark_signal(black_level_dn: Estimate, flats: Sequence[LevelStatistics]) -> DarkSignal:
    """Return the dark signal of flats without dark frames, from a stated black level.

    The dark variance lies between 0 and the variance of the faintest flat. All flats share its error, so the
    photon-transfer curve gets an intercept. Dark current counts as light in both mean and variance.
    """
    half_dn2 = 0.5 * min(flat.temporal_variance_dn2 for flat in flats)
    mean = np.array([black_level_dn.value])
    return DarkSignal(
        mean_fit=ScatterFit(
            parameters=mean,
            covariance=np.array([[black_level_dn.std_error**2]]),
            response=np.zeros((1, 0)),
            scatter=0.0,
            chi2_per_dof=None,
        ),
        variance_fit=None,
        has_slope=False,
        is_curved=False,
        means_dn=mean,
        variances_dn2=np.array([half_dn2]),
        variance_covariance_dn4=np.array([[half_dn2**2]]),
        quantisation_limited=False,
        shared_error_dn=black_level_dn.std_error,
    )


def mean_sampling_variance(darks: Sequence[LevelStatistics]) -> FloatArray:
    """Return the variance of each level's mean: noise of pixels, scatter of frames, and rounding.

    If dark current dithers the rounding of long exposures only, the means of short ones are biased.
    """
    freedom, between, noise = _frame_scatter(darks)
    wander = max(0.0, float(freedom @ (between - noise) / freedom.sum()))
    floor = ROUNDING_VAR_DN2 / column(darks, "n_pixels")
    variance: FloatArray = (np.maximum(noise, floor) + wander) / (freedom + 1) + _mean_rounding_variance(darks)
    return variance


def match_darks(flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics]) -> FloatArray:
    """Return the weights (flats, darks) of dark levels in the dark part of each flat.

    Darks of the same exposure, or interpolated between neighbours; the nearest outside the range of dark exposures; all
    if an exposure is unknown; without darks, the one stated level.
    """
    if not darks:
        return np.ones((len(flats), 1))
    frames, times, of_flats = column(darks, "n_frames"), column(darks, "exposure_s"), column(flats, "exposure_s")
    if np.isnan(times).any() or np.isnan(of_flats).any():
        return np.tile(frames / frames.sum(), (len(flats), 1))
    distinct = np.unique(times)
    shares = np.where(times == distinct[:, None], frames, 0.0)
    shares /= shares.sum(axis=1, keepdims=True)
    mix = np.column_stack([np.interp(of_flats, distinct, corner) for corner in np.eye(len(distinct))])
    weights: FloatArray = mix @ shares
    return weights


def beyond_darks(flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics]) -> Mask:
    """Return which flats lie outside the exposures of the darks; without darks, none."""
    if not darks:
        return np.zeros(len(flats), dtype=bool)
    times, of_flats = column(darks, "exposure_s"), column(flats, "exposure_s")
    if np.isnan(times).any() or np.isnan(of_flats).any():
        return np.ones(len(flats), dtype=bool)
    first, last = times.min() * (1.0 - _EXPOSURE_TOLERANCE), times.max() * (1.0 + _EXPOSURE_TOLERANCE)
    beyond: Mask = (of_flats < first) | (of_flats > last)
    return beyond


def _bent_fit(line: ScatterFit, exposures: FloatArray, means: FloatArray, sampling: FloatArray) -> ScatterFit | None:
    """Return the polynomial of lowest degree whose next term is not significant, None if a line is enough.

    Its error includes one more term, since the course of the dark current is unknown.
    """
    before = chosen = following = line
    largest = min(_LARGEST_DEGREE, len(np.unique(exposures)) - _BEND_EXPOSURES + 2)
    for degree in range(2, largest + 1):
        following = _polynomial(exposures, degree, means, sampling)
        last = following.parameters[-1] / np.sqrt(following.covariance[-1, -1])
        if abs(last) < -stdtrit(len(means) - degree - 1, 0.5 * _FALSE_BEND):
            break
        before, chosen = chosen, following
    else:
        following = before
    if chosen is line:
        return None
    covariance = chosen.covariance.copy()
    covariance[0, 0] += (following.parameters[0] - chosen.parameters[0]) ** 2
    return replace(chosen, covariance=covariance)


def _polynomial(exposures: FloatArray, degree: int, means: FloatArray, sampling: FloatArray) -> ScatterFit:
    scale = float(exposures.max())
    fit = fit_with_scatter(
        (exposures[:, None] / scale) ** np.arange(degree + 1),
        means,
        sampling_covariance=np.diag(sampling),
        scatter_shape=np.ones(len(means)),
    )
    units = scale ** -np.arange(degree + 1.0)
    return replace(
        fit,
        parameters=fit.parameters * units,
        covariance=fit.covariance * np.outer(units, units),
        response=fit.response * units[:, None],
    )


def _mean_rounding_variance(darks: Sequence[LevelStatistics]) -> FloatArray:
    temporal, spatial = column(darks, "temporal_variance_dn2"), pattern_variances(darks)
    return np.square(rounding_error_rms(np.sqrt(least_variance(temporal, spatial) + spatial)))


def _fit_variance(
    darks: Sequence[LevelStatistics], design: FloatArray, variances: FloatArray, shared_dn4: float
) -> ScatterFit:
    model = variances
    for _ in range(2):
        fit = fit_with_scatter(
            design,
            variances,
            sampling_covariance=np.diag(_smoothed_variance_error(darks, model)),
            scatter_shape=np.ones(len(darks)),
        )
        model = design @ fit.parameters
    shared = np.zeros_like(fit.covariance)
    shared[0, 0] = shared_dn4
    return replace(fit, covariance=fit.covariance + shared)


def _shared_variance_error_dn2(darks: Sequence[LevelStatistics]) -> float:
    """Return the common error of all dark variances: noise clipped at 0, and undithered rounding.

    Clipping a normal law z standard deviations below its mean, with probability p beyond, lowers its variance by the
    share z phi(z) + p - z^2 p.
    """
    variance = float(np.median(column(darks, "temporal_variance_dn2")))
    spatial = np.array(np.median(pattern_variances(darks)))
    zeros = max(dark.samples.zero_fraction for dark in darks)
    cut = 0.0
    if zeros > 0.0:
        z = -float(ndtri(zeros))
        cut = z * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + zeros - z**2 * zeros
    rounding = float(variance_error_rms(least_variance(np.array(variance), spatial), spatial))
    return float(np.hypot(cut * variance, rounding))


def _smoothed_variance_error(darks: Sequence[LevelStatistics], model_dn2: FloatArray) -> FloatArray:
    """Return the sampling variance of each temporal variance, relative as measured, absolute by the model.

    Errors from measured variances would bias the fit low, because a variance low by chance states a small error.
    """
    relative = column(darks, "temporal_std_error_dn2") / column(darks, "temporal_variance_dn2")
    smoothed: FloatArray = np.square(relative * model_dn2)
    return smoothed


# Response: mean against light


def fit_linearity(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, *, noise_dn2: FloatArray
) -> LinearityCurve | None:
    """Return the response of a sensor, None where the light of the levels is not known or takes too few values.

    The fit is a cubic in the light with an offset, since exposures often differ from the stated ones by a fixed time.
    Offset and slope locate zero light, and the cubic is written about that point. Scatter of the lamp is estimated from
    the levels, in proportion to the signal; an unsteady lamp only makes the errors of the curve larger.
    """
    photons = column(flats, "photons")
    light, kind = _light(column(flats, "exposure_s"), photons)
    if light is None:
        return None
    unit = light.max()
    design = (light / unit)[:, None] ** np.arange(_RESPONSE_TERMS)
    fit = fit_with_scatter(design, signal_dn, sampling_covariance=np.diag(noise_dn2), scatter_shape=signal_dn)
    terms = _terms_about_root(fit.parameters)
    steps = _STEP_OF_ERROR * np.diag(np.sqrt(np.diag(fit.covariance)))
    shifted = [[_terms_about_root(fit.parameters + sign * step) for sign in (1.0, -1.0)] for step in steps]
    slopes = [
        (up - down) / (2.0 * step.max())
        for (up, down), step in zip(shifted, steps, strict=True)
        if up is not None and down is not None
    ]
    if terms is None or len(slopes) < _RESPONSE_TERMS:
        return None
    gradient = np.array(slopes).T
    errors = gradient @ fit.covariance @ gradient.T
    total_photons = float(photons.sum())
    light_per_photon = float(light.sum() / total_photons) if total_photons > 0.0 else None
    return LinearityCurve(
        light=kind,
        quadratic_per_dn=float(terms[0]),
        cubic_per_dn2=float(terms[1]),
        covariance=errors[:2, :2],
        relative_scatter=fit.scatter,
        dn_per_photon=float(terms[2]) / unit * light_per_photon if light_per_photon else None,
        dn_per_photon_std_error=float(np.sqrt(errors[2, 2])) / unit * (light_per_photon or 0.0),
    )


def _light(exposures: FloatArray, photons: FloatArray) -> tuple[FloatArray | None, LightKind]:
    """Return photons, or exposures if photons are unknown or proportional to them."""
    exposures_known = not np.isnan(exposures).any()
    is_one_lamp = False
    if exposures_known and exposures.min() > 0.0:
        ratio = photons / exposures
        is_one_lamp = bool(np.ptp(ratio) <= _ONE_LAMP * ratio.max())
    kind: LightKind = "exposure" if np.isnan(photons).any() or is_one_lamp else "photons"
    light = photons if kind == "photons" else exposures
    is_enough = not np.isnan(light).any() and light.min() >= 0.0 and len(np.unique(light)) >= LINEARITY_LEVELS
    return (light if is_enough else None), kind


def _terms_about_root(polynomial: FloatArray) -> FloatArray | None:
    """Return quadratic and cubic term of a polynomial about its root near 0, its slope there scaled to 1; and it."""
    powers = np.polynomial.Polynomial(polynomial)
    slope = powers.deriv()
    root = 0.0
    for _ in range(_ROOT_STEPS):
        if slope(root) <= 0.0:
            return None
        root -= powers(root) / slope(root)
    first = slope(root)
    if first <= 0.0:
        return None
    return np.array([0.5 * powers.deriv(2)(root) / first**2, powers.deriv(3)(root) / 6.0 / first**3, first])


# Photon transfer


def transfer_points(
    flats: Sequence[LevelStatistics], dark: DarkSignal, weights: FloatArray, *, ceiling_dn: int
) -> TransferPoints:
    """Return the points of the photon-transfer curve; `weights` are those of `match_darks`."""
    signal = column(flats, "mean_dn") - weights @ dark.means_dn
    total = column(flats, "temporal_variance_dn2") - _breakthrough_dn2(flats, signal)
    return TransferPoints(
        signal_dn=signal,
        variance_dn2=total - weights @ dark.variances_dn2,
        flat_variance_dn2=total,
        flat_std_error_dn2=column(flats, "temporal_std_error_dn2"),
        dark_covariance_dn4=weights @ dark.variance_covariance_dn4 @ weights.T,
        black_error_dn=dark.shared_error_dn,
        saturated=np.array([is_saturated(flat, ceiling_dn) for flat in flats]),
    )


def usable_points(
    points: TransferPoints, *, full_signal_dn: float, light: FloatArray | None = None
) -> tuple[Mask, SaturationLevel | None]:
    """Return which points the fit may use, and saturation; None if it is not reached.

    Usable are points up to 80 % of saturation with less than 0.1 % of their samples at the ceiling.
    """
    places = np.flatnonzero(~_spikes(points) & ~_proportional_end(points, light))
    saturation = saturation_level(signal_dn=points.signal_dn[places], variance_dn2=points.variance_dn2[places])
    if saturation is not None:
        lower, upper = int(places[saturation.lower]), int(places[saturation.upper])
        saturation = replace(saturation, lower=lower, upper=upper)
    top_dn = RANGE_OF_SATURATION * (saturation.signal_dn if saturation else full_signal_dn)
    used = (points.signal_dn > 0.0) & (points.signal_dn <= top_dn) & (points.flat_variance_dn2 > 0.0)
    used &= ~points.saturated
    if not used.any():
        raise refused(
            "no_usable_level",
            f"no flat level can be used: signals are {points.signal_dn.min():.4g} to {points.signal_dn.max():.4g} DN "
            f"above dark, {int(points.saturated.sum())} of {len(used)} levels are saturated; usable levels have "
            f"noise and lie between dark and {top_dn:.0f} DN: take flats at other exposures",
        )
    return used, saturation


def beyond_range(points: TransferPoints, *, saturation_dn: float) -> FloatArray:
    """Return the relative bend allowed in the mean of each unsaturated point too bright for the fit.

    It is 0 for all other points; 1 % of the mean up to 95 % of saturation, 1.5 % there.
    """
    share = points.signal_dn / saturation_dn
    beyond = ~points.saturated & (points.flat_variance_dn2 > 0.0) & (share > RANGE_OF_SATURATION) & (share < 1.0)
    bend: FloatArray = np.where(beyond, np.interp(share, [_NEAR_SATURATION, 1.0], _BEND_BEYOND), 0.0)
    return bend


def fit_photon_transfer(
    flats: Sequence[LevelStatistics],
    points: TransferPoints,
    *,
    used: Mask,
    saturation: SaturationLevel | None,
    mean_variance_dn2: FloatArray,
    wrong_light: Mask,
) -> PhotonTransfer:
    """Return gain and bend of a photon-transfer curve through the used points.

    There is no intercept: the dark is subtracted at the same exposure.

    Weights are the inverse sampling variances. On real sensors points scatter by more (a measured CCD: 1.1 % where
    sampling gives 0.3 %), and this does not average away within a level. A relative scatter is estimated from the
    points and added to all, so that a long stack does not decide the gain alone.

    Nonlinearity and spreading charge bend the curve by a few per cent towards the bright end, so the gain of a straight
    line depends on its range. The gain is the slope at zero signal. If the light of the levels is known, mean against
    light gives the response and the cubic term of the curve, with an error common to all points.
    From 5 levels on a quadratic term is always fitted: choosing it by significance would make the error bar wrong. It
    includes the response and spreading charge, and makes the gain independent of a lamp that drifts evenly during the
    sweep. Without a response, from 8 levels on, the cubic term is fitted too. The standard error of the gain is 1, 2, 3
    times that of the slope alone with one, two, three terms.

    EMVA Standard 1288, Release 4.0 Linear, section 6.6, which has no weights, no bend and no errors.
    """
    known = np.flatnonzero(used & ~wrong_light)
    linearity = None
    if known.size:
        chosen = [flats[place] for place in known.tolist()]
        linearity = fit_linearity(chosen, points.signal_dn[known], noise_dn2=mean_variance_dn2[known])
    fit = _fit_transfer(points, used, linearity)
    return PhotonTransfer(points=points, used=used, fit=fit, linearity=linearity, saturation=saturation)


def with_fitted_dark_variance(transfer: PhotonTransfer) -> PhotonTransfer:
    """Return a curve with the most likely dark variance subtracted, if only the fit gives it."""
    points, used = transfer.points, transfer.used
    shared = points.dark_covariance_dn4[np.ix_(used, used)]
    covariance = np.diag(np.square(points.flat_std_error_dn2[used])) + shared
    covariance += np.diag(np.square(transfer.fit.scatter * points.signal_dn[used]))
    residual = points.variance_dn2[used] - transfer.variance_at(points.signal_dn[used])
    excess_dn2 = float(shared[0] @ np.linalg.solve(covariance, residual))
    return replace(transfer, points=replace(points, variance_dn2=points.variance_dn2 - excess_dn2))


def brighter_fatter(transfer: PhotonTransfer) -> tuple[float, float] | None:
    """Return the relative change of the variance due to spreading charge at `top_dn`, and its error.

    The quadratic term of the curve less three times that of the response, over the gain; to first order, with both
    errors taken as independent. None without a response.

    Astier et al., A&A 629, A36 (2019), doi:10.1051/0004-6361/201935508: variance = gain signal (1 + a signal).
    """
    curve = transfer.linearity
    if curve is None or len(transfer.fit.parameters) < 2:
        return None
    top_dn, gain = transfer.top_dn, transfer.gain_dn_per_e
    own, response = np.sqrt(transfer.fit.covariance[1, 1]) / gain, 3.0 * np.sqrt(curve.covariance[0, 0])
    return (transfer.bend / gain - 3.0 * curve.quadratic_per_dn) * top_dn, float(np.hypot(own, response)) * top_dn


def response_slope(transfer: PhotonTransfer, signal_dn: float) -> tuple[float, float]:
    """Return (d signal / d light) / (signal / light) at a signal, and its error.

    This factor multiplies the contrast between pixels. The slope is from mean against light or from the
    photon-transfer curve, whichever is more certain. An evenly drifting lamp bends the first, spreading charge the
    second; the error of the first includes their disagreement. If the light is unknown it is from the curve; with too
    few levels for a bend, 1 without an error.

    For signal = x (1 + b x + c x^2): the curve has the relative terms 3 b and 5 c - 2 b^2 (`LinearityCurve`).
    """
    by_noise = _slope_by_noise(transfer, signal_dn)
    curve = transfer.linearity
    if curve is None:
        return by_noise
    x = signal_dn
    for _ in range(_NEWTON_STEPS):
        x -= (x * (1.0 + curve.departure(x)) - signal_dn) / curve.slope(x)
    gradient = np.array([signal_dn, 2.0 * signal_dn**2])
    variance = float(gradient @ curve.covariance @ gradient)
    spreading = brighter_fatter(transfer)
    if spreading is not None:
        variance += (spreading[0] * signal_dn / transfer.top_dn / 3.0) ** 2
    by_light = curve.slope(x) * x / signal_dn, float(np.sqrt(variance))
    return min(by_light, by_noise, key=lambda slope: slope[1]) if by_noise[1] else by_light


def _slope_by_noise(transfer: PhotonTransfer, signal_dn: float) -> tuple[float, float]:
    n_terms = len(transfer.fit.parameters)
    if n_terms == 1:
        return 1.0, 0.0
    quadratic = transfer.bend / transfer.gain_dn_per_e / 3.0
    cubic = (transfer.cubic / transfer.gain_dn_per_e + 2.0 * quadratic**2) / 5.0 if n_terms > 2 else 0.0
    gradient = np.array([signal_dn / 3.0, 2.0 * signal_dn**2 / 5.0])[: n_terms - 1] / transfer.gain_dn_per_e
    variance = float(gradient @ transfer.fit.covariance[1:, 1:] @ gradient)
    return 1.0 + (quadratic + 2.0 * cubic * signal_dn) * signal_dn, float(np.sqrt(variance))


def _breakthrough_dn2(flats: Sequence[LevelStatistics], signal_dn: FloatArray) -> FloatArray:
    """Return the variance that the fixed pattern adds to differences of frames with unequal light [DN^2].

    A change of the light shows the response of each pixel.
    """
    step_dn2 = np.array([0.5 * np.mean(np.square(np.diff(flat.frame_means_dn))) for flat in flats])
    temporal_dn2 = column(flats, "temporal_variance_dn2")
    bright = signal_dn >= 0.5 * signal_dn.max()
    relative = column(flats, "spatial_variance_dn2")[bright] / np.square(signal_dn[bright])
    pattern = max(float(np.median(relative)), 0.0) if bright.any() else 0.0
    breakthrough: FloatArray = pattern * np.maximum(step_dn2 - temporal_dn2 / column(flats, "n_pixels"), 0.0)
    return np.minimum(breakthrough, 0.5 * temporal_dn2)


def _proportional_end(points: TransferPoints, light: FloatArray | None) -> Mask:
    """Return the brightest point alone if its mean is as proportional to the light as that of its neighbours.

    Pixels that are full lower the mean by as much as the noise, some 0.4 standard deviations.
    """
    end = np.zeros(len(points.signal_dn), dtype=bool)
    if light is None or len(end) < _END_LEVELS or points.saturated[-1] or light[-_END_LEVELS:].min() <= 0.0:
        return end
    rate = points.signal_dn[-_END_LEVELS:] / light[-_END_LEVELS:]
    off = abs(float(rate[-1] / np.median(rate[:-1])) - 1.0)
    noise = float(np.sqrt(max(points.variance_dn2[-_END_LEVELS:-1].max(), 0.0)) / points.signal_dn[-1])
    end[-1] = off < _CUT_OFF * noise and points.variance_dn2[-1] < points.variance_dn2[:-1].max()
    return end


def _spikes(points: TransferPoints) -> Mask:
    """Return points with more variance for their signal than both neighbours, which saturation does not cause."""
    signal = np.maximum(points.signal_dn, _TINY)
    ratio, error = points.variance_dn2 / signal, points.std_error_dn2 / signal
    padded = np.concatenate([[ratio[0]], ratio, [ratio[-1]]])
    neighbours = np.maximum(padded[:-2], padded[2:])
    spike: Mask = (ratio > _SPIKE * neighbours) & (ratio > neighbours + _SPIKE_SIGMA * error)
    spike[[0, -1]] = False
    return spike


def _fit_transfer(points: TransferPoints, used: Mask, linearity: LinearityCurve | None) -> ScatterFit:
    signal, variance, total = points.signal_dn[used], points.variance_dn2[used], points.flat_variance_dn2[used]
    n_terms = 1 if len(signal) < BEND_LEVELS else 2 if linearity is None and len(signal) < _CUBIC_LEVELS else 3
    design = signal[:, None] ** np.arange(1, n_terms + 1)
    relative_error = points.flat_std_error_dn2[used] / total
    model, gain = total, float(np.median(variance / signal))
    for _ in range(_TRANSFER_PASSES):
        # Errors from the model's variance, because a point low by chance would claim a small error.
        covariance = np.diag(np.square(relative_error * model)) + points.dark_covariance_dn4[np.ix_(used, used)]
        fit = _fit_terms(design, variance, covariance, linearity if n_terms == 3 else None, gain)
        refined = total - variance + design @ fit.parameters
        if refined.min() <= 0.0 or fit.parameters[0] <= 0.0:
            break
        model, gain = refined, float(fit.parameters[0])
    return fit


def _fit_terms(
    design: FloatArray, variance: FloatArray, covariance: FloatArray, linearity: LinearityCurve | None, gain: float
) -> ScatterFit:
    """Return the fit; the cubic term of the response is one more value, in the last place."""
    signal = design[:, 0]
    if linearity is None:
        return fit_with_scatter(design, variance, sampling_covariance=covariance, scatter_shape=signal)
    size = len(signal)
    larger = np.zeros((size + 1, size + 1))
    larger[:size, :size] = covariance
    larger[size, size] = (gain * linearity.variance_cubic_error_per_dn2) ** 2
    return fit_with_scatter(
        np.vstack([design, [-linearity.variance_cubic_per_dn2, 0.0, 1.0]]),
        np.append(variance, 0.0),
        sampling_covariance=larger,
        scatter_shape=np.append(signal, 0.0),
    )


# The rise of temperature that doubles the dark current


def doubling_temperature(
    temperature_c: FloatArray, dark_current: FloatArray, std_error: FloatArray
) -> DoublingTemperature:
    """Return the doubling interval of a dark current.

    Parameters
    ----------
    temperature_c : (n,) array
        Of the sensor, or of its housing in a steady state [degrees Celsius].
    dark_current, std_error : (n,) arrays
        At these temperatures, and their standard errors, in one unit.

    Raises
    ------
    CalibrationError
        Fewer than two temperatures, a current that is not three standard errors above 0, or one that does not grow.

    Notes
    -----
    A straight line through the logarithm, weighted by the relative errors; extra scatter widens the error.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, doubling temperature.
    """
    n_different = len(np.unique(temperature_c))
    if n_different < 2:
        raise CalibrationError(
            f"there are {n_different} different temperatures; a doubling interval needs at least two, better six"
        )
    for temperature, current, error in zip(temperature_c, dark_current, std_error, strict=True):
        if current <= _RESOLVED_SIGMA * error:
            raise CalibrationError(
                f"at {temperature:g} C the dark current is {number_with_error(current, error)}, not more than "
                f"{_RESOLVED_SIGMA:g} standard errors above 0: take longer dark exposures, or leave it out"
            )
    centred = temperature_c - temperature_c.mean()
    fit = fit_with_scatter(
        np.column_stack([np.ones(len(centred)), centred]),
        np.log(dark_current),
        sampling_covariance=np.diag(np.square(std_error / dark_current)),
        scatter_shape=np.ones(len(centred)),
    )
    slope, error = float(fit.parameters[1]), float(np.sqrt(fit.covariance[1, 1]))
    if slope <= _RESOLVED_SIGMA * error:
        raise CalibrationError(
            f"the dark current does not grow with temperature: its logarithm by "
            f"{number_with_error(slope, error)} per K; "
            f"take temperatures further apart"
        )
    value = float(np.log(2.0)) / slope
    return DoublingTemperature(
        value_k=value,
        std_error_k=value * error / slope,
        n_temperatures=len(temperature_c),
        chi2_per_dof=fit.chi2_per_dof,
    )
