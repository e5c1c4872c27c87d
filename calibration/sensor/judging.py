"""Wrong dark and flat levels, their causes, and the results that leave them out.

Each level is compared with a smooth curve through all other levels, on one axis after another:

=================  ===========================  ====================================
axis               values of the levels         against
=================  ===========================  ====================================
dark mean          mean of the darks            exposure
dark variance      temporal variance of darks   exposure or mean
variance           temporal variance of flats   mean
exposure           mean of the flats            stated exposure
photons            mean of the flats            stated photons
=================  ===========================  ====================================

A flat that is off in "variance" alone has other noise. If it is off in its light alone, its noise confirms its mean, so
the stated light is wrong. If it is off in both by the same share, it was taken at another gain: the mean goes with the
gain, the variance with its square.

A change of gain or lamp in the middle of a sweep is a step on the axes "variance" and "exposure" or "photons".

The probability that a sound set has any finding here is 0.6 %, divided among the axes and the step.
"""

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
    DarkSignal,
    LightStability,
    PhotonTransfer,
    TransferPoints,
    beyond_range,
    fit_photon_transfer,
    light_stability,
    mean_sampling_variance,
    transfer_points,
    usable_points,
    wander_variance_dn2,
    with_fitted_dark_variance,
)
from calibration.sensor.fits import CurveModel, PointInfluence, point_influence
from calibration.sensor.levels import (
    LevelStatistics,
    column,
    describe_level,
    pattern_variances,
)
from model.counts import least_variance, rounding_error_rms, variance_error_rms

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
_LightName = Literal["exposure", "photons"]
_Offset = tuple[float, float]  # relative deviation from the other levels, and its standard error

# Probability that a sound set has any finding, and the share of each axis and of a step.
_P_FALSE = 6e-3
_SHARES = {"dark mean": 1 / 12, "dark variance": 1 / 12, "variance": 1 / 6, "exposure": 1 / 4, "photons": 1 / 4}
_P_FALSE_STEP = _P_FALSE / 6
_LEAST_LEVELS = 5
# Polynomials of darks against exposure: most terms, least size of a term in errors of a level, and largest size of a
# term over the one before.
_MOST_TERMS, _LEAST_TERM, _NEXT_TERM = 6, 10.0, 0.5
_LEAST_VARIANCE_DN2, _LEAST_RELATIVE = 1e-9, 1e-6
# Usual offset of the exposures as a share of the longest: some microseconds in a sweep of ten milliseconds.
_USUAL_OFFSET = 3e-4
# Usual sizes of other terms, as shares of the brightest level: an offset, bends of the response and of the noise.
_OFFSET, _BEND_OF_RESPONSE, _BEND_OF_NOISE = 0.02, 0.1, 0.2
# Largest delay of shutters and readouts of usual cameras [s].
_USUAL_SHUTTER_S = 3e-6
# Least levels on either side of a step, degrees of freedom, and height.
_STEP_LEVELS, _STEP_FREEDOM, _LEAST_STEP, _STEP_SIGMA = 3, 3, 0.01, 3.0
# Largest chi-squared per degree of freedom about curve and step.
_EXPLAINED = 4.0
# Difference, in errors or relative, up to which deviations on both axes have one cause.
_ALIKE_SIGMA, _ALIKE_SHARE = 4.0, 0.25
_OFFSET_FLAG = "exposure_offset"
_MESSAGES = {
    "wrong_variance": "its temporal variance is {variance} off the curve of all others against their means: "
    "{reason}; it is left out of the gain: take it again",
    "wrong_light": "its mean is {mean} off the response of all others to the {light}{noise_fits}: its stated "
    "{light} is wrong, or the lamp changed; {left_out}: correct the statement, or take it again",
    "another_gain": "variance over mean is {variance}, mean over {light} {mean} off that of all others, by the same "
    "share: it was taken at another gain; it is left out of the gain and of linearity: take it again",
    "wrong_level": "its temporal variance is {variance} off its mean and its mean {mean} off its {light}: other "
    "frames, another gain, or saturation; it is left out of the gain and of linearity: take it again",
    "unclear_level": "its {doubt} of the others, or all levels bend, scatter or are late by more than usual: these "
    "frames cannot decide, and it stays in all numbers: take it again, with more levels near it",
    "exposure_offset": "its {doubt} of the others, or all exposures are {late} (a shutter, a readout), which is usual: "
    "only this level shows it, and it stays in all numbers: take more short exposures",
}


