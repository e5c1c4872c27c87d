"""Judging of single levels: which dark or flat is wrong, why, and what it is left out of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from calibration.estimate import number_with_error, percent_with_error
from calibration.results import Flag
from calibration.sensor.curves import (
    QUANTISATION_LIMIT_DN2,
    DarkMatch,
    DarkSignal,
    LightStability,
    PhotonTransfer,
    TransferPoints,
    UsablePoints,
    beyond_range,
    fit_photon_transfer,
    light_stability,
    mean_sampling_variance,
    transfer_points,
    usable_points,
    wander_variance_dn2,
)
from calibration.sensor.fits import CurveModel, PointInfluence, point_influence
from calibration.sensor.levels import (
    LevelStatistics,
    describe_level,
    least_noise_dn2,
    mean_rounding_error_dn,
    variance_rounding_error_dn2,
)

# Influence of single dark levels: which stand off what the others say of mean and temporal variance

FloatArray = NDArray[np.float64]

# Chances that a sound set has a dark named on one axis; with those of the flats below 1 %.
_FALSE_MEAN, _FALSE_VARIANCE = 5e-4, 5e-4
_LEAST_LEVELS = 5
# Terms against exposure; how large each may be at least, in errors of a level, and over the one before it.
_MOST_TERMS, _LEAST_TERM, _NEXT_TERM = 6, 10.0, 0.5
_LEAST_VARIANCE_DN2, _LEAST_RELATIVE = 1e-9, 1e-6


@dataclass(frozen=True, kw_only=True)
class DarkInfluence:
    """One dark level: its mean and its temporal variance against exposure [DN, DN^2]."""

    mean_off_dn: float
    mean_std_error_dn: float
    variance_off_dn2: float
    variance_std_error_dn2: float
    outlying: bool


def dark_influence(darks: Sequence[LevelStatistics]) -> tuple[DarkInfluence, ...] | None:
    """Return each dark level beside the others; None with fewer than five.

    Means follow a polynomial of the exposure. Variances follow one too, or a straight line of the mean: however a dark
    current changes, its electrons add to the variance what they add to the mean.
    """
    if len(darks) < _LEAST_LEVELS:
        return None
    exposures = np.array([np.nan if dark.exposure_s is None else dark.exposure_s for dark in darks])
    by_mean = _by_mean(darks, exposures)
    by_variance = None if by_mean is None else _by_variance(darks, exposures, by_mean)
    if by_mean is None or by_variance is None:
        return None
    return tuple(
        DarkInfluence(
            mean_off_dn=float(by_mean.deviation[index]),
            mean_std_error_dn=float(by_mean.std_error[index]),
            variance_off_dn2=float(by_variance.deviation[index]),
            variance_std_error_dn2=float(by_variance.std_error[index]),
            outlying=bool(by_mean.outlying[index] or by_variance.outlying[index]),
        )
        for index in range(len(darks))
    )


def _by_mean(darks: Sequence[LevelStatistics], exposures: FloatArray) -> PointInfluence | None:
    means = np.array([dark.mean_dn for dark in darks])
    # Pixels that jump are left out of the mean of one level and not of the next.
    left_out_dn = np.array([np.mean(dark.frame_means_dn) for dark in darks]) - means
    own = mean_sampling_variance(darks) + np.square(left_out_dn)
    models = _models(exposures, means, own)
    return point_influence(models, means, own, abscissa=exposures, p_false=_FALSE_MEAN)


def _by_variance(
    darks: Sequence[LevelStatistics], exposures: FloatArray, by_mean: PointInfluence
) -> PointInfluence | None:
    temporal = np.array([dark.temporal_variance_dn2 for dark in darks])
    spatial = np.array([max(dark.ordinary.variance_dn2, 0.0) for dark in darks])
    seen = np.maximum(temporal, _LEAST_VARIANCE_DN2)
    relative = np.array([dark.temporal_std_error_dn2 for dark in darks]) / seen
    own = np.square(np.maximum(relative, _LEAST_RELATIVE) * np.maximum(_line_of_all(exposures, temporal), seen.min()))
    own += np.square(variance_rounding_error_dn2(least_noise_dn2(temporal, spatial), spatial))
    models = _models(exposures, temporal, own)
    means = by_mean.values - np.where(by_mean.outlying, by_mean.deviation, 0.0)
    if len(models) > 1 and np.ptp(means) > 0.0:
        along = (means - means.min()) / np.ptp(means)
        models.append(_curve(np.column_stack([np.ones(len(means)), along]), _sizes(exposures, temporal, own)))
    return point_influence(models, temporal, own, abscissa=exposures, p_false=_FALSE_VARIANCE)


def _line_of_all(exposures: FloatArray, values: FloatArray) -> FloatArray:
    """Return the rising line of Theil and Sen at each exposure, which up to a quarter of wrong darks leave alone.

    A variance that is low by chance claims a small error by its own measure; by what is usual for all, one of a long
    exposure would do so too, where dark current makes most of the noise.

    Sen, J. Am. Stat. Assoc. 63, 1379 (1968), doi:10.1080/01621459.1968.10480934.
    """
    first, second = np.triu_indices(len(exposures), k=1)
    span = exposures[second] - exposures[first]
    apart = np.abs(span) > 0.0
    rising = np.zeros_like(values)
    if apart.any() and not np.isnan(exposures).any():
        slopes = (values[second] - values[first])[apart] / span[apart]
        rising = max(float(np.median(slopes)), 0.0) * exposures
    line: FloatArray = float(np.median(values - rising)) + rising
    return line


def _sizes(exposures: FloatArray, values: FloatArray, variance: FloatArray) -> FloatArray:
    """Return how large each term of a curve may be: as large as what dark current adds, and smaller from term to term.

    A dark current that grows with the sensor's temperature bends the means by many times their errors.
    """
    least = _LEAST_TERM * float(np.sqrt(np.median(variance)))
    first = max(float(np.ptp(_line_of_all(exposures, values))), least)
    sizes: FloatArray = np.maximum(first * _NEXT_TERM ** np.arange(-1.0, _MOST_TERMS - 1.0), least)
    sizes[0] = np.inf
    return sizes


def _curve(design: FloatArray, sizes: FloatArray) -> CurveModel:
    return CurveModel(design=design, scatter_shape=np.ones(len(design)), term_sizes=sizes[: design.shape[1]])


def _models(exposures: FloatArray, values: FloatArray, variance: FloatArray) -> list[CurveModel]:
    """Return the curves that darks may follow against their exposure."""
    if np.isnan(exposures).any() or np.ptp(exposures) == 0.0:
        return [CurveModel(design=np.ones((len(exposures), 1)), scatter_shape=np.ones(len(exposures)))]
    n_exposures = len(np.unique(exposures))
    n_terms = max(min(_MOST_TERMS, n_exposures // 2), min(4, n_exposures))
    # Chebyshev's polynomials: the size of each is how far it takes the curve, whatever the others do.
    scaled = 2.0 * (exposures - exposures.min()) / np.ptp(exposures) - 1.0
    powers, sizes = np.polynomial.chebyshev.chebvander(scaled, n_terms - 1), _sizes(exposures, values, variance)
    # A sensor that warms up scatters the more the longer it exposes.
    growing = CurveModel(
        design=powers[:, :2],
        scatter_shape=np.maximum(exposures / exposures.max(), 1e-3),
        term_sizes=sizes[:2],
        is_usual=False,
    )
    return [*(_curve(powers[:, :terms], sizes) for terms in range(1, n_terms + 1)), growing]


# Influence of single flats: which stand off what the others say, and on which axis

Mask = NDArray[np.bool_]
LightName = Literal["exposure", "photons"]

# Chances that a sound set has a flat named on one axis; with those of the darks below 1 %.
_FALSE_VARIANCE_LEVEL_INFLUENCE, _FALSE_LIGHT = 1e-3, 1.5e-3
# Exposures are longer or shorter than stated by a fixed time: some microseconds of a sweep of ten milliseconds.
_USUAL_OFFSET = 3e-4
# Usual sizes of what a sweep may have besides, in shares of the brightest: an offset, bends of response and of noise.
_OFFSET, _BEND_OF_RESPONSE, _BEND_OF_NOISE = 0.02, 0.1, 0.2


def noise_influence(points: TransferPoints, used: Mask) -> PointInfluence | None:
    """Return each used point of a photon-transfer curve beside the curve through the others."""
    signal, variance = points.signal_dn[used], points.variance_dn2[used]
    gain = float(np.median(variance / signal))
    dark = float(np.median(points.flat_variance_dn2[used] - variance))
    relative = points.flat_std_error_dn2[used] / points.flat_variance_dn2[used]
    own = np.square(relative * np.maximum(dark + gain * signal, 0.0)) + np.diag(points.dark_covariance_dn4)[used]
    scaled = signal / signal.max()
    models = [
        CurveModel(
            design=np.column_stack([scaled**power for power in powers]),
            scatter_shape=signal,
            term_sizes=abs(gain) * signal.max() * np.where(np.equal(powers, 1), np.inf, _BEND_OF_NOISE),
        )
        for powers in ((1,), (1, 2), (1, 2, 3))
    ]
    return point_influence(models, variance, own, abscissa=signal, p_false=_FALSE_VARIANCE_LEVEL_INFLUENCE)


@dataclass(frozen=True, kw_only=True, eq=False)
class LightInfluence:
    """The means of flats beside the response to the light."""

    light: LightName
    points: PointInfluence


def light_influence(
    flats: Sequence[LevelStatistics], signal_dn: FloatArray, own_dn2: FloatArray
) -> tuple[LightInfluence, ...]:
    """Return the flats beside the response to their light, the light that they follow best first.

    Exposures, photons, both or neither may be stated. Scatter of the levels beyond their own errors is in proportion to
    the signal (the lamp) or, where that explains more than one wrong level would, the same at all (steps of exposures).
    """
    lights: tuple[tuple[LightName, FloatArray], ...] = (("exposure", _exposures(flats)), ("photons", _photons(flats)))
    found = [
        LightInfluence(light=name, points=points)
        for name, light in lights
        if (points := _beside_response(signal_dn, light, own_dn2)) is not None
    ]
    return tuple(sorted(found, key=lambda one: one.points.cost))


def _exposures(flats: Sequence[LevelStatistics]) -> FloatArray:
    return np.array([np.nan if flat.exposure_s is None else flat.exposure_s for flat in flats])


def _photons(flats: Sequence[LevelStatistics]) -> FloatArray:
    return np.array([np.nan if flat.photons is None else flat.photons for flat in flats])


def stated_light(flats: Sequence[LevelStatistics]) -> FloatArray | None:
    """Return photons or exposures of flats, None where neither is known of all or they do not differ."""
    known = [light for light in (_photons(flats), _exposures(flats)) if not np.isnan(light).any()]
    return next((light for light in known if len(np.unique(light)) > len(light) // 2), None)


def is_lamp_sweep(flats: Sequence[LevelStatistics]) -> bool:
    """Return whether the light of flats was varied by the lamp, at one exposure or at unknown ones."""
    return len(flats) > 1 and len({flat.exposure_s for flat in flats}) <= max(1, len(flats) // 4)


def mean_variance_dn2(flats: Sequence[LevelStatistics], signal_dn: FloatArray, stability: LightStability) -> FloatArray:
    """Return the variance of the means of flats by noise of pixels, rounding and wander of the light [DN^2]."""
    temporal = np.array([flat.temporal_variance_dn2 for flat in flats])
    spatial = np.array([max(flat.ordinary.variance_dn2, 0.0) for flat in flats])
    n_frames = np.array([float(flat.n_frames) for flat in flats])
    n_pixels = np.array([float(flat.n_pixels) for flat in flats])
    rounding = mean_rounding_error_dn(least_noise_dn2(temporal, spatial) + spatial)
    variance: FloatArray = (
        temporal / n_pixels + wander_variance_dn2(flats, signal_dn, stability)
    ) / n_frames + np.square(rounding)
    return variance


def _beside_response(signal_dn: FloatArray, light: FloatArray, own_dn2: FloatArray) -> PointInfluence | None:
    if np.isnan(light).any() or len(np.unique(light)) < max(_LEAST_LEVELS, len(light) // 2 + 1):
        return None
    scaled = light / light.max()
    even, full = np.full(len(light), float(np.median(signal_dn))), float(signal_dn.max())
    bends = (np.inf, _BEND_OF_RESPONSE, _BEND_OF_RESPONSE)
    models = [
        CurveModel(
            design=scaled[:, None] ** np.arange(n_terms),
            scatter_shape=shape,
            first_term_std=_USUAL_OFFSET * full if offset == _USUAL_OFFSET else None,
            term_sizes=full * np.array([offset, *bends][:n_terms]),
            is_usual=shape is signal_dn and offset == _USUAL_OFFSET,
        )
        for n_terms in (2, 3, 4)
        for offset in (_USUAL_OFFSET, _OFFSET)
        for shape in (signal_dn, even)
    ]
    without_offset = [
        CurveModel(
            design=scaled[:, None] ** np.arange(1, n_terms),
            scatter_shape=signal_dn,
            term_sizes=full * np.array(bends[: n_terms - 1]),
            is_through_zero=True,
        )
        for n_terms in (2, 3, 4)
    ]
    return point_influence([*models, *without_offset], signal_dn, own_dn2, abscissa=light, p_false=_FALSE_LIGHT)


# A gain, or a lamp, that changed half-way through a sweep


_FALSE = 1e-3
# On either side of a step, so that it is none of single levels.
_LEAST_LEVELS_GAIN_CHANGE = 3
_LEAST_FREEDOM = 3
# Chi-squared per degree of freedom that curve and step may leave.
_EXPLAINED = 4.0
# Smaller steps of the noise are left to its scatter.
_LEAST_STEP = 0.01
_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step of points that otherwise follow a smooth curve."""

    place: int
    relative: float
    std_error: float
    is_real: bool

    @property
    def height(self) -> str:
        """Height with its error, in percent."""
        return percent_with_error(self.relative, self.std_error)


