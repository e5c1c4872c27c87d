"""Curves of a sensor: dark signal, photon transfer, linearity, saturation and dark-current doubling."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from calibration.estimate import Estimate, number_with_error
from calibration.results import CalibrationError, Flag, refused
from calibration.sensor.fits import ScatterFit, fit_with_scatter
from calibration.sensor.levels import (
    LevelStatistics,
    least_noise_dn2,
    mean_rounding_error_dn,
    variance_rounding_error_dn2,
)

# The value at which samples end: full scale of their bits, or a smaller one at which they pile up

# A level with more of its samples at the ceiling is saturated.
SATURATED_FRACTION = 1e-3
# Noise alone puts a few samples of a level at its largest value, or a few per mille where rounding is coarse.
_PILED_FRACTION = 0.5
_ALIKE_LEVELS = 2


def sample_ceiling_dn(levels: Sequence[LevelStatistics], *, bit_depth: int) -> int:
    """Return the value at which a saturated pixel stands [DN].

    Full scale, unless no sample reaches it and flats end at a smaller value: one of them with half of its samples
    there, or two with 0.1 % each. A black level that is taken off after the converter does that, and some firmware.
    """
    full_scale_dn = (1 << bit_depth) - 1
    largest = max(level.samples.max_dn for level in levels)
    at_largest = [
        level.samples.max_fraction
        for level in levels
        if level.kind == "flat" and level.samples.max_dn == largest and level.samples.max_fraction > SATURATED_FRACTION
    ]
    if not at_largest or (max(at_largest) < _PILED_FRACTION and len(at_largest) < _ALIKE_LEVELS):
        return full_scale_dn
    return min(largest, full_scale_dn)


def is_saturated(level: LevelStatistics, *, ceiling_dn: int) -> bool:
    """Return whether more than 0.1 % of a level's samples stand at the ceiling [DN]."""
    return level.samples.max_dn >= ceiling_dn and level.samples.max_fraction > SATURATED_FRACTION


# Saturation of a sensor: the signal at which its temporal variance is largest

FloatArray = NDArray[np.float64]

# A fall of the variance by this much is saturation; real points scatter by a per cent or two.
_FALL = 0.1


@dataclass(frozen=True, kw_only=True)
class SaturationLevel:
    """The signal of largest variance, between two levels of a sweep."""

    signal_dn: float
    std_error_dn: float
    lower: int
    upper: int


def saturation_level(*, signal_dn: FloatArray, variance_dn2: FloatArray) -> SaturationLevel | None:
    """Return the signal at which the temporal variance is largest, None if the sweep does not show it rise and fall.

    The variance rises with the signal and then falls within a few of its own square roots; between two levels
    of a sweep its course is not known. What is known: the peak is below the first level
    whose variance is a tenth less than the largest that was seen (less than that may be scatter), and not below the
    signal at which the rise, in proportion from the level before, has that largest variance. The
    result is the middle of this interval, and its error is the interval's.

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


# Stability of the light from frame to frame, from the repeats within the levels


_PASSES = 4
_NEIGHBOURS = 5
# Neighbours show another wander where it is more than chance makes of five, and know it to a factor of their own.
_TWICE, _FEW = 4.0, 2.5
_WILD, _WILDER = 0.03, 6.0


@dataclass(frozen=True, kw_only=True)
class LightStability:
    """Wander of a frame's mean beyond the noise of its pixels."""

    relative: float
    constant_dn: float

    def variance_dn2(self, signal_dn: FloatArray) -> FloatArray:
        """Return the variance of a single frame's mean by wander [DN^2]."""
        variance: FloatArray = self.constant_dn**2 + np.square(self.relative * signal_dn)
        return variance