@dataclass(frozen=True, kw_only=True)
class LevelInfluence:
    """One flat compared with a curve through all others; None where it was not judged."""

    variance_off: float | None = None  #: deviation of the temporal variance, relative
    variance_std_error: float | None = None
    mean_off: float | None = None  #: deviation of the mean from the response to the light, relative
    mean_std_error: float | None = None
    gain_shift_errors: float | None = None  #: change of the gain without this level, in standard errors of the gain
    cause: str | None = None  #: name of the flag of this level; None for a sound level


def sound_darks(darks: Sequence[LevelStatistics]) -> tuple[list[LevelStatistics], tuple[Flag, ...]]:
    """Return the consistent dark levels, and a flag for each other.

    Means follow a polynomial of the exposure. Variances follow one too, or a straight line of the mean, because dark
    electrons add equally to both.
    """
    exposures = column(darks, "exposure_s")
    by_mean = _dark_means(darks, exposures) if len(darks) >= _LEAST_LEVELS else None
    by_variance = None if by_mean is None else _dark_variances(darks, exposures, by_mean)
    if by_mean is None or by_variance is None:
        return list(darks), ()
    wrong = by_mean.outlying | by_variance.outlying
    flags = tuple(_dark_flag(darks[row], row, by_mean, by_variance) for row in np.flatnonzero(wrong).tolist())
    return _chosen(darks, ~wrong), flags


def judged_curve(
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    dark: DarkSignal,
    weights: FloatArray,
    *,
    ceiling_dn: int,
) -> tuple[PhotonTransfer, tuple[LevelInfluence, ...], LightStability, tuple[Flag, ...]]:
    """Return the photon-transfer curve through the sound levels; flats by ascending mean.

    Also return the influence of each flat, the stability of the light and the flags of wrong levels. `weights` are
    those of `match_darks`. A level that is off on an axis is left out of the fits on this axis only. Levels between the
    range of the fit and saturation are in no fit, but their light is judged.
    """
    points = transfer_points(flats, dark, weights, ceiling_dn=ceiling_dn)
    full_dn = ceiling_dn - float(dark.means_dn.min())
    usable, saturation = usable_points(points, full_signal_dn=full_dn, light=_stated_light(flats))
    stability = light_stability(_chosen(flats, usable), points.signal_dn[usable])
    own_dn2 = np.square(weights) @ (mean_sampling_variance(darks) if darks else np.zeros(1))
    own_dn2 += np.where(points.signal_dn > 0.0, mean_variance_dn2(flats, points.signal_dn, stability), 0.0)
    bend = beyond_range(points, saturation_dn=saturation.signal_dn if saturation else full_dn)

    noise, lit, by_dark = _by_noise(points, usable, has_darks=bool(darks)), usable, _dark_step(darks)
    light = _by_light(flats, points, lit, own_dn2)
    change = _change(flats, lit, noise, light, by_dark)
    if change is None and np.any(bend > 0.0):
        lit = usable | (bend > 0.0)
        light = _by_light(flats, points, lit, own_dn2 + np.square(bend * points.signal_dn))
        if by_dark is not None and by_dark.is_large and light:
            # After a change to more light, too few levels may be left within the range of the fit.
            change = _change(flats, lit, noise, light, by_dark)
    if change is None:
        levels, wrong_noise, wrong_light, flags = _judged_levels(flats, usable, lit, noise, light)
    else:
        # Without a smooth curve no level is judged.
        levels, flags = [LevelInfluence() for _ in flats], [change[0]]
        wrong_noise, wrong_light = np.zeros_like(usable), usable
    transfer = fit_photon_transfer(
        flats,
        points,
        used=usable & ~wrong_noise,
        saturation=saturation,
        mean_variance_dn2=own_dn2,
        wrong_light=wrong_light,
    )
    if not darks:
        transfer = with_fitted_dark_variance(transfer)
    if change is not None:
        transfer = replace(transfer, relative_gain_error_of_change=change[1])
    # Changes of the gain without each level, from the hat matrix.
    shifts = transfer.gain_shifts / np.sqrt(transfer.fit.covariance[0, 0])
    for shift, index in zip(shifts, np.flatnonzero(transfer.used).tolist(), strict=True):
        levels[index] = replace(levels[index], gain_shift_errors=float(shift))
    return transfer, tuple(levels), stability, tuple(flags)