def largest_step(
    design: FloatArray,
    values: FloatArray,
    variance: FloatArray,
    *,
    shape: FloatArray,
    least_share: float = 1.0,
    place: int | None = None,
) -> Step | None:
    """Return the step that explains most of what points are off a smooth curve by; None with too few points.

    Each step is one more column of the linear model, and what it takes off chi-squared is known in closed form. The
    errors are by the scatter about curve and step, never less than by sampling.
    """
    n, n_terms = design.shape
    freedom = n - n_terms - 1
    places = (
        range(_LEAST_LEVELS_GAIN_CHANGE, n - _LEAST_LEVELS_GAIN_CHANGE + 1)
        if place is None
        else range(place, place + 1)
    )
    if freedom < _LEAST_FREEDOM or not len(places) or places[-1] >= n:
        return None
    root = 1.0 / np.sqrt(variance)
    basis = np.linalg.qr(design * root[:, None])[0]
    residual = values * root - basis @ (basis.T @ (values * root))
    steps = np.array([np.where(np.arange(n) >= at, shape, 0.0) * root for at in places])
    free = steps - (steps @ basis) @ basis.T
    norm = np.sum(np.square(free), axis=1)
    height = (free @ residual) / norm
    best = int(np.argmax(np.square(height) * norm))
    left = float(residual @ residual - height[best] ** 2 * norm[best])
    error = float(np.sqrt(max(left / freedom, least_share) / norm[best]))
    limit = -stdtrit(freedom, 0.5 * _FALSE / len(places))
    return Step(
        place=places[best],
        relative=float(height[best]),
        std_error=error,
        is_real=bool(abs(height[best]) > limit * error and left < _EXPLAINED * freedom),
    )