def light_stability(flats: Sequence[LevelStatistics], signal_dn: FloatArray) -> LightStability:
    """Return how much the means of frames wander that should be alike.

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


# Mean and variance of dark frames against exposure, and which dark belongs to which flat


# Variance of a rounding error, uniform over one count.
QUANTISATION_VAR_DN2 = 1.0 / 12.0
# Below this temporal variance rounding is not dithered, and the variance seen says little of the noise before it.
QUANTISATION_LIMIT_DN2 = 0.24
# A noise that is not resolved has a variance between that of rounding alone and the limit, evenly likely.
_UNRESOLVED_VARIANCE_DN2 = 0.5 * (QUANTISATION_VAR_DN2 + QUANTISATION_LIMIT_DN2)
_UNRESOLVED_VARIANCE_ERROR_DN2 = (QUANTISATION_LIMIT_DN2 - QUANTISATION_VAR_DN2) / np.sqrt(12.0)
_EXPOSURE_TOLERANCE = 1e-3
# Exposures from which on a bend of the mean is looked for, and the chance that there is none where one is found.
_BEND_EXPOSURES, _FALSE_BEND = 6, 1e-4
_MOST_TERMS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkSignal:
    """Dark signal against exposure."""

    mean_fit: ScatterFit
    variance_fit: ScatterFit | None
    has_slope: bool
    is_curved: bool
    means_dn: FloatArray
    variances_dn2: FloatArray
    variance_covariance_dn4: FloatArray
    quantisation_limited: bool
    shared_error_dn: float  #: error that all means share, by rounding or of a stated black level

    def mean_at(self, exposure_s: FloatArray) -> FloatArray:
        """Return the fitted mean at an exposure [DN]."""
        return np.asarray(np.polynomial.polynomial.polyval(exposure_s, self.mean_fit.parameters), dtype=np.float64)

    def variance_at(self, exposure_s: FloatArray) -> FloatArray | None:
        """Return the fitted temporal variance at an exposure [DN^2], None where there is no fit."""
        if self.variance_fit is None:
            return None
        along = self.mean_at(exposure_s) - self.mean_fit.parameters[0] if self.is_curved else exposure_s
        return np.asarray(np.polynomial.polynomial.polyval(along, self.variance_fit.parameters), dtype=np.float64)


def fit_dark_signal(darks: Sequence[LevelStatistics]) -> DarkSignal:
    """Return the straight lines through mean and variance of dark levels.

    With one exposure, or unknown ones, the lines have no slope, and what dark current does within that
    exposure counts as black level and read noise.

    EMVA Standard 1288, Release 4.0 Linear, sections 6.5 and 7.1.
    """
    exposures = [dark.exposure_s for dark in darks]
    known = [exposure for exposure in exposures if exposure is not None]
    has_slope = len(known) == len(exposures) and len(set(known)) > 1
    design = np.column_stack([np.ones(len(darks)), known]) if has_slope else np.ones((len(darks), 1))
    means = np.array([dark.mean_dn for dark in darks])
    mean_fit = fit_with_scatter(
        design, means, sampling_covariance=np.diag(mean_sampling_variance(darks)), scatter_shape=np.ones(len(darks))
    )
    variances = np.array([dark.temporal_variance_dn2 for dark in darks])
    limited = bool(np.median(variances) < QUANTISATION_LIMIT_DN2)
    bent = None if limited or not has_slope else _bent_fit(mean_fit, design, darks, means)
    if bent is not None:
        # However a dark current changes, its electrons add to the variance what they add to the mean.
        mean_fit = bent
        along = np.polynomial.polynomial.polyval(design[:, 1], bent.parameters) - bent.parameters[0]
        design = np.column_stack([design[:, 0], along])
    rounding_dn2 = QUANTISATION_VAR_DN2 if limited else float(np.max(_mean_rounding_variance(darks)))
    mean_fit = _with_rounding(mean_fit, rounding_dn2, exposure_range_s=float(np.ptp(known)) if has_slope else 0.0)
    variance_fit = None if limited else _fit_variance(darks, design, variances)
    return DarkSignal(
        mean_fit=mean_fit,
        variance_fit=variance_fit,
        has_slope=has_slope and bent is None,
        is_curved=bent is not None,
        means_dn=means,
        variances_dn2=variances if variance_fit else np.full(len(darks), _UNRESOLVED_VARIANCE_DN2),
        variance_covariance_dn4=(
            np.full((len(darks), len(darks)), _UNRESOLVED_VARIANCE_ERROR_DN2**2)
            if variance_fit is None
            else np.diag(_smoothed_variance_error(darks, design @ variance_fit.parameters) + variance_fit.scatter**2)
            + _shared_variance_error_dn2(darks) ** 2
        ),
        quantisation_limited=limited,
        shared_error_dn=float(np.sqrt(QUANTISATION_VAR_DN2)) if limited else 0.0,
    )


def stated_dark_signal(black_level_dn: Estimate, flats: Sequence[LevelStatistics]) -> DarkSignal:
    """Return the dark signal of flats without dark frames, whose black level is known from elsewhere.

    The dark variance is somewhere between 0 and the variance of the faintest flat. All flats share its error, which
    leaves the photon-transfer curve an intercept of its own. Dark current counts as light in mean and variance alike.
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


def _bent_fit(
    line: ScatterFit, design: FloatArray, darks: Sequence[LevelStatistics], means: FloatArray
) -> ScatterFit | None:
    """Return the polynomial of lowest degree through the means whose next term is not seen, None where a line will do.

    How a dark current changes is not known: one term more may be there, and moves the mean at no exposure.
    """
    exposures = design[:, 1]
    chosen, is_bent = line, False
    for degree in range(2, min(_MOST_TERMS, len(np.unique(exposures)) - _BEND_EXPOSURES + 2) + 1):
        fit = _polynomial(exposures, degree, darks, means)
        last = fit.parameters[-1] / np.sqrt(fit.covariance[-1, -1])
        if abs(last) < -stdtrit(len(darks) - degree - 1, 0.5 * _FALSE_BEND):
            break
        before, chosen, is_bent = chosen, fit, True
    else:
        fit = before if is_bent else chosen
    if not is_bent:
        return None
    covariance = chosen.covariance.copy()
    covariance[0, 0] += (fit.parameters[0] - chosen.parameters[0]) ** 2
    return replace(chosen, covariance=covariance)


def _polynomial(exposures: FloatArray, degree: int, darks: Sequence[LevelStatistics], means: FloatArray) -> ScatterFit:
    scale = float(exposures.max())
    fit = fit_with_scatter(
        (exposures[:, None] / scale) ** np.arange(degree + 1),
        means,
        sampling_covariance=np.diag(mean_sampling_variance(darks)),
        scatter_shape=np.ones(len(darks)),
    )
    units = scale ** -np.arange(degree + 1.0)
    return replace(
        fit,
        parameters=fit.parameters * units,
        covariance=fit.covariance * np.outer(units, units),
        response=fit.response * units[:, None],
    )