def is_lamp_sweep(flats: Sequence[LevelStatistics]) -> bool:
    """Return whether the lamp varied the light of flats, at one exposure or at unknown ones."""
    return len(flats) > 1 and len({flat.exposure_s for flat in flats}) <= max(1, len(flats) // 4)


def mean_variance_dn2(flats: Sequence[LevelStatistics], signal_dn: FloatArray, stability: LightStability) -> FloatArray:
    """Return the variance of flat means from pixel noise, rounding and unsteady light [DN^2]."""
    temporal = column(flats, "temporal_variance_dn2")
    spatial = pattern_variances(flats)
    rounding = rounding_error_rms(np.sqrt(least_variance(temporal, spatial) + spatial))
    of_frame = temporal / column(flats, "n_pixels") + wander_variance_dn2(flats, signal_dn, stability)
    variance: FloatArray = of_frame / column(flats, "n_frames") + np.square(rounding)
    return variance


def _chosen(levels: Sequence[LevelStatistics], chosen: Mask) -> list[LevelStatistics]:
    return [levels[index] for index in np.flatnonzero(chosen).tolist()]


def _stated_light(flats: Sequence[LevelStatistics]) -> FloatArray | None:
    """Return photons or exposures of the flats, None if neither is known for all or all are equal."""
    known = [light for light in (column(flats, "photons"), column(flats, "exposure_s")) if not np.isnan(light).any()]
    return next((light for light in known if len(np.unique(light)) > len(light) // 2), None)


def _on_axis(
    axis: str, models: Sequence[CurveModel], values: FloatArray, own: FloatArray, abscissa: FloatArray
) -> PointInfluence | None:
    """Compare each level with a curve through the others, at the false-alarm probability of the axis."""
    return point_influence(models, values, own, abscissa=abscissa, p_false=_P_FALSE * _SHARES[axis])


def _relative(points: PointInfluence, row: int) -> _Offset:
    """Return the deviation of a point from the others and its error, relative to the value of the others."""
    expected = points.values[row] - points.deviation[row]
    return float(points.deviation[row] / expected), float(points.std_error[row] / abs(expected))


def _dark_means(darks: Sequence[LevelStatistics], exposures: FloatArray) -> PointInfluence | None:
    means = column(darks, "mean_dn")
    # Jumping pixels may be left out of the mean of one level and not of the next.
    left_out_dn = np.array([np.mean(dark.frame_means_dn) for dark in darks]) - means
    own = mean_sampling_variance(darks) + np.square(left_out_dn)
    return _on_axis("dark mean", _dark_models(exposures, means, own), means, own, exposures)


def _dark_variances(
    darks: Sequence[LevelStatistics], exposures: FloatArray, by_mean: PointInfluence
) -> PointInfluence | None:
    temporal = column(darks, "temporal_variance_dn2")
    spatial = pattern_variances(darks)
    measured = np.maximum(temporal, _LEAST_VARIANCE_DN2)
    relative = np.maximum(column(darks, "temporal_std_error_dn2") / measured, _LEAST_RELATIVE)
    own = np.square(relative * np.maximum(_line_of_all(exposures, temporal), measured.min()))
    own += np.square(variance_error_rms(least_variance(temporal, spatial), spatial))
    models = _dark_models(exposures, temporal, own)
    means = by_mean.values - np.where(by_mean.outlying, by_mean.deviation, 0.0)
    if len(models) > 1 and np.ptp(means) > 0.0:
        along = (means - means.min()) / np.ptp(means)
        models.append(_curve(np.column_stack([np.ones(len(means)), along]), _sizes(exposures, temporal, own)))
    return _on_axis("dark variance", models, temporal, own, exposures)


def _dark_models(exposures: FloatArray, values: FloatArray, variance: FloatArray) -> list[CurveModel]:
    """Return the curves that darks may follow against their exposure."""
    if np.isnan(exposures).any() or np.ptp(exposures) == 0.0:
        return [CurveModel(design=np.ones((len(exposures), 1)), scatter_shape=np.ones(len(exposures)))]
    n_exposures = len(np.unique(exposures))
    n_terms = max(min(_MOST_TERMS, n_exposures // 2), min(4, n_exposures))
    # The largest value of a Chebyshev polynomial is 1, so its coefficient is its effect on the curve.
    scaled = 2.0 * (exposures - exposures.min()) / np.ptp(exposures) - 1.0
    powers, sizes = np.polynomial.chebyshev.chebvander(scaled, n_terms - 1), _sizes(exposures, values, variance)
    # The scatter of a sensor that warms up grows with the exposure.
    growing = CurveModel(
        design=powers[:, :2],
        scatter_shape=np.maximum(exposures / exposures.max(), 1e-3),
        term_sizes=sizes[:2],
        is_usual=False,
    )
    return [*(_curve(powers[:, :terms], sizes) for terms in range(1, n_terms + 1)), growing]


def _curve(design: FloatArray, sizes: FloatArray) -> CurveModel:
    return CurveModel(design=design, scatter_shape=np.ones(len(design)), term_sizes=sizes[: design.shape[1]])


def _sizes(exposures: FloatArray, values: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the largest plausible size of each term: that of the dark current, and smaller from term to term.

    The dark current of a warming sensor bends the means by many times their errors.
    """
    least = _LEAST_TERM * float(np.sqrt(np.median(variance)))
    first = max(float(np.ptp(_line_of_all(exposures, values))), least)
    sizes: FloatArray = np.maximum(first * _NEXT_TERM ** np.arange(-1.0, _MOST_TERMS - 1.0), least)
    sizes[0] = np.inf
    return sizes


def _line_of_all(exposures: FloatArray, values: FloatArray) -> FloatArray:
    """Return a rising line through the values by Theil and Sen; up to a quarter of wrong darks do not move it.

    Errors are taken from this line, because a variance that is low by chance would state too small an error, and so
    would a median over all levels at long exposures, where dark current dominates the noise.

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


def _dark_flag(dark: LevelStatistics, row: int, by_mean: PointInfluence, by_variance: PointInfluence) -> Flag:
    name, off = describe_level(dark), by_mean.deviation[row]
    mean, variance = (
        number_with_error(float(one.deviation[row]), float(one.std_error[row]), sign="+")
        for one in (by_mean, by_variance)
    )
    cause = "light got in, or the sensor was warmer" if off > 0.0 else "it is of another exposure"
    message = (
        f"{name}: its mean is {mean} DN and its temporal variance {variance} DN^2 off the values of all other darks "
        f"at its exposure: {cause}, or its frames show something else; it is left out: take it again"
    )
    return Flag(name="wrong_dark", level=name, message=message)


def _by_noise(points: TransferPoints, used: Mask, *, has_darks: bool) -> PointInfluence | None:
    """Compare each used point of the photon-transfer curve with a curve through the others.

    Without dark frames the variance at no signal is a term of the curve.
    """
    signal, variance = points.signal_dn[used], points.variance_dn2[used]
    gain = float(np.median(variance / signal))
    dark = float(np.median(points.flat_variance_dn2[used] - variance))
    relative = points.flat_std_error_dn2[used] / points.flat_variance_dn2[used]
    own = np.square(relative * np.maximum(dark + gain * signal, 0.0))
    own += np.diag(points.dark_covariance_dn4)[used] if has_darks else 0.0
    scaled, intercept = signal / signal.max(), () if has_darks else (0,)
    models = [
        CurveModel(
            design=np.column_stack([scaled**power for power in (*intercept, *powers)]),
            scatter_shape=signal,
            term_sizes=abs(gain) * signal.max() * np.where(np.less((*intercept, *powers), 2), np.inf, _BEND_OF_NOISE),
        )
        for powers in ((1,), (1, 2), (1, 2, 3))
    ]
    return _on_axis("variance", models, variance, own, signal)


def _by_light(
    flats: Sequence[LevelStatistics], points: TransferPoints, chosen: Mask, own_dn2: FloatArray
) -> list[tuple[_LightName, PointInfluence]]:
    """Compare the flats with their response to exposure and to photons, best fit first."""
    levels, signal_dn, own = _chosen(flats, chosen), points.signal_dn[chosen], own_dn2[chosen]
    lights: tuple[tuple[_LightName, str], ...] = (("exposure", "exposure_s"), ("photons", "photons"))
    found = [(name, _by_one_light(name, signal_dn, column(levels, field), own)) for name, field in lights]
    return sorted(((name, one) for name, one in found if one is not None), key=lambda pair: pair[1].cost)


def _by_one_light(
    name: _LightName, signal_dn: FloatArray, light: FloatArray, own_dn2: FloatArray
) -> PointInfluence | None:
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
    return _on_axis(name, [*models, *without_offset], signal_dn, own_dn2, light)


def _judged_levels(
    flats: Sequence[LevelStatistics],
    judged: Mask,
    lit: Mask,
    noise: PointInfluence | None,
    lights: Sequence[tuple[_LightName, PointInfluence]],
) -> tuple[list[LevelInfluence], Mask, Mask, list[Flag]]:
    """Return the influence of all flats, masks of those with wrong noise and with wrong light, and their flags."""
    levels, flags = [LevelInfluence() for _ in flats], []
    wrong_noise, wrong_light = np.zeros(len(flats), dtype=bool), np.zeros(len(flats), dtype=bool)
    row_of_noise = np.cumsum(judged) - 1
    for row, index in enumerate(np.flatnonzero(lit).tolist()):
        in_noise = None if noise is None or not judged[index] else (noise, int(row_of_noise[index]))
        off = [pair for pair in lights if pair[1].outlying[row]]
        light = next(iter(off or lights), None)
        variance_off = None if in_noise is None else _relative(*in_noise)
        mean_off = None if light is None else _relative(light[1], row)
        wrong_noise[index] = in_noise is not None and in_noise[0].outlying[in_noise[1]]
        wrong_light[index] = bool(off)
        cause = _cause(variance_off if wrong_noise[index] else None, mean_off if off else None)
        words = _words(variance_off, mean_off, None if light is None else light[0])
        if cause is None:
            cause, doubt = _doubt(flats[index], in_noise, [(name, points, row) for name, points in lights])
            words |= doubt
        if cause is not None:
            name = describe_level(flats[index])
            message = f"{name}: {_MESSAGES[cause].format(**words)}"
            # No level is wrong if a usual offset of all exposures explains it.
            flags.append(Flag(name=cause, level=None if cause == _OFFSET_FLAG else name, message=message))
        levels[index] = LevelInfluence(
            variance_off=variance_off and variance_off[0],
            variance_std_error=variance_off and variance_off[1],
            mean_off=mean_off and mean_off[0],
            mean_std_error=mean_off and mean_off[1],
            cause=None if cause == _OFFSET_FLAG else cause,
        )
    return levels, wrong_noise, wrong_light, flags


def _cause(variance_off: _Offset | None, mean_off: _Offset | None) -> str | None:
    """Return the flag for deviations that are significant."""
    if variance_off is None or mean_off is None:
        return "wrong_variance" if variance_off else "wrong_light" if mean_off else None
    difference, error = abs(variance_off[0] - mean_off[0]), float(np.hypot(variance_off[1], mean_off[1]))
    is_alike = difference < max(_ALIKE_SIGMA * error, _ALIKE_SHARE * abs(mean_off[0]))
    return "another_gain" if is_alike else "wrong_level"


def _doubt(
    level: LevelStatistics,
    noise: tuple[PointInfluence, int] | None,
    lights: Sequence[tuple[_LightName, PointInfluence, int]],
) -> tuple[str | None, dict[str, str]]:
    """Return the flag of a level that is off a curve as likely as the fitted one, and words for its message."""
    for name, points, row in sorted(lights, key=lambda one: one[0]):
        if points.rival is None or not points.rival.outlying[row]:
            continue
        off = _relative(points.rival, row)
        words = {"doubt": f"mean is {percent_with_error(*off)} off the response to the {name}"}
        late_s = off[0] * (level.exposure_s or 0.0)
        if name != "exposure" or abs(late_s) >= _USUAL_SHUTTER_S or not _adds_offset(points, points.rival):
            return "unclear_level", words
        longer = "longer" if late_s > 0.0 else "shorter"
        return _OFFSET_FLAG, words | {"late": f"{longer} than stated by {abs(late_s) * 1e3:.2g} ms"}
    if noise is not None and noise[0].rival is not None and noise[0].rival.outlying[noise[1]]:
        off = _relative(noise[0].rival, noise[1])
        return "unclear_level", {"doubt": f"temporal variance is {percent_with_error(*off)} off the curve"}
    return None, {}


def _adds_offset(points: PointInfluence, rival: PointInfluence) -> bool:
    """Return whether the fitted curve has a free offset that its rival lacks."""
    best, other = points.model, rival.model
    if best.is_through_zero:
        return False
    return other.is_through_zero or (best.first_term_std is None and other.first_term_std is not None)


def _words(variance_off: _Offset | None, mean_off: _Offset | None, light: _LightName | None) -> dict[str, str]:
    """Return the words that fill in the messages."""
    variance = "" if variance_off is None else percent_with_error(*variance_off)
    return {
        "variance": variance,
        "mean": "" if mean_off is None else percent_with_error(*mean_off),
        "light": str(light),
        "reason": "the light changed within its frames, or another gain"
        if variance_off is not None and variance_off[0] > 0.0
        else "frames that repeat or were averaged, compression, another gain, or the onset of saturation",
        "noise_fits": "" if variance_off is None else f", while its noise fits its mean ({variance})",
        "left_out": "it is too bright for the fits and affects no number"
        if variance_off is None
        else "it is left out of linearity and quantum efficiency, and stays in the gain",
    }


@dataclass(frozen=True, kw_only=True)
class _Step:
    """A step in points that otherwise follow a smooth curve."""

    place: int  #: first point behind the step
    relative: float  #: height over the shape of the step
    std_error: float
    is_real: bool

    @property
    def is_large(self) -> bool:
        """True if it is higher than a lamp or a bend causes."""
        return self.is_real and abs(self.relative) > _LEAST_STEP

    def __str__(self) -> str:
        return percent_with_error(self.relative, self.std_error)


def _change(
    flats: Sequence[LevelStatistics],
    lit: Mask,
    noise: PointInfluence | None,
    lights: Sequence[tuple[_LightName, PointInfluence]],
    by_dark: _Step | None,
) -> tuple[Flag, float] | None:
    """Return the flag of a change of gain or lamp within a sweep, and the relative error of the gain that it causes.

    Another gain changes mean over light and variance over mean by the same share, another light only the first. If the
    noise is too coarse to decide, the error of the gain is the whole change of the light.
    """
    light, levels = (lights[0][1] if lights else None), _chosen(flats, lit)
    by_noise, by_light = _step(noise, terms=2), _step(light, terms=3)
    if by_noise is not None and by_noise.is_large:
        # A gain also changes mean over light.
        at_step = _step(light, terms=3, place=by_noise.place)
        if at_step is None or not _differ(at_step, by_noise, float(np.hypot(at_step.std_error, by_noise.std_error))):
            return _gain_flag(levels, by_noise, by_noise, by_light, by_dark), abs(by_noise.relative)
    if by_light is None or not by_light.is_real or noise is None:
        return None
    at_step = _step(noise, terms=2, place=by_light.place)
    is_lamp = at_step is not None and _differ(at_step, by_light, at_step.std_error)
    error = 0.0 if is_lamp else abs(by_light.relative)
    is_large = at_step is not None and at_step.is_large
    if is_large or (by_dark is not None and by_dark.is_large and by_light.is_large):
        step = at_step if at_step is not None and is_large else by_light
        return _gain_flag(levels, step, at_step, by_light, by_dark), error
    return _light_flag(levels, by_light, at_step, is_lamp=error == 0.0), error


def _gain_flag(
    levels: Sequence[LevelStatistics], step: _Step, noise: _Step | None, light: _Step | None, dark: _Step | None
) -> Flag:
    found = [] if noise is None else [f"variance over mean changes by {noise}"]
    found += [] if light is None else [f"mean over light by {light}"]
    found += [f"the variance of darks by {dark}"] if dark is not None and dark.is_large else []
    message = (
        f"from {describe_level(levels[step.place])} on {', '.join(found)} in one step: the gain of the camera changed "
        "during the sweep, and there is no single gain: keep automatic gain off and take all levels again"
    )
    return Flag(name="gain_changed", message=message, refuses=True)


def _light_flag(levels: Sequence[LevelStatistics], light: _Step, noise: _Step | None, *, is_lamp: bool) -> Flag:
    verdict = (
        "the lamp changed; gain and noise stand, linearity is not known"
        if is_lamp
        else "lamp or gain changed, and the noise is too coarse to decide: the error of the gain includes this, "
        "linearity is not known; take larger frames or more of them, with automatic gain off"
    )
    of_noise = "" if noise is None else f"variance over mean changes by {noise}"
    message = (
        f"from {describe_level(levels[light.place])} on mean over light by {light} in one step ({of_noise}): {verdict}"
    )
    return Flag(name="light_or_gain_changed", message=message)


def _differ(one: _Step, other: _Step, error: float) -> bool:
    return abs(one.relative - other.relative) > _STEP_SIGMA * error


def _step(points: PointInfluence | None, *, terms: int, place: int | None = None) -> _Step | None:
    if points is None:
        return None
    scaled = points.abscissa / points.abscissa.max()
    design = np.column_stack([scaled**power for power in range(1, terms + 1)])
    # No step explains single wrong levels; the scatter is that of the others.
    variance = points.variance + np.square(points.scatter * points.model.scatter_shape)
    least = float(np.median(points.variance / variance))
    # Single faint points are noisy and would look like steps.
    shape = np.abs(points.abscissa * np.median(points.values / points.abscissa))
    return _largest_step(design, points.values, variance, shape=shape, least_share=least, place=place)


def _dark_step(darks: Sequence[LevelStatistics]) -> _Step | None:
    """Return the largest step of the temporal variance of darks against their exposure, None if it is not known."""
    known = [dark for dark in darks if dark.exposure_s is not None and dark.temporal_variance_dn2 > 0.0]
    if len(known) < len(darks):
        return None
    known.sort(key=lambda dark: dark.exposure_s or 0.0)
    variance, exposures = column(known, "temporal_variance_dn2"), column(known, "exposure_s")
    if not known or np.median(variance) < QUANTISATION_LIMIT_DN2:
        return None
    relative = column(known, "temporal_std_error_dn2") / variance
    middle = np.full(len(known), float(np.median(variance)))
    design = np.column_stack([np.ones(len(known)), exposures])
    return _largest_step(design, variance, np.square(relative * middle), shape=middle)


def _largest_step(
    design: FloatArray,
    values: FloatArray,
    variance: FloatArray,
    *,
    shape: FloatArray,
    least_share: float = 1.0,
    place: int | None = None,
) -> _Step | None:
    """Return the step that explains most of the deviations from a smooth curve; None with too few points.

    Each step is one more column of the linear model, so its reduction of chi-squared has a closed form. Errors follow
    from the scatter about curve and step, and are at least those of sampling.
    """
    n, n_terms = design.shape
    freedom = n - n_terms - 1
    places = range(_STEP_LEVELS, n - _STEP_LEVELS + 1) if place is None else range(place, place + 1)
    if freedom < _STEP_FREEDOM or not len(places) or places[-1] >= n:
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
    limit = -stdtrit(freedom, 0.5 * _P_FALSE_STEP / len(places))
    return _Step(
        place=places[best],
        relative=float(height[best]),
        std_error=error,
        is_real=bool(abs(height[best]) > limit * error and left < _EXPLAINED * freedom),
    )