@dataclass(frozen=True, kw_only=True)
class GainChange:
    """A change of gain or lamp during the sweep."""

    by_noise: Step | None
    by_light: Step | None
    by_dark: Step | None
    gain_error: float

    @property
    def is_of_gain(self) -> bool:
        """True where the noise itself shows it, that of flats or that of darks together with the light."""
        return is_large(self.by_noise) or (is_large(self.by_dark) and is_large(self.by_light))


def is_large(step: Step | None) -> bool:
    """Return whether there is a step, and a larger one than a lamp or a bend makes."""
    return step is not None and step.is_real and abs(step.relative) > _LEAST_STEP


def gain_change(
    noise: PointInfluence | None, light: LightInfluence | None, *, by_dark: Step | None
) -> GainChange | None:
    """Return the change of gain or lamp between two halves of a sweep, None where there is none.

    Another gain changes mean over light and variance over mean by the same share, another light the first alone. Where
    the noise is too coarse to tell, the gain is uncertain by all that the light changed.
    """
    by_noise = None if noise is None else _step(noise, terms=2)
    by_light = None if light is None else _step(light.points, terms=3)
    if by_noise is not None and is_large(by_noise) and not _denied(by_noise, light):
        return GainChange(by_noise=by_noise, by_light=by_light, by_dark=by_dark, gain_error=abs(by_noise.relative))
    if by_light is None or not by_light.is_real or noise is None:
        return None
    there = _step(noise, terms=2, place=by_light.place)
    tells = there is not None and abs(there.relative - by_light.relative) > _SIGMA * there.std_error
    return GainChange(
        by_noise=there,
        by_light=by_light,
        by_dark=by_dark,
        gain_error=0.0 if tells else abs(by_light.relative),
    )