def _with_rounding(fit: ScatterFit, variance_dn2: float, *, exposure_range_s: float) -> ScatterFit:
    """Return the curve through means that noise hardly dithers, with what rounding may have done to all of them alike.

    The mean at no exposure is off by a rounding error, the slope by two of them over the range of exposures.
    """
    extra = np.zeros_like(fit.covariance)
    extra[0, 0] = variance_dn2
    if exposure_range_s > 0.0:
        extra[1, 1] = 2.0 * variance_dn2 / exposure_range_s**2
    return replace(fit, covariance=fit.covariance + extra)


def mean_sampling_variance(darks: Sequence[LevelStatistics]) -> FloatArray:
    """Return the variance of each level's mean: noise of its pixels, wander of whole frames, and rounding.

    Dark current may dither the rounding of long exposures alone: the mean of the short ones is then off.
    """
    noise = np.array([dark.temporal_variance_dn2 / dark.n_pixels for dark in darks])
    freedom = np.array([dark.n_frames - 1 for dark in darks])
    between = np.array([np.var(dark.frame_means_dn, ddof=1) for dark in darks])
    wander = max(0.0, float(freedom @ (between - noise) / freedom.sum()))
    floor = QUANTISATION_VAR_DN2 / np.array([dark.n_pixels for dark in darks])
    variance: FloatArray = (np.maximum(noise, floor) + wander) / (freedom + 1) + _mean_rounding_variance(darks)
    return variance


def _mean_rounding_variance(darks: Sequence[LevelStatistics]) -> FloatArray:
    temporal = np.array([dark.temporal_variance_dn2 for dark in darks])
    spatial = np.array([max(dark.ordinary.variance_dn2, 0.0) for dark in darks])
    return np.square(mean_rounding_error_dn(least_noise_dn2(temporal, spatial) + spatial))


def _fit_variance(darks: Sequence[LevelStatistics], design: FloatArray, variances: FloatArray) -> ScatterFit:
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
    shared[0, 0] = _shared_variance_error_dn2(darks) ** 2
    return replace(fit, covariance=fit.covariance + shared)


def _shared_variance_error_dn2(darks: Sequence[LevelStatistics]) -> float:
    """Return the error that all dark variances may share: noise cut off at 0, and rounding that is hardly dithered.

    A normal law that is cut off at z standard deviations below its mean, with p beyond, has a variance that is smaller
    by z phi(z) + p - z^2 p of itself.
    """
    variance = float(np.median([dark.temporal_variance_dn2 for dark in darks]))
    spatial = float(np.median([max(dark.ordinary.variance_dn2, 0.0) for dark in darks]))
    zeros = max(dark.samples.zero_fraction for dark in darks)
    cut = 0.0
    if zeros > 0.0:
        z = -float(ndtri(zeros))
        cut = z * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + zeros - z**2 * zeros
    noise_dn2 = least_noise_dn2(np.array(variance), np.array(spatial))
    rounding = float(variance_rounding_error_dn2(noise_dn2, np.array(spatial)))
    return float(np.hypot(cut * variance, rounding))


def _smoothed_variance_error(darks: Sequence[LevelStatistics], model_dn2: FloatArray) -> FloatArray:
    """Return the sampling variance of each temporal variance, relative as measured, absolute by the model.

    A point that is low by chance has a small error by its own measure; weighted by it, a fit is too low.
    """
    relative = np.array([dark.temporal_std_error_dn2 / dark.temporal_variance_dn2 for dark in darks])
    smoothed: FloatArray = np.square(relative * model_dn2)
    return smoothed


@dataclass(frozen=True, kw_only=True, eq=False)
class DarkMatch:
    """Which darks stand for the dark part of which flat."""

    weights: FloatArray
    covered: NDArray[np.bool_]


def match_darks(flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics]) -> DarkMatch:
    """Return the dark levels of the same exposure, interpolated between neighbours where there are none.

    Outside of the darks' exposures the nearest one is taken; where an exposure is not known, all of them. Without darks
    one stated level stands for all.
    """
    if not darks:
        return DarkMatch(weights=np.ones((len(flats), 1)), covered=np.ones(len(flats), dtype=bool))
    frames = np.array([float(dark.n_frames) for dark in darks])
    times = np.array([np.nan if dark.exposure_s is None else dark.exposure_s for dark in darks])
    wanted = np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])
    if np.isnan(times).any() or np.isnan(wanted).any():
        weights = np.tile(frames / frames.sum(), (len(flats), 1))
        return DarkMatch(weights=weights, covered=np.zeros(len(flats), dtype=bool))
    distinct = np.unique(times)
    shares = np.where(times == distinct[:, None], frames, 0.0)
    shares /= shares.sum(axis=1, keepdims=True)
    mix = np.column_stack([np.interp(wanted, distinct, corner) for corner in np.eye(len(distinct))])
    covered = (wanted >= distinct[0] * (1.0 - _EXPOSURE_TOLERANCE)) & (
        wanted <= distinct[-1] * (1.0 + _EXPOSURE_TOLERANCE)
    )
    return DarkMatch(weights=mix @ shares, covered=covered)