def _denied(by_noise: Step, light: LightInfluence | None) -> bool:
    """Return whether the mean over light shows no such step where the noise has one: a gain changes both."""
    there = None if light is None else _step(light.points, terms=3, place=by_noise.place)
    if there is None:
        return False
    apart = abs(there.relative - by_noise.relative)
    return apart > _SIGMA * float(np.hypot(there.std_error, by_noise.std_error))


def _step(points: PointInfluence, *, terms: int, place: int | None = None) -> Step | None:
    scaled = points.abscissa / points.abscissa.max()
    design = np.column_stack([scaled**power for power in range(1, terms + 1)])
    # Where single levels stand off, the scatter is that of the others, and no step explains them.
    variance = points.variance + np.square(points.scatter * points.model.scatter_shape)
    least = float(np.median(points.variance / variance))
    # Single points are noisy at faint levels, and a step of their own size would find itself there.
    shape = np.abs(points.abscissa * np.median(points.values / points.abscissa))
    return largest_step(design, points.values, variance, shape=shape, least_share=least, place=place)


def change_flag(change: GainChange, levels: Sequence[LevelStatistics]) -> Flag:
    """Return what is to be said of a change; it refuses the set where it is one of the gain."""
    noise, light = change.by_noise, change.by_light
    of_noise = (
        "" if noise is None else f"variance over mean changes by {percent_with_error(noise.relative, noise.std_error)}"
    )
    of_light = "" if light is None else f"mean over light by {percent_with_error(light.relative, light.std_error)}"
    step = noise if is_large(noise) else light
    if change.is_of_gain and step is not None:
        found = [text for text in (of_noise, of_light) if text]
        if is_large(change.by_dark) and change.by_dark is not None:
            found.append(f"the variance of darks by {change.by_dark.height}")
        return Flag(
            name="gain_changed",
            message=f"from {describe_level(levels[step.place])} on {', '.join(found)} in one step"
            ": the gain of the camera changed during the sweep, and there is no single gain: keep automatic gain off "
            "and take all levels again",
            refuses=True,
        )
    where = describe_level(levels[light.place]) if light else ""
    verdict = (
        "the lamp changed; gain and noise stand, linearity is not known"
        if change.gain_error == 0.0
        else "lamp or gain changed, and the noise is too coarse to tell which: the error of the gain holds it, "
        "linearity is not known; take larger frames or more of them, with automatic gain off"
    )
    return Flag(
        name="light_or_gain_changed",
        message=f"from {where} on {of_light} in one step ({of_noise}): {verdict}",
    )


# Verdicts on single levels: which are named, why, and what they are left out of


# Deviations on both axes that agree to this many errors, or to a quarter, have one cause.
_ALIKE_SIGMA, _ALIKE_SHARE = 4.0, 0.25
_UNCLEAR = "unclear_level"
_MS_PER_S = 1e3
# Shutters and readouts of usual cameras are this late or early at most [s].
_USUAL_SHUTTER_S = 3e-6


@dataclass(frozen=True, kw_only=True)
class LevelInfluence:
    """One flat beside what all others say of it."""

    variance_off: float | None = None
    variance_std_error: float | None = None
    mean_off: float | None = None
    mean_std_error: float | None = None
    gain_shift_errors: float | None = None
    cause: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatVerdicts:
    """All flats, in their order."""

    levels: tuple[LevelInfluence, ...]
    wrong_noise: Mask
    wrong_light: Mask
    flags: tuple[Flag, ...]


def flat_verdicts(
    flats: Sequence[LevelStatistics],
    *,
    judged: Mask,
    lit: Mask,
    noise: PointInfluence | None,
    light: Sequence[LightInfluence],
) -> FlatVerdicts:
    """Return what is wrong with which flat.

    Variance against mean needs no light: a level that is off there has another noise. One that is off the light alone
    has a mean that its noise confirms, and what is stated of its light is wrong. Off on both by the same share: mean
    goes with gain, variance with its square, so variance over mean is off as much as mean over light: another gain.
    """
    places = np.flatnonzero(lit).tolist()
    levels = [LevelInfluence() for _ in flats]
    wrong_noise, wrong_light = np.zeros(len(flats), dtype=bool), np.zeros(len(flats), dtype=bool)
    flags = []
    rows_of_noise = np.cumsum(judged) - 1
    for row, index in enumerate(places):
        beside = _Beside(
            level=flats[index],
            noise=noise if judged[index] else None,
            row_of_noise=int(rows_of_noise[index]),
            light=light,
            row=row,
        )
        levels[index] = beside.influence
        wrong_noise[index], wrong_light[index] = beside.is_noise, beside.is_light
        flags += beside.flags
    return FlatVerdicts(levels=tuple(levels), wrong_noise=wrong_noise, wrong_light=wrong_light, flags=tuple(flags))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Beside:
    """One flat on both axes; `noise` is None where that is not judged."""

    level: LevelStatistics
    noise: PointInfluence | None
    row_of_noise: int
    light: Sequence[LightInfluence]
    row: int

    @property
    def worst_light(self) -> LightInfluence | None:
        """The light that a level is off by; where it is off by neither, the one that all follow best."""
        off = [one for one in self.light if one.points.outlying[self.row]]
        return next(iter(off or self.light), None)

    @property
    def by_noise(self) -> tuple[float, float] | None:
        return None if self.noise is None else _relative(self.noise, self.row_of_noise)

    @property
    def off_light(self) -> tuple[float, float] | None:
        worst = self.worst_light
        return None if worst is None else _relative(worst.points, self.row)

    @property
    def is_noise(self) -> bool:
        return self.noise is not None and bool(self.noise.outlying[self.row_of_noise])

    @property
    def is_light(self) -> bool:
        worst = self.worst_light
        return worst is not None and bool(worst.points.outlying[self.row])

    @property
    def influence(self) -> LevelInfluence:
        by_noise, off_light = self.by_noise, self.off_light
        cause = _cause(by_noise if self.is_noise else None, off_light if self.is_light else None)
        return LevelInfluence(
            variance_off=by_noise[0] if by_noise else None,
            variance_std_error=by_noise[1] if by_noise else None,
            mean_off=off_light[0] if off_light else None,
            mean_std_error=off_light[1] if off_light else None,
            cause=_UNCLEAR if cause is None and self.is_unclear and not self.is_shutter else cause,
        )

    @property
    def is_unclear(self) -> bool:
        return self.unclear_light is not None or self.is_unclear_noise

    @property
    def unclear_light(self) -> LightInfluence | None:
        """The light by which the level is off a curve that is as likely as the one that explains it."""
        rivals = ((one, one.points.rival) for one in sorted(self.light, key=lambda one: one.light))
        return next((one for one, rival in rivals if rival is not None and rival.outlying[self.row]), None)

    @property
    def is_unclear_noise(self) -> bool:
        rival = None if self.noise is None else self.noise.rival
        return rival is not None and bool(rival.outlying[self.row_of_noise])

    @property
    def is_shutter(self) -> bool:
        """Whether a fixed time that cameras usually have explains the level."""
        one = self.unclear_light
        if one is None or one.light != "exposure" or one.points.rival is None or self.level.exposure_s is None:
            return False
        late_s = _relative(one.points.rival, self.row)[0] * self.level.exposure_s
        return _has_offset(one.points, one.points.rival) and abs(late_s) < _USUAL_SHUTTER_S

    def unclear(self) -> str:
        """Return what the level is off by on the other curve, and what else it may be."""
        one = self.unclear_light
        if one is not None and one.points.rival is not None:
            off = _relative(one.points.rival, self.row)
            stated = self.level.exposure_s if one.light == "exposure" else self.level.photons
            fixed = _fixed_light(one.light, off[0] * (stated or 0.0))
            instead = _instead(one.points, one.points.rival, fixed)
            what = f"its mean is {percent_with_error(*off)} off the response to the {one.light} of the others"
            return f"{what}, or {instead}"
        if self.noise is None or self.noise.rival is None:
            return ""
        off = _relative(self.noise.rival, self.row_of_noise)
        instead = _instead(self.noise, self.noise.rival)
        return f"its temporal variance is {percent_with_error(*off)} off the curve of the others, or {instead}"

    @property
    def flags(self) -> list[Flag]:
        cause, worst, name = self.influence.cause, self.worst_light, describe_level(self.level)
        if cause == _UNCLEAR:
            what = f"{name}: {self.unclear()}: these frames do not tell which, and it stays in all numbers"
            return [Flag(name=_UNCLEAR, level=name, message=f"{what}: take it again, and more levels beside it")]
        if cause is not None:
            light = None if worst is None else worst.light
            return [_flag(cause, self.level, self.by_noise, self.off_light, light)]
        if self.is_unclear and self.is_shutter:
            what = f"{name}: {self.unclear()}: this level alone tells of it, and it stays in all numbers"
            return [
                Flag(name="exposure_offset", message=f"{what}; so short a time is usual: take more short exposures")
            ]
        return []