# Linearity: departure of the mean from proportional to the light, and its effect on the photon-transfer curve

LightKind = Literal["exposure", "photons"]

# A cubic with an offset has four parameters; three more levels show the scatter about it.
LINEARITY_LEVELS = 7
_TERMS = 4
# Photons per exposure that are the same to this much are of one lamp setting; exposures are then the better known.
_ONE_LAMP = 0.02
_ROOT_STEPS = 5
_STEP_OF_ERROR = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearityCurve:
    """The response `signal = x (1 + quadratic x + cubic x^2)`, x [DN] proportional to the light."""

    light: LightKind
    quadratic_per_dn: float
    cubic_per_dn2: float
    covariance: FloatArray
    relative_scatter: float
    dn_per_photon: float | None
    dn_per_photon_std_error: float

    @property
    def variance_cubic_per_dn2(self) -> float:
        """The relative term in signal^2 that the response gives a photon-transfer curve [DN^-2].

        Noise of photons passes the response with its slope: variance = gain x (d signal / d x)^2; x expressed by
        the signal, this is gain signal (1 + 3 quadratic signal + (5 cubic - 2 quadratic^2) signal^2 + ...).
        """
        return 5.0 * self.cubic_per_dn2 - 2.0 * self.quadratic_per_dn**2

    @property
    def variance_cubic_error_per_dn2(self) -> float:
        """Standard error of `variance_cubic_per_dn2` [DN^-2].

        A lamp that fades or brightens evenly makes a quadratic term b with a cubic one of 2 b^2, and no term of the
        photon-transfer curve: 8 b^2 less than it seems. Whether b is the sensor's or the lamp's is not known.
        """
        gradient = np.array([-4.0 * self.quadratic_per_dn, 5.0])
        of_the_lamp = 8.0 * self.quadratic_per_dn**2 / np.sqrt(3.0)
        return float(np.hypot(np.sqrt(gradient @ self.covariance @ gradient), of_the_lamp))


def fit_linearity(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, *, noise_dn2: FloatArray
) -> LinearityCurve | None:
    """Return the response of a sensor, None where the light of the levels is not known or takes too few values.

    Fitted is a cubic in the light with an offset: an exposure is often longer or shorter than stated by a fixed
    time. Offset and slope then say where the light is 0, and the cubic is written about that point. Scatter
    of the lamp is estimated from the levels, in proportion to the signal; a lamp that is unsteady makes the
    errors of the curve large, and no more.
    """
    light, kind = _light(flats)
    if light is None:
        return None
    unit = light.max()
    design = (light / unit)[:, None] ** np.arange(_TERMS)
    fit = fit_with_scatter(design, signal_dn, sampling_covariance=np.diag(noise_dn2), scatter_shape=signal_dn)
    terms = _terms(fit.parameters)
    if terms is None:
        return None
    steps = _STEP_OF_ERROR * np.diag(np.sqrt(np.diag(fit.covariance)))
    shifted = [(_terms(fit.parameters + step), _terms(fit.parameters - step)) for step in steps]
    gradient = np.array(
        [
            (up - down) / (2.0 * step.max())
            for (up, down), step in zip(shifted, steps, strict=True)
            if up is not None and down is not None
        ]
    ).T
    if gradient.shape != (len(terms), _TERMS):
        return None
    errors = gradient @ fit.covariance @ gradient.T
    light_per_photon = _light_per_photon(flats, light)
    return LinearityCurve(
        light=kind,
        quadratic_per_dn=float(terms[0]),
        cubic_per_dn2=float(terms[1]),
        covariance=errors[:2, :2],
        relative_scatter=fit.scatter,
        dn_per_photon=float(terms[2]) / unit * light_per_photon if light_per_photon else None,
        dn_per_photon_std_error=float(np.sqrt(errors[2, 2])) / unit * (light_per_photon or 0.0),
    )


def _light_per_photon(flats: Sequence[LevelStatistics], light: FloatArray) -> float | None:
    """Return how much of the light's own unit a photon is, None where photons are not stated."""
    photons = [flat.photons for flat in flats if flat.photons is not None]
    if len(photons) < len(flats) or sum(photons) <= 0.0:
        return None
    return float(light.sum() / sum(photons))


def _light(flats: Sequence[LevelStatistics]) -> tuple[FloatArray | None, LightKind]:
    exposures = np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])
    photons = np.array([np.nan if flat.photons is None else flat.photons for flat in flats])
    if not np.isnan(photons).any() and not _proportional(exposures, photons):
        return (photons if _enough(photons) else None), "photons"
    return (exposures if _enough(exposures) else None), "exposure"


def _proportional(exposures: FloatArray, photons: FloatArray) -> bool:
    if np.isnan(exposures).any() or exposures.min() <= 0.0:
        return False
    ratio = photons / exposures
    return bool(np.ptp(ratio) <= _ONE_LAMP * ratio.max())