def _instead(points: PointInfluence, rival: PointInfluence, fixed: str = "") -> str:
    """Return what explains all levels where none of them is wrong."""
    found = [fixed] if fixed and _has_offset(points, rival) else []
    found += ["this curve bends more than usual"] if points.model.n_bends > rival.model.n_bends else []
    return ", or ".join(found) or "all levels scatter by more than their errors"


def _has_offset(points: PointInfluence, rival: PointInfluence) -> bool:
    """Return whether an offset of all levels is what a curve has and its rival has not."""
    best, other = points.model, rival.model
    if best.is_through_zero:
        return False
    return other.is_through_zero or (best.first_term_std is None and other.first_term_std is not None)


def _fixed_light(light: LightName, more: float) -> str:
    """Return what all levels have more or less of than is stated, if the one that is off by so much is right."""
    if light == "exposure":
        word = "longer" if more > 0.0 else "shorter"
        return f"all exposures are {word} than stated by {_MS_PER_S * abs(more):.2g} ms (a shutter, a readout)"
    word = "more" if more > 0.0 else "fewer"
    return f"all levels have {abs(more):.2g} photons {word} than stated (a shutter, stray light)"


def _relative(points: PointInfluence, row: int) -> tuple[float, float]:
    """Return how far a point is off the others and its error, relative to what the others have there."""
    expected = points.values[row] - points.deviation[row]
    return float(points.deviation[row] / expected), float(points.std_error[row] / abs(expected))


def _cause(noise: tuple[float, float] | None, light: tuple[float, float] | None) -> str | None:
    if noise is None or light is None:
        return "wrong_variance" if noise else "wrong_light" if light else None
    apart, error = abs(noise[0] - light[0]), float(np.hypot(noise[1], light[1]))
    alike = apart < max(_ALIKE_SIGMA * error, _ALIKE_SHARE * abs(light[0]))
    return "another_gain" if alike else "wrong_level"


def _flag(
    cause: str,
    level: LevelStatistics,
    noise: tuple[float, float] | None,
    light: tuple[float, float] | None,
    light_name: str | None,
) -> Flag:
    variance = "" if noise is None else f"{percent_with_error(noise[0], noise[1])}"
    mean = "" if light is None else f"{percent_with_error(light[0], light[1])}"
    messages = {
        "wrong_variance": f"its temporal variance is {variance} off the curve that all others follow against their "
        f"means: {_cause_of_variance(noise)}; it is left out of the gain: take it again",
        "wrong_light": f"its mean is {mean} off the response to the {light_name} that all others follow"
        + ("" if noise is None else f", while its noise fits its mean ({variance})")
        + f": what is stated of its {light_name} is wrong, or the lamp was another then; "
        + (
            "it is brighter than what the numbers are taken from, none of them has it"
            if noise is None
            else "it is left out of linearity and quantum efficiency, and stays in the gain"
        )
        + ": correct what is stated, or take it again",
        "another_gain": f"variance over mean is {variance}, mean over {light_name} {mean} off what all others "
        f"follow, by the same share: it was taken at another gain; it is left out of the gain and of linearity: take "
        f"it again",
        "wrong_level": f"its temporal variance is {variance} off its mean and its mean {mean} off its {light_name}: "
        f"other frames, another gain, or saturation; it is left out of the gain and of linearity: take it again",
    }
    name = describe_level(level)
    return Flag(name=cause, level=name, message=f"{name}: {messages[cause]}")


def _cause_of_variance(noise: tuple[float, float] | None) -> str:
    if noise is not None and noise[0] > 0.0:
        return "the light changed within its frames, or another gain"
    return "frames that repeat or were averaged, compression, another gain, or the onset of saturation"


# A photon-transfer curve from the levels that are sound, and what is wrong with the others


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedCurve:
    """The curve of the sound levels."""

    transfer: PhotonTransfer
    levels: tuple[LevelInfluence, ...]
    stability: LightStability
    flags: tuple[Flag, ...]


def sound_darks(darks: Sequence[LevelStatistics]) -> tuple[list[LevelStatistics], tuple[Flag, ...]]:
    """Return the dark levels that go together, and a flag for each that does not."""
    found = dark_influence(darks)
    if found is None:
        return list(darks), ()
    pairs = list(zip(darks, found, strict=True))
    return (
        [dark for dark, one in pairs if not one.outlying],
        tuple(_dark_flag(dark, one) for dark, one in pairs if one.outlying),
    )


def dark_step(darks: Sequence[LevelStatistics]) -> Step | None:
    """Return the largest step of the temporal variance of darks against their exposure, None if it is not known."""
    known = [dark for dark in darks if dark.exposure_s is not None and dark.temporal_variance_dn2 > 0.0]
    if len(known) < len(darks):
        return None
    known.sort(key=lambda dark: dark.exposure_s or 0.0)
    variance = np.array([dark.temporal_variance_dn2 for dark in known])
    if not known or np.median(variance) < QUANTISATION_LIMIT_DN2:
        return None
    relative = np.array([dark.temporal_std_error_dn2 / dark.temporal_variance_dn2 for dark in known])
    exposures = np.array([dark.exposure_s or 0.0 for dark in known])
    middle = np.full(len(known), float(np.median(variance)))
    design = np.column_stack([np.ones(len(known)), exposures])
    return largest_step(design, variance, np.square(relative * middle), shape=middle)