def _enough(light: FloatArray) -> bool:
    return not np.isnan(light).any() and light.min() >= 0.0 and len(np.unique(light)) >= LINEARITY_LEVELS


def _terms(polynomial: FloatArray) -> FloatArray | None:
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


# Points of a photon-transfer curve: temporal variance against mean, and which of them a fit may use


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
    """The points of a photon-transfer curve, by ascending signal."""

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
    """Return the points of the photon-transfer curve."""
    signal = np.array([flat.mean_dn for flat in flats]) - match.weights @ dark.means_dn
    total = np.array([flat.temporal_variance_dn2 for flat in flats]) - _breakthrough_dn2(flats, signal)
    return TransferPoints(
        signal_dn=signal,
        variance_dn2=total - match.weights @ dark.variances_dn2,
        flat_variance_dn2=total,
        flat_std_error_dn2=np.array([flat.temporal_std_error_dn2 for flat in flats]),
        dark_covariance_dn4=match.weights @ dark.variance_covariance_dn4 @ match.weights.T,
        black_error_dn=dark.shared_error_dn,
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
    """Points of a photon-transfer curve that a fit may use."""

    mask: NDArray[np.bool_]
    saturation: SaturationLevel | None


def usable_points(points: TransferPoints, *, full_signal_dn: float, light: FloatArray | None = None) -> UsablePoints:
    """Return the points up to 80 % of saturation with less than 0.1 % of their samples at the ceiling."""
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


# Gain from the photon-transfer curve: temporal variance against mean


# From this many levels on a bend is fitted; below it would take all the freedom there is.
BEND_LEVELS = 5
# From this many on a cubic term is fitted too, where the response of the sensor is not known.
_CUBIC_LEVELS = 8
_PASSES_PHOTON_TRANSFER = 3
_TERMS_PHOTON_TRANSFER = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotonTransfer:
    """A photon-transfer curve and the fit through it: variance = gain * signal + bend * signal^2 + cubic * signal^3."""

    points: TransferPoints  #: all points
    used: NDArray[np.bool_]  #: (n,): those that the fit uses
    #: gain [DN/e-], and bend and cubic term where they were fitted, from the used points' variances; the scatter is
    #: that of the gain [DN/e-]
    fit: ScatterFit
    #: the sensor's response, where the light of the levels is known; the cubic term is then its
    linearity: LinearityCurve | None
    saturation: SaturationLevel | None  #: where the variance is largest; None where it never falls
    #: part of the gain's relative error: a change of the gain with the level looks like a change of the lamp
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
        if self.linearity is None or len(self.fit.parameters) < _TERMS_PHOTON_TRANSFER:
            return 0.0
        return abs(float(self.fit.response[0, -1])) * self.gain_dn_per_e * self.linearity.variance_cubic_error_per_dn2

    @property
    def gain_by_black(self) -> float:
        """Derivative of the gain by the black level [1/e-]."""
        return float(self.gain_response.sum()) * self.gain_dn_per_e

    @property
    def gain_error_of_black_dn_per_e(self) -> float:
        """Part of the gain's standard error by the error that all signals share."""
        return abs(self.gain_by_black) * self.points.black_error_dn

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

    Used are levels up to 80 % of saturation with less than 0.1 % of their samples at the ceiling. No intercept:
    the dark is taken off at the same exposure.

    Weights are the inverse sampling variances, as each level's own squares scatter. On real sensors points
    scatter by more (a measured CCD: 1.1 % where sampling gives 0.3 %), by something that does not average
    away within a level; a relative scatter is estimated from the points and added to all of them, so that a
    long stack does not decide the gain alone.

    No sensor is quite linear, and in some the charge of a bright pixel spreads: both bend the curve by a few
    per cent towards the bright end, so that a straight line finds a gain that depends on its range. The gain
    is the slope at no signal. Where the light of the levels is known, mean against light gives the response
    (`calibration.sensor.curves`), and with it the cubic term of the curve; its error makes one shared by all points.
    From 5 levels on a quadratic term is fitted with the slope, always: choosing it by its significance would make
    the error bar wrong. It holds what the response says and what spreading charge adds, and makes the gain
    independent of a lamp that drifts evenly during the sweep. Without a response, from 8 levels on, the cubic
    term is fitted too. Each term makes the standard error of the gain larger by the first's: 1, 2, 3.

    EMVA Standard 1288, Release 4.0 Linear, section 6.6, which has no weights, no bend and no errors.
    """
    used = usable.mask
    known = used if wrong_light is None else used & ~wrong_light
    linearity = _linearity(flats, points, known, mean_variance_dn2) if known.any() else None
    fit = _fit_curve(points, used, linearity)
    return PhotonTransfer(points=points, used=used, fit=fit, linearity=linearity, saturation=usable.saturation)


def with_fitted_dark_variance(transfer: PhotonTransfer) -> PhotonTransfer:
    """Return a curve whose points lack the most likely dark variance, where the fit alone tells it."""
    points, used = transfer.points, transfer.used
    shared = points.dark_covariance_dn4[np.ix_(used, used)]
    covariance = np.diag(np.square(points.flat_std_error_dn2[used])) + shared
    covariance += np.diag(np.square(transfer.fit.scatter * points.signal_dn[used]))
    residual = points.variance_dn2[used] - transfer.variance_at(points.signal_dn[used])
    excess_dn2 = float(shared[0] @ np.linalg.solve(covariance, residual))
    return replace(transfer, points=replace(points, variance_dn2=points.variance_dn2 - excess_dn2))


def _linearity(
    flats: Sequence[LevelStatistics], points: TransferPoints, known: NDArray[np.bool_], mean_variance_dn2: FloatArray
) -> LinearityCurve | None:
    chosen = [flats[index] for index in np.flatnonzero(known).tolist()]
    return fit_linearity(chosen, points.signal_dn[known], noise_dn2=mean_variance_dn2[known])


def _n_terms(n_points: int, linearity: LinearityCurve | None) -> int:
    if n_points < BEND_LEVELS:
        return 1
    return _TERMS_PHOTON_TRANSFER if linearity is not None or n_points >= _CUBIC_LEVELS else _TERMS_PHOTON_TRANSFER - 1


def _fit_curve(points: TransferPoints, used: NDArray[np.bool_], linearity: LinearityCurve | None) -> ScatterFit:
    signal, variance, total = points.signal_dn[used], points.variance_dn2[used], points.flat_variance_dn2[used]
    design = signal[:, None] ** np.arange(1, _n_terms(len(signal), linearity) + 1)
    relative_error = points.flat_std_error_dn2[used] / total
    model, gain = total, float(np.median(variance / signal))
    for _ in range(_PASSES_PHOTON_TRANSFER):
        # A point that is low by chance claims a small error; by the model's variance it does not.
        covariance = np.diag(np.square(relative_error * model)) + points.dark_covariance_dn4[np.ix_(used, used)]
        fit = _fit_terms(
            design, variance, covariance, linearity if design.shape[1] == _TERMS_PHOTON_TRANSFER else None, gain
        )
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


# Bend of a photon-transfer curve beyond the response of the sensor: charge that spreads to neighbours


@dataclass(frozen=True, kw_only=True)
class BrighterFatter:
    """Relative change of the temporal variance by spreading charge."""

    value: float
    std_error: float
    signal_dn: float


def brighter_fatter(transfer: PhotonTransfer) -> BrighterFatter | None:
    """Return the bend of the curve that the response of the sensor does not explain; None without a response.

    The quadratic term of the curve less three times that of the response, in parts of the gain; to first order,
    and its two errors as if independent.

    Astier et al., A&A 629, A36 (2019), doi:10.1051/0004-6361/201935508: variance = gain signal (1 + a signal).
    """
    curve = transfer.linearity
    if curve is None or len(transfer.fit.parameters) < 2:
        return None
    top_dn, gain = transfer.top_dn, transfer.gain_dn_per_e
    own, response = np.sqrt(transfer.fit.covariance[1, 1]) / gain, 3.0 * np.sqrt(curve.covariance[0, 0])
    return BrighterFatter(
        value=(transfer.bend / gain - 3.0 * curve.quadratic_per_dn) * top_dn,
        std_error=float(np.hypot(own, response)) * top_dn,
        signal_dn=top_dn,
    )


# Slope of the response at a signal: answer of a bright pixel to a little more light, beside signal over light

_NEWTON_STEPS = 6
_TERMS_RESPONSE_SLOPE = 3


@dataclass(frozen=True, kw_only=True)
class ResponseSlope:
    """Slope of the response at a signal, relative to signal over light."""

    value: float
    std_error: float


def response_slope(transfer: PhotonTransfer, signal_dn: float) -> ResponseSlope:
    """Return (d signal / d light) / (signal / light): contrast between pixels is seen as many times as large.

    From mean against light, or from the photon-transfer curve, whichever is known better. A lamp that drifts evenly
    bends the first as a sensor does, charge that spreads bends the second; what they disagree by is in the error of the
    first. Where light is not known: from the curve; with fewer levels than show a bend, 1.

    For signal = x (1 + b x + c x^2): the curve has the relative terms 3 b and 5 c - 2 b^2 (`LinearityCurve`).
    """
    by_noise = _by_noise(transfer, signal_dn)
    if transfer.linearity is None:
        return by_noise
    by_light = _by_light(transfer, transfer.linearity, signal_dn)
    return min(by_light, by_noise, key=lambda slope: slope.std_error) if by_noise.std_error else by_light


def _by_light(transfer: PhotonTransfer, curve: LinearityCurve, signal_dn: float) -> ResponseSlope:
    gradient = np.array([signal_dn, 2.0 * signal_dn**2])
    variance = float(gradient @ curve.covariance @ gradient)
    beyond = brighter_fatter(transfer)
    if beyond is not None:
        variance += (beyond.value * signal_dn / beyond.signal_dn / 3.0) ** 2
    return ResponseSlope(value=_value(curve, signal_dn), std_error=float(np.sqrt(variance)))


def _value(curve: LinearityCurve, signal_dn: float) -> float:
    light = signal_dn
    for _ in range(_NEWTON_STEPS):
        light -= (_signal(curve, light) - signal_dn) / _slope(curve, light)
    return _slope(curve, light) * light / signal_dn


def _signal(curve: LinearityCurve, light_dn: float) -> float:
    return light_dn * (1.0 + (curve.quadratic_per_dn + curve.cubic_per_dn2 * light_dn) * light_dn)


def _slope(curve: LinearityCurve, light_dn: float) -> float:
    return 1.0 + (2.0 * curve.quadratic_per_dn + 3.0 * curve.cubic_per_dn2 * light_dn) * light_dn


def _by_noise(transfer: PhotonTransfer, signal_dn: float) -> ResponseSlope:
    terms = len(transfer.fit.parameters)
    if terms == 1:
        return ResponseSlope(value=1.0, std_error=0.0)
    quadratic = transfer.bend / transfer.gain_dn_per_e / 3.0
    cubic = (
        (transfer.cubic / transfer.gain_dn_per_e + 2.0 * quadratic**2) / 5.0 if terms == _TERMS_RESPONSE_SLOPE else 0.0
    )
    gradient = np.array([signal_dn / 3.0, 2.0 * signal_dn**2 / 5.0])[: terms - 1] / transfer.gain_dn_per_e
    variance = float(gradient @ transfer.fit.covariance[1:, 1:] @ gradient)
    return ResponseSlope(
        value=1.0 + (quadratic + 2.0 * cubic * signal_dn) * signal_dn, std_error=float(np.sqrt(variance))
    )


# Plausibility of exposures: the unit that they are stated in, and what a dark current says of it

# Whole sweeps are neither shorter than this nor longer [s].
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0
# Longest exposures of sweeps by usual cameras begin here [s]; shorter ones need a light that few have.
_USUAL_S = 5e-5
# Warm cameras for visible light have tens to thousands of electrons a second.
ABSURD_E_PER_S = 1e5
# Without cooling less is rare, and more is of hot or infrared sensors [e-/s].
_COOLED_E_PER_S, _HOT_E_PER_S = 0.1, 5e3
_SIGMA = 5.0
_BOUND_SIGMA = 3.0
# Units by what `--exposure-unit` calls them: seconds in each, and their names.
_UNITS = {
    "ns": (1e-9, "nanoseconds"),
    "us": (1e-6, "microseconds"),
    "ms": (1e-3, "milliseconds"),
    "s": (1.0, "seconds"),
}


@dataclass(frozen=True, kw_only=True)
class StatedExposures:
    """Place where exposures are stated, and the unit that they were read in."""

    where: str = "what was given"  #: such as "the column exposure_ms"
    unit: str | None = None  #: ns, us, ms or s; None where it is not one for all
    has_option: bool = True  #: whether --exposure-unit states another; otherwise what is stated has to be corrected


_ANYWHERE = StatedExposures()


def impossible_exposures(levels: Sequence[LevelStatistics], *, stated: StatedExposures = _ANYWHERE) -> tuple[Flag, ...]:
    """Return a refusing flag if no camera's sweep has such exposures."""
    longest_s = _longest_s(levels)
    if longest_s is None or _SHORTEST_S <= longest_s <= _LONGEST_S:
        return ()
    return (
        Flag(
            name="wrong_time_unit",
            message=f"the longest exposure is {longest_s:.3g} s, no camera's sweep: exposures are stated in another "
            f"unit than {_as_read(stated)}: {_advice(longest_s, stated)}",
            refuses=True,
        ),
    )


def is_absurd(dark_current_e_per_s: Estimate | None) -> bool:
    """Return whether a dark current, or all that is known of it, is beyond any camera's for visible light."""
    if dark_current_e_per_s is None:
        return False
    found = dark_current_e_per_s
    return abs(found.value) + _BOUND_SIGMA * found.std_error > ABSURD_E_PER_S


def implausible_unit(
    levels: Sequence[LevelStatistics], dark_current_e_per_s: Estimate | None, *, stated: StatedExposures = _ANYWHERE
) -> tuple[Flag, ...]:
    """Return a flag if exposures are unusual and the dark current that they give is no camera's."""
    longest_s = _longest_s(levels)
    if longest_s is None or dark_current_e_per_s is None or not is_absurd(dark_current_e_per_s):
        return ()
    found = dark_current_e_per_s
    resolved = found.value - _SIGMA * found.std_error > ABSURD_E_PER_S
    if not resolved and longest_s > _USUAL_S:
        return ()
    what = (
        f"the dark signal grows as in no camera for visible light (more than {ABSURD_E_PER_S:.0e} e-/s)"
        if resolved
        else "with them the dark current could be more than any camera's"
    )
    return (
        Flag(
            name="wrong_time_unit",
            message=f"the longest exposure is {longest_s:.3g} s, and {what}: exposures are stated in another unit than "
            f"{_as_read(stated)}"
            + (", or light reached the dark frames" if resolved else "")
            + f"; the dark current is not known until the unit is: {_advice(longest_s, stated)}",
        ),
    )


def unusual_dark_current(
    dark_current_e_per_s: Estimate | None, *, stated: StatedExposures = _ANYWHERE
) -> tuple[Flag, ...]:
    """Return a flag if a dark current is one of other cameras than usual, as exposures in another unit make it."""
    if dark_current_e_per_s is None:
        return ()
    found, reach = dark_current_e_per_s, _BOUND_SIGMA * dark_current_e_per_s.std_error
    most, least = max(found.value, 0.0) + reach, found.value - reach
    if most < _COOLED_E_PER_S and least > -_COOLED_E_PER_S:
        what = f"below {most:.2g} e-/s, as of cooled sensors, or of cameras that take their own dark signal off"
        return (_unusual(what, "shorter", _beside(stated, -1)),)
    if least > _HOT_E_PER_S:
        return (_unusual(f"above {least:.2g} e-/s, as of hot or infrared sensors", "longer", _beside(stated, 1)),)
    return ()


def _unusual(what: str, true_is: str, advice: str) -> Flag:
    return Flag(
        name="unusual_dark_current",
        message=f"the dark current is {what}: if this camera is none of them, its exposures are {true_is} than stated, "
        f"by a wrong unit: {advice}",
    )


def _beside(stated: StatedExposures, step: int) -> str:
    """Return how to state the next larger or smaller unit."""
    units = list(_UNITS)
    place = -1 if stated.unit is None else units.index(stated.unit) + step
    if not stated.has_option or (stated.unit is not None and place not in range(len(units))):
        return f"correct {stated.where}"
    if stated.unit is None:
        return f"look at {stated.where}, or state it with --exposure-unit"
    return f"if {_UNITS[units[place]][1]} stand in {stated.where}, state the unit with --exposure-unit {units[place]}"


def _longest_s(levels: Sequence[LevelStatistics]) -> float | None:
    return max((level.exposure_s for level in levels if level.exposure_s is not None), default=None)


def _as_read(stated: StatedExposures) -> str:
    """Return the unit that exposures were read in, in words."""
    if stated.unit is None:
        return f"was read from {stated.where}"
    return f"the {_UNITS[stated.unit][1]} that were read from {stated.where}"


def _advice(longest_s: float, stated: StatedExposures) -> str:
    if not stated.has_option:
        return f"correct {stated.where}"
    others = [unit for unit in _UNITS if unit != stated.unit]
    likely = _likely_unit(longest_s, stated.unit)
    if stated.unit is None or likely is None:
        return f"state its unit with --exposure-unit {', '.join(others[:-1])} or {others[-1]}"
    seconds, name = _UNITS[likely]
    in_it_s = longest_s * seconds / _UNITS[stated.unit][0]
    return (
        f"if {name} stand in {stated.where}, it is {in_it_s:.3g} s, as usual: state the unit with "
        f"--exposure-unit {likely}"
    )


def _likely_unit(longest_s: float, unit: str | None) -> str | None:
    """Return the nearest unit in which unusual exposures are usual; None where no unit or each of two may be it."""
    if unit is None or _USUAL_S <= longest_s <= _LONGEST_S:
        return None
    by_nearness = sorted(
        _UNITS, key=lambda one: max(_UNITS[one][0] / _UNITS[unit][0], _UNITS[unit][0] / _UNITS[one][0])
    )
    usual = (one for one in by_nearness if _USUAL_S <= longest_s * _UNITS[one][0] / _UNITS[unit][0] <= _LONGEST_S)
    return next(usual, None)


# The rise of temperature that doubles the dark current


_LEAST = 2
_RESOLVED_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class DoublingTemperature:
    """The doubling interval of a dark current."""

    value_k: float  #: rise of temperature that doubles the dark current [K]
    std_error_k: float
    n_temperatures: int  #: temperatures it was made from
    chi2_per_dof: float | None  #: how the points fit an exponential; None with two of them


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
    A straight line through the logarithm, weighted by the relative errors; points that scatter more than these say
    widen the error.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, doubling temperature.
    """
    _require_resolved(temperature_c, dark_current, std_error)
    relative = std_error / dark_current
    centred = temperature_c - temperature_c.mean()
    fit = fit_with_scatter(
        np.column_stack([np.ones(len(centred)), centred]),
        np.log(dark_current),
        sampling_covariance=np.diag(np.square(relative)),
        scatter_shape=np.ones(len(centred)),
    )
    slope, error = float(fit.parameters[1]), float(np.sqrt(fit.covariance[1, 1]))
    if slope <= _RESOLVED_SIGMA * error:
        raise CalibrationError(
            f"the dark current does not grow with temperature: its logarithm by "
            f"{number_with_error(slope, error)} per K; take "
            f"temperatures that are further apart"
        )
    value = float(np.log(2.0)) / slope
    return DoublingTemperature(
        value_k=value,
        std_error_k=value * error / slope,
        n_temperatures=len(temperature_c),
        chi2_per_dof=fit.chi2_per_dof,
    )


def _require_resolved(temperature_c: FloatArray, dark_current: FloatArray, std_error: FloatArray) -> None:
    if len(np.unique(temperature_c)) < _LEAST:
        raise CalibrationError(
            f"there are {len(np.unique(temperature_c))} different temperatures; a doubling interval needs two, better "
            f"six"
        )
    for temperature, current, error in zip(temperature_c, dark_current, std_error, strict=True):
        if current <= _RESOLVED_SIGMA * error:
            raise CalibrationError(
                f"at {temperature:g} C the dark current is {number_with_error(current, error)}, not more than "
                f"{_RESOLVED_SIGMA:g} standard errors above 0: take longer dark exposures, or leave it out"
            )