def _dark_flag(dark: LevelStatistics, found: DarkInfluence) -> Flag:
    name = describe_level(dark)
    cause = "light got in, or the sensor was warmer" if found.mean_off_dn > 0.0 else "it is of another exposure"
    return Flag(
        name="wrong_dark",
        level=name,
        message=f"{name}: its mean is "
        f"{number_with_error(found.mean_off_dn, found.mean_std_error_dn, sign='+')} DN and its temporal "
        f"variance "
        f"{number_with_error(found.variance_off_dn2, found.variance_std_error_dn2, sign='+')} DN^2 "
        f"off what all other darks "
        f"say of its exposure: {cause}, or its frames are others; it is left out: take it again",
    )


def judged_curve(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    dark: DarkSignal,
    match: DarkMatch,
    *,
    ceiling_dn: int,
) -> JudgedCurve:
    """Return the photon-transfer curve through the levels that all others confirm.

    A level that is off on an axis is left out of the fit on this axis, and of nothing else. Levels between the range of
    the fit and saturation are no part of any, but their light is judged.
    """
    points = transfer_points(flats, dark, match, ceiling_dn=ceiling_dn)
    full_dn = ceiling_dn - float(dark.means_dn.min())
    usable = usable_points(points, full_signal_dn=full_dn, light=stated_light(flats))
    mask = usable.mask
    stability = light_stability(_chosen(flats, mask), points.signal_dn[mask])
    of_darks = np.square(match.weights) @ mean_sampling_variance(darks)
    own_dn2 = np.where(points.signal_dn > 0.0, mean_variance_dn2(flats, points.signal_dn, stability), 0.0) + of_darks
    bend = beyond_range(points, usable, full_signal_dn=full_dn)
    verdicts, change = _judged(flats, points, own_dn2, bend=bend, mask=mask, by_dark=dark_step(darks))
    transfer = _fit(flats, points, usable, verdicts, own_dn2)
    if change is not None:
        transfer = replace(transfer, relative_gain_error_of_change=change.gain_error)
    return JudgedCurve(
        transfer=transfer,
        levels=_with_gain_shifts(verdicts.levels, transfer),
        stability=stability,
        flags=verdicts.flags,
    )


def _judged(
    flats: Sequence[LevelStatistics],
    points: TransferPoints,
    own_dn2: FloatArray,
    *,
    bend: FloatArray,
    mask: Mask,
    by_dark: Step | None,
) -> tuple[FlatVerdicts, GainChange | None]:
    """Return what is wrong with which flat, and a change of gain or lamp, after which no flat is judged by itself."""
    noise, light, lit = noise_influence(points, mask), _light(flats, points, mask, own_dn2), mask
    change = gain_change(noise, light[0] if light else None, by_dark=by_dark)
    if change is None and np.any(bend > 0.0):
        lit = mask | (bend > 0.0)
        light = _light(flats, points, lit, own_dn2 + np.square(bend * points.signal_dn))
        if is_large(by_dark) and light:
            # Too few levels may be left in the range of the fit behind a change that makes all of them brighter.
            change = gain_change(noise, light[0], by_dark=by_dark)
    if change is None:
        return flat_verdicts(flats, judged=mask, lit=lit, noise=noise, light=light), None
    # What is no smooth curve has no levels that stand off it.
    verdicts = flat_verdicts(flats, judged=mask, lit=mask, noise=None, light=())
    said = change_flag(change, _chosen(flats, lit))
    return replace(verdicts, wrong_light=mask, flags=(said,)), change


def _chosen(flats: Sequence[LevelStatistics], chosen: Mask) -> list[LevelStatistics]:
    return [flats[index] for index in np.flatnonzero(chosen).tolist()]


def _light(
    flats: Sequence[LevelStatistics], points: TransferPoints, chosen: Mask, own_dn2: FloatArray
) -> tuple[LightInfluence, ...]:
    return light_influence(_chosen(flats, chosen), points.signal_dn[chosen], own_dn2[chosen])


def _fit(
    flats: Sequence[LevelStatistics],
    points: TransferPoints,
    usable: UsablePoints,
    verdicts: FlatVerdicts,
    own_dn2: FloatArray,
) -> PhotonTransfer:
    return fit_photon_transfer(
        flats,
        points,
        usable=replace(usable, mask=usable.mask & ~verdicts.wrong_noise),
        mean_variance_dn2=own_dn2,
        wrong_light=verdicts.wrong_light,
    )


def _with_gain_shifts(levels: Sequence[LevelInfluence], transfer: PhotonTransfer) -> tuple[LevelInfluence, ...]:
    """Return the levels with what leaving each out of the gain does, in its standard errors, by the hat matrix."""
    shifts = transfer.gain_shifts / np.sqrt(transfer.fit.covariance[0, 0])
    found = list(levels)
    for row, index in enumerate(np.flatnonzero(transfer.used).tolist()):
        found[index] = replace(found[index], gain_shift_errors=float(shifts[row]))
    return tuple(found)
