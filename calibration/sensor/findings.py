"""Findings that speak against a calibration: in frames, curves and results.

Each finding has a name and a message (`_MESSAGES`), and a check that compares one number with a limit and with its own
error. A finding that makes every result wrong refuses the set; all others are flags of the calibration.

Checks of frames need no fit. They look at the samples as integers (bits, ceiling, zeros, copies), at the light within
a level (flicker, mixed frames, shading), and at noise that pixels share (filters, compression, rows, stripes). Checks
of curves compare the dark signal, the photon-transfer curve and the response with what a linear sensor does.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate, number_with_error, percent_with_error
from calibration.results import Flag
from calibration.sensor.curves import (
    BEND_LEVELS,
    QUANTISATION_LIMIT_DN2,
    SATURATED_FRACTION,
    DarkSignal,
    PhotonTransfer,
    beyond_darks,
    brighter_fatter,
    is_saturated,
    sample_ceiling_dn,
)
from calibration.sensor.judging import is_lamp_sweep
from calibration.sensor.levels import LevelStatistics, column, describe_level, level_names

FloatArray = NDArray[np.float64]

_MESSAGES = {
    # Samples as integers.
    "left_justified": "all samples are multiples of {factor}, up to {largest}: they are shifted left by {bits} bits, "
    "which makes the gain {factor} times too large; divide them by {factor} and state the camera's own bit depth",
    "wrong_bit_depth": "{bits} bits are stated, but the largest sample is {largest}, {reason}: state the camera's own "
    "bit depth (these samples need at least {least} bits){instead}",
    "mixed_bit_depth": "most samples are {full_scale}, full scale of {bits} bits, in {levels}, while others reach "
    "{largest}: files were saved with different bit depths; save all frames with the camera's own",
    "low_ceiling": "samples pile up at {ceiling} DN, below the {full_scale} DN of {bits} bits; the camera saturates "
    "there (it subtracts its black level, or its firmware limits the counts), and the calibration uses this limit. "
    "Commands count pixels as saturated at full scale only: keep scenes below {ceiling} DN, or use `rigctl import "
    "--saturation-dn {ceiling}`",
    "clipped_black": "up to {share:.2%} of the samples of dark frames are 0 in {levels}; allowed is {limit:.1%}, "
    "because noise below zero is cut off: raise the camera's black level (offset) and take the frames again",
    "repeated_frames": "frames are exact copies of others ({count} of them), in {levels}; noise makes every frame "
    "differ, so the same buffer was saved twice or a file is listed twice; take these frames again",
    "saturated_levels": "more than {limit:.1%} of the samples are at the ceiling ({ceiling} DN) in {levels}; these "
    "levels show where saturation is and are left out of the gain",
    "saturated_dark": "more than {limit:.1%} of the samples of dark frames are at the ceiling ({ceiling} DN) in "
    "{levels}: light got in, or dark current fills the pixels; cover the lens, or take shorter dark exposures",
    "no_noise": "no pixel changes from frame to frame in {levels}; these are computed pictures, or copies of one "
    "frame: give raw frames",
    "missing_codes": "{share:.0%} of the values between others never occur: samples were multiplied or mapped after "
    "the converter (digital gain, gamma, a change of bits), so rounding noise exceeds 1/12 DN^2 and the gain is not "
    "the converter's: switch digital gain, gamma and tone mapping off, and save samples with the converter's bits "
    "(not stretched to 16)",
    # Light within and between levels.
    "darks_brighter_than_flats": "{brighter} of {darks} dark levels are brighter than the median flat ({middle:.4g} "
    "DN), such as {level}: dark and flat frames are mixed up, or the lens was open: check which is which",
    "mixed_level": "frames of one level differ by up to {worst:.1%} in their mean: {levels}; flicker causes at most "
    "{limit:.0%}, so exposure, gain or lamp differ: {advice}",
    "unsteady_level": "frames of one level differ by up to {worst:.1%} in their mean (more than {limit:.0%} and than "
    "noise): {levels}; black level and linearity may be wrong, the gain is not affected: let lamp and camera warm up",
    "lamp_flicker": "the light of flats varies by {wander:.2%} (rms) from frame to frame within a level, more than "
    "{limit:.2%} and than noise: means, linearity and quantum efficiency are less certain, the gain is not affected: "
    "use a steadier lamp",
    "outlier_pixels": "up to {share:.2g} of the pixels jump by more than 6 standard deviations between two frames of "
    "{levels} (cosmic hits, telegraph noise, defects); they are left out of these levels",
    "uneven_light": "{share:.0%} of the spatial variance of {level} is smooth across the picture (pixels alone cause "
    "at most {limit:.0%}): the lamp is uneven, or the lens shades. The best PRNU leaves this part out, that of EMVA "
    "1288 includes it: use an integrating sphere without lens",
    "non_monotonic_sweep": "the mean falls by more than {limit:.0%} although the exposure is longer: {where}; the "
    "light changed during the sweep, or a frame has another exposure than stated: check lamp and shutter",
    "light_not_constant": "the signal per exposure time differs by up to {off:.0%} between levels (a sensor causes at "
    "most {limit:.0%}): the light changed, automatic gain or exposure is on, or exposures are not as stated; "
    "linearity is not known, the gain is not affected by the light",
    # Noise that pixels or frames share.
    "correlated_noise": "the noise of neighbouring pixels is correlated by {across:+.3f} across and {down:+.3f} down "
    "(expected: at most {limit}): frames were filtered, interpolated from a colour mosaic, resized or compressed with "
    "loss (JPEG), and the gain is too small by about twice their sum: switch noise reduction and sharpening off, and "
    "save raw frames",
    "compressed_frames": "the noise of neighbouring pixels of dark frames is correlated by {across:+.2f} along rows "
    "and {down:+.2f} down columns (expected: at most {limit} each): frames were compressed with loss or filtered, and "
    "the noise is not the sensor's: save raw frames, without noise reduction",
    "readout_correlation": "the noise of neighbouring pixels is correlated by {across:+.3f} along rows and "
    "{down:+.3f} down columns in dark frames of the least dark current (expected: at most {limit} each) and not in "
    "bright flats: the readout couples neighbours, and frames were not filtered. Gain and noise of single pixels are "
    "right; the read noise of a mean over many pixels is {factor:.2f} times that of independent ones",
    "frames_go_together": "the noise of a pixel is correlated by {share:+.3f} from one frame to the next (expected: "
    "at most {limit}): the camera averages frames in time (noise reduction), so differences of frames show "
    "{shown:.0%} of the noise, and the gain is too small by the same factor: switch noise reduction off, and save raw "
    "frames",
    "colour_mosaic": "the four pixels of a 2 x 2 cell differ by {contrast:.0%} in their means in even light "
    "(expected: at most {limit:.0%}): the sensor has a mosaic of colour or polarization filters, and PRNU and "
    "saturation are those of the mixture: give the pixels of one colour (RAW files: --plane)",
    "row_noise": "pixels of a line share noise that changes from frame to frame ({sizes}) in {levels}: the read noise "
    "includes it, with too small a standard error, and dim scenes will show stripes: improve supply and shielding, or "
    "correct it with masked pixels",
    "banded_light": "{share:.1%} of the temporal noise of bright flats is common to whole rows or columns (expected: "
    "at most {limit:.0%}): a lamp on alternating current lights the rows of a rolling shutter unevenly, and the gain "
    "is too large by this share: use a lamp on direct current, or exposures of whole periods",
    # Photon-transfer curve and response.
    "not_photon_noise": "the temporal variance goes from {variance[0]:.4g} to {variance[1]:.4g} DN^2 while the signal "
    "goes from {signal[0]:.4g} to {signal[1]:.4g} DN; photon noise grows in proportion to the signal: switch gamma, "
    "tone mapping, noise reduction and compression off, and check kinds and exposures",
    "too_few_levels": "{used} of {all} flat levels can be used for the gain; fewer than {limit} show neither bend nor "
    "scatter of the photon-transfer curve, so the error for a nonlinear sensor is larger than stated: take at least "
    "10 levels between dark and 80 % of saturation",
    "saturation_not_reached": "the temporal variance does not rise and fall up to the brightest level "
    "({brightest:.4g} DN above dark), so saturation is not known: {more}, until most of the picture is saturated",
    "bent_photon_transfer": "at {top:.4g} DN the photon-transfer curve is {bend:+.1%} off its slope at zero signal "
    "(more than {limit:.0%} and than noise): {cause}; the stated gain is the one at zero signal, and noise predicted "
    "for bright scenes is off by the same share",
    "scattered_photon_transfer": "the points scatter by {scatter:.1%} about the photon-transfer curve, more than "
    "sampling explains (chi-squared {chi2:.3g} per degree of freedom); the standard errors include this: to improve "
    "the gain, add exposures rather than frames at each",
    "response_not_linear": "at {top:.4g} DN the mean is {off} off its slope at zero signal (more than {limit:.0%}), "
    "and so are radiances of bright scenes; the calibration contains the response: keep scenes below {linear_dn:.0f} "
    "DN",
    "unsteady_lamp": "the means of the levels scatter by {scatter:.1%} about a smooth response to the {light} (more "
    "than {limit:.0%}): the lamp flickers or drifts between levels, or exposures are not exact. The gain is right, "
    "with a larger error because the response is less certain: let the lamp warm up",
    # Dark signal.
    "no_darks": "there are no dark frames: gain and linearity rest on the stated black level of {black} DN; read "
    "noise, dark current and differences between pixels are not determined: take at least two dark frames at each "
    "exposure",
    "dark_exposure_missing": "there are no dark frames around the exposure of {levels}; the nearest ones are used, "
    "and the difference in dark current counts as signal: take dark frames at the exposures of the flats, or at the "
    "shortest and the longest",
    "single_dark_exposure": "dark frames have one exposure, or exposures are not known: the dark current is not "
    "known, and that of this exposure counts as black level and read noise; take dark frames at two or more "
    "exposures, the longest as long as possible",
    "dark_current_changed": "the mean of dark frames does not grow in proportion to exposure ({bend} DN/s^2): the "
    "temperature of the sensor changed, or light got in. The dark current is not known; black level and read noise "
    "are from a curve: let the camera warm up for half an hour, and take the dark frames in mixed order",
    "quantisation_limited": "the temporal noise of dark frames is below {limit:.2f} DN, where rounding to whole "
    "counts hides it: the read noise is below {limit_e:.3g} e-; raise the camera's gain to measure it",
    "black_clamp": "the mean of dark frames grows by {by_mean:.4g} DN/s with exposure, their variance gives "
    "{by_variance:.4g} DN/s (difference more than {limit:.0f} standard errors): the camera subtracts dark signal "
    "itself, or dark frames were not dark; the stated dark current is that of the mean",
    # Results, and the unit of exposures.
    "wrong_time_unit": "the longest exposure is {longest:.3g} s, and {problem}: {advice}",
    "dark_current_not_resolved": "dark exposures up to {longest:.3g} s are too short to show the dark current of any "
    "camera: take dark frames of 1 s or more",
    "unusual_dark_current": "the dark current is {size}: for any other camera the exposures are {true} than stated, "
    "because of a wrong unit: {advice}",
    "negative_dark_current": "the dark mean falls with exposure, by {rate} e-/s: the camera subtracts more than its "
    "dark signal, its black level drifts, or exposures are mixed up; see the dark current by variance",
    "quantum_efficiency_above_one": "there are {efficiency} electrons per photon; at most one is possible: the "
    "photons are not those of one pixel and one exposure, or irradiance or pixel area are wrong",
}

# Significance: a number over its standard error.
_SIGMA, _BEND_SIGMA, _LEFT_SIGMA = 5.0, 3.0, 2.0
# Limit of EMVA 1288 for zeros in a dark frame, whose noise is otherwise cut off.
_ZERO_SHARE = 0.005
_PILED_SHARE = 0.5
_EIGHT_BITS = 255
_MISSING_CODES, _STRETCHED = 0.05, 0.5
# Relative spread of frame means: of an unsteady level, and of a mixed one.
_UNSTEADY, _MIXED = 0.01, 0.1
# Difference of frame means due to coarse rounding alone.
_ROUNDING_DN = 0.3
# A level is mixed only if its spread is this many times that of the other flats; otherwise all flicker. If fewer than
# the second share of the flats are steady, all are mixed.
_USUAL_SPREAD, _STEADY_SHARE = 8.0, 0.1
_FLICKER = 0.0015
_OUTLIER_SHARE = 1e-5
_UNEVEN_SHARE = 0.25
_NOT_PROPORTIONAL, _LEAST_LEVELS = 0.1, 5
# Share of the brightest signal above which light rather than black level dominates.
_LIT, _BRIGHT = 0.2, 0.25
# Spreading charge correlates the noise of neighbours by at most a per cent.
_CORRELATION, _FILTERED = 0.02, 0.1
# Dark noise comes from the amplifiers and is independent between neighbours.
_DARK_CORRELATION = 0.05
# Correlation in bright flats over that in darks if a filter causes both; scatter of equal darks over its error.
_SAME_AS_DARK, _ALIKE = 0.5, 0.4
# Lag of a detector leaves less than a per cent of a frame in the next.
_LAG, _STEADY = 0.03, 0.05
# Two readout channels differ by one or two per cent, pixels behind colour filters by tens.
_MOSAIC, _COLOURS = 0.03, 0.1
_SHARED_VARIANCE, _BANDED = 0.05, 0.01
# Relative departure of the photon-transfer curve from its first slope: impossible for photon noise, and worth a flag.
_NO_LINE, _BEND = 0.3, 0.02
# Growth of the mean beyond saturation; a variance that falls while the mean grows more shows a tone curve.
_BEYOND_SATURATION = 1.5
_SCATTER, _SCATTER_CHI2_PER_DOF = 0.005, 3.0
_NOT_LINEAR, _LAMP = 0.01, 0.01
# Least share of the brightest signal for stating the gain of a level.
_LEAST_SIGNAL = 0.05
# Range of the longest exposure of a sweep [s], and its least value for usual cameras.
_SHORTEST_S, _LONGEST_S, _USUAL_S = 1e-6, 3600.0, 5e-5
# Dark current [e-/s]: impossible for visible light (warm cameras have tens to thousands), of cooled sensors, and of hot
# or infrared ones.
_ABSURD_E_PER_S, _COOLED_E_PER_S, _HOT_E_PER_S = 1e5, 0.1, 5e3
# Units of `--exposure-unit`: seconds in each, and names.
_UNITS = {
    "ns": (1e-9, "nanoseconds"),
    "us": (1e-6, "microseconds"),
    "ms": (1e-3, "milliseconds"),
    "s": (1.0, "seconds"),
}


@dataclass(frozen=True, kw_only=True)
class StatedExposures:
    """Place where exposures are stated, and their assumed unit."""

    where: str = "what was given"  #: such as "the column exposure_ms"
    unit: str | None = None  #: ns, us, ms or s; None if they differ
    has_option: bool = True  #: whether --exposure-unit can state another unit


_ANYWHERE = StatedExposures()


def frame_flags(
    levels: Sequence[LevelStatistics],
    *,
    bit_depth: int,
    black_level_dn: Estimate | None = None,
    stated: StatedExposures = _ANYWHERE,
) -> tuple[Flag, ...]:
    """Return the findings in the dark and flat levels; at least one of each, or flats and a black level.

    Differences of frames with unequal light include the fixed pattern, which looks like flicker, bands and correlated
    noise: a level that is refused for its light is left out of the checks of light and noise.
    """
    frames = _Frames(levels=levels, bit_depth=bit_depth, black_level_dn=black_level_dn)
    of_samples: tuple[Callable[[_Frames], Flag | None], ...] = (
        _left_justified,
        _wrong_bit_depth,
        _mixed_bit_depth,
        _low_ceiling,
        _clipped_black,
        _repeated_frames,
        _saturated_levels,
        _saturated_dark,
        _no_noise,
        _missing_codes,
        _darks_brighter_than_flats,
        _unsteady_level,
    )
    of_light: tuple[Callable[[_Frames], Flag | None], ...] = (
        _lamp_flicker,
        _outlier_pixels,
        _uneven_light,
        _correlated_noise,
        _compressed_frames,
        _frames_go_together,
        _colour_mosaic,
        _row_noise,
        _banded_light,
    )
    flags = _present(check(frames) for check in of_samples)
    mixed = _mixed_levels(frames)
    steady = [level for level in levels if not any(level is one for one in mixed)]
    if black_level_dn is not None:
        words = number_with_error(black_level_dn.value, black_level_dn.std_error)
        flags = (*flags, _flag("no_darks", black=words))
    flags = (*flags, *_present([_impossible_exposures(levels, stated)]))
    if {level.kind for level in steady} != {level.kind for level in levels}:
        return flags
    return (*flags, *_present(check(replace(frames, levels=steady)) for check in of_light))


def gain_doubts(
    levels: Sequence[LevelStatistics], transfer: PhotonTransfer, *, black_level_dn: Estimate
) -> dict[str, tuple[float, str]]:
    """Return the relative error of the gain due to each flag that states one, with words for it."""
    frames, found = _Frames(levels=levels, bit_depth=16, black_level_dn=black_level_dn), {}
    signal_dn = transfer.points.signal_dn[transfer.used]
    signal_dn = signal_dn[signal_dn >= _LEAST_SIGNAL * signal_dn.max()]
    gains = transfer.variance_at(signal_dn) / signal_dn
    ends = (f"{gains[end]:.4g} DN/e- at {signal_dn[end]:.3g} DN" for end in (0, -1))
    words = f"it depends on the level, {' and '.join(ends)} above dark"
    found["bent_photon_transfer"] = float(np.abs(gains / transfer.gain_dn_per_e - 1.0).max()), words
    if frames.bright_flats:
        across, down, _ = _correlation_of_flats(frames)
        found["correlated_noise"] = 2.0 * abs(across + down), "neighbours share noise"
        found["banded_light"] = abs(_banding(frames)[1]), "lines share light"
    lag = _lag(frames)
    if lag is not None:
        found["frames_go_together"] = 1.0 - (1.0 - lag[0]) / (1.0 + lag[0]), "the camera averages frames"
    return found


def curve_flags(
    levels: Sequence[LevelStatistics],
    flats: Sequence[LevelStatistics],
    darks: Sequence[LevelStatistics],
    transfer: PhotonTransfer,
    dark: DarkSignal,
    *,
    wrong: Sequence[LevelStatistics],
) -> tuple[Flag, ...]:
    """Return the findings in the curves through all levels; `wrong` are the flagged flats."""
    return _present(
        (
            _non_monotonic_sweep(levels, wrong),
            _light_not_constant(
                [level for level in levels if not any(level is one for one in wrong)], float(np.mean(dark.means_dn))
            ),
            _not_photon_noise(transfer),
            _too_few_levels(transfer),
            _saturation_not_reached(flats, transfer),
            _bent_photon_transfer(transfer),
            _scattered_photon_transfer(transfer),
            _response_not_linear(transfer),
            _unsteady_lamp(transfer),
            _dark_exposure_missing(flats, darks, transfer),
            _single_dark_exposure(dark) if darks else None,
            _dark_current_changed(dark),
            _quantisation_limited(transfer, dark),
            _black_clamp(transfer, dark),
        )
    )


def parameter_flags(
    *,
    dark_current_e_per_s: Estimate | None,
    quantum_efficiency: Estimate | None,
    stated: StatedExposures = _ANYWHERE,
) -> tuple[Flag, ...]:
    """Return the findings in impossible or unusual results."""
    current, efficiency, flags = dark_current_e_per_s, quantum_efficiency, []
    if current is not None and current.value <= -_SIGMA * current.std_error:
        flags.append(_flag("negative_dark_current", rate=number_with_error(-current.value, current.std_error)))
    if efficiency is not None and efficiency.value - _SIGMA * efficiency.std_error >= 1.0:
        words = number_with_error(efficiency.value, efficiency.std_error)
        flags.append(_flag("quantum_efficiency_above_one", efficiency=words))
    if current is not None:
        reach = _BEND_SIGMA * current.std_error
        most, least = max(current.value, 0.0) + reach, current.value - reach
        if most < _COOLED_E_PER_S and least > -_COOLED_E_PER_S:
            size = f"below {most:.2g} e-/s, as of cooled sensors, or of cameras that subtract their own dark signal"
            flags.append(_flag("unusual_dark_current", size=size, true="shorter", advice=_next_unit(stated, -1)))
        elif least > _HOT_E_PER_S:
            size = f"above {least:.2g} e-/s, as of hot or infrared sensors"
            flags.append(_flag("unusual_dark_current", size=size, true="longer", advice=_next_unit(stated, 1)))
    return tuple(flags)


def absurd_dark_current(
    levels: Sequence[LevelStatistics], dark_current_e_per_s: Estimate | None, *, stated: StatedExposures = _ANYWHERE
) -> Flag | None:
    """Return a flag if a dark current or its bound exceeds that of any camera for visible light."""
    current = dark_current_e_per_s
    if current is None or abs(current.value) + _BEND_SIGMA * current.std_error <= _ABSURD_E_PER_S:
        return None
    is_resolved, longest_s = current.value - _SIGMA * current.std_error > _ABSURD_E_PER_S, _longest_s(levels) or 0.0
    if not is_resolved and longest_s > _USUAL_S:
        darks_s = _longest_s([level for level in levels if level.kind == "dark"]) or 0.0
        return _flag("dark_current_not_resolved", longest=darks_s)
    size = (
        f"the dark signal grows faster than in any camera for visible light (more than {_ABSURD_E_PER_S:.0e} e-/s)"
        if is_resolved
        else "the dark current could be larger than in any camera"
    )
    light = ", or light reached the dark frames" if is_resolved else ""
    problem = (
        f"{size}: exposures are stated in another unit than {_as_read(stated)}{light}; the dark current is not known "
    )
    problem += "until the unit is"
    return _flag("wrong_time_unit", longest=longest_s, problem=problem, advice=_unit_advice(longest_s, stated))


def _flag(name: str, *, refuses: bool = False, **words: object) -> Flag:
    return Flag(name=name, message=_MESSAGES[name].format(**words), refuses=refuses)


def _present(flags: Iterable[Flag | None]) -> tuple[Flag, ...]:
    return tuple(flag for flag in flags if flag is not None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frames:
    """Levels as the checks of frames look at them."""

    levels: Sequence[LevelStatistics]
    bit_depth: int
    black_level_dn: Estimate | None  #: required without darks

    @cached_property
    def flats(self) -> list[LevelStatistics]:
        return [level for level in self.levels if level.kind == "flat"]

    @cached_property
    def darks(self) -> list[LevelStatistics]:
        return [level for level in self.levels if level.kind == "dark"]

    @cached_property
    def dark_dn(self) -> float:
        if self.darks or self.black_level_dn is None:
            return float(np.mean([dark.mean_dn for dark in self.darks]))
        return self.black_level_dn.value

    @cached_property
    def open_flats(self) -> list[LevelStatistics]:
        """Flats that are not saturated."""
        return _open(self.flats)

    @cached_property
    def bright_flats(self) -> list[LevelStatistics]:
        """Unsaturated flats with mostly photon noise."""
        limit_dn = _BRIGHT * max((flat.mean_dn - self.dark_dn for flat in self.open_flats), default=0.0)
        return [flat for flat in self.open_flats if flat.mean_dn - self.dark_dn >= limit_dn]

    @cached_property
    def largest_dn(self) -> int:
        return max(level.samples.max_dn for level in self.levels)

    @cached_property
    def ceiling_dn(self) -> int:
        return sample_ceiling_dn(self.levels, bit_depth=self.bit_depth)

    @cached_property
    def unused_low_bits(self) -> int:
        used = int(np.bitwise_or.reduce([level.samples.used_bits for level in self.levels]))
        return (used & -used).bit_length() - 1 if used else 0

    @cached_property
    def flats_of_fewer_bits(self) -> list[LevelStatistics]:
        """Flats with most samples at full scale of fewer bits than others."""
        return [
            flat
            for flat in self.flats
            if flat.samples.max_fraction > _PILED_SHARE
            and _EIGHT_BITS <= flat.samples.max_dn < self.largest_dn
            and flat.samples.max_dn & (flat.samples.max_dn + 1) == 0
        ]

    def saturated(self, levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
        return [level for level in levels if is_saturated(level, self.ceiling_dn)]


def _open(levels: Sequence[LevelStatistics]) -> list[LevelStatistics]:
    return [level for level in levels if level.samples.max_fraction < SATURATED_FRACTION]


def _left_justified(frames: _Frames) -> Flag | None:
    bits = frames.unused_low_bits
    if bits == 0:
        return None
    return _flag("left_justified", refuses=True, factor=2**bits, bits=bits, largest=frames.largest_dn)


def _wrong_bit_depth(frames: _Frames) -> Flag | None:
    full_scale, largest, least = 2**frames.bit_depth - 1, frames.largest_dn, frames.largest_dn.bit_length()
    if frames.unused_low_bits or full_scale // 4 < largest <= full_scale:
        return None
    piled = [v.samples for v in frames.levels if v.samples.max_dn == largest]
    is_full_scale = largest == 2**least - 1 and any(one.max_fraction > SATURATED_FRACTION for one in piled)
    is_larger, instead = largest > full_scale, ""
    if is_larger:
        reason = f"and {full_scale} is the largest possible value"
    elif is_full_scale:
        reason = "where samples pile up; saturated pixels would go unseen"
    else:
        reason = "less than a quarter of what they allow; saturated pixels would go unseen"
        instead = ", or take brighter flats"
    return _flag(
        "wrong_bit_depth",
        refuses=is_larger or is_full_scale,
        bits=frames.bit_depth,
        largest=largest,
        least=least,
        reason=reason,
        instead=instead,
    )


def _mixed_bit_depth(frames: _Frames) -> Flag | None:
    cut = frames.flats_of_fewer_bits
    if not cut:
        return None
    full_scale = cut[0].samples.max_dn
    words = {"full_scale": full_scale, "bits": full_scale.bit_length(), "largest": frames.largest_dn}
    return _flag("mixed_bit_depth", refuses=True, levels=level_names(cut), **words)


def _low_ceiling(frames: _Frames) -> Flag | None:
    full_scale, ceiling = 2**frames.bit_depth - 1, frames.ceiling_dn
    if not full_scale // 4 < ceiling < full_scale or frames.unused_low_bits:
        return None
    return _flag("low_ceiling", ceiling=ceiling, full_scale=full_scale, bits=frames.bit_depth)


def _clipped_black(frames: _Frames) -> Flag | None:
    clipped = [dark for dark in frames.darks if dark.samples.zero_fraction > _ZERO_SHARE]
    if not clipped:
        return None
    share = max(level.samples.zero_fraction for level in clipped)
    return _flag("clipped_black", refuses=True, share=share, levels=level_names(clipped), limit=_ZERO_SHARE)


def _rounding_hides_noise(level: LevelStatistics) -> bool:
    """Return whether pixels differ so little that rounding may make all frames equal."""
    return level.spatial_variance_dn2 + level.temporal_variance_dn2 < QUANTISATION_LIMIT_DN2


def _repeated_frames(frames: _Frames) -> Flag | None:
    # With most samples at one ceiling, or all noise hidden by rounding, two frames may be equal.
    varied = [v for v in frames.levels if v.samples.max_fraction < _PILED_SHARE and not _rounding_hides_noise(v)]
    counts = Counter(digest for level in varied for digest in level.samples.digests)
    repeated = {digest for digest, count in counts.items() if count > 1}
    if not repeated:
        return None
    touched = [level for level in varied if repeated.intersection(level.samples.digests)]
    count = sum(counts[digest] - 1 for digest in repeated)
    return _flag("repeated_frames", refuses=True, count=count, levels=level_names(touched))


def _saturated_levels(frames: _Frames) -> Flag | None:
    saturated = frames.saturated(frames.flats)
    if not saturated:
        return None
    names = level_names(saturated)
    return _flag("saturated_levels", limit=SATURATED_FRACTION, ceiling=frames.ceiling_dn, levels=names)


def _saturated_dark(frames: _Frames) -> Flag | None:
    saturated = frames.saturated(frames.darks)
    if not saturated:
        return None
    names = level_names(saturated)
    return _flag("saturated_dark", refuses=True, limit=SATURATED_FRACTION, ceiling=frames.ceiling_dn, levels=names)


def _no_noise(frames: _Frames) -> Flag | None:
    # Above the flat of largest noise the sensor saturates, perhaps at a value that varies with exposure.
    noisy = [flat for flat in frames.flats if flat.temporal_variance_dn2 > 0.0]
    peak_dn = max(noisy, key=lambda flat: flat.temporal_variance_dn2).mean_dn if noisy else np.inf
    explained = [*frames.flats_of_fewer_bits, *frames.saturated(frames.flats)]
    explained += [flat for flat in frames.flats if flat.mean_dn > peak_dn]
    explained += [dark for dark in frames.darks if _rounding_hides_noise(dark)]
    still = [level for level in frames.levels if level.temporal_variance_dn2 == 0.0]
    silent = [level for level in still if not any(level is one for one in explained)]
    return _flag("no_noise", refuses=True, levels=level_names(silent)) if silent else None


def _missing_codes(frames: _Frames) -> Flag | None:
    combed = [v.samples.missing_codes for v in frames.levels if v.samples.missing_codes > _MISSING_CODES]
    # A single level may lie in a gap of the converter.
    if len(combed) <= len(frames.levels) // 2 or frames.unused_low_bits:
        return None
    share = float(np.median(combed))
    return _flag("missing_codes", refuses=share > _STRETCHED, share=share)


def _darks_brighter_than_flats(frames: _Frames) -> Flag | None:
    middle_dn = float(np.median([flat.mean_dn for flat in frames.flats]))
    brighter = [dark for dark in frames.darks if dark.mean_dn > middle_dn]
    if len(brighter) <= len(frames.darks) // 2:
        return None
    words = {"brighter": len(brighter), "darks": len(frames.darks), "middle": middle_dn}
    return _flag("darks_brighter_than_flats", refuses=True, level=level_names(brighter[:1]), **words)


def _spread_dn(level: LevelStatistics) -> float:
    return max(level.frame_means_dn) - min(level.frame_means_dn)


def _relative_spread(level: LevelStatistics) -> float:
    """Return the relative spread of a level's frame means, 0 if noise or rounding explains it."""
    least_dn = max(_SIGMA * np.sqrt(level.temporal_variance_dn2 / level.n_pixels), _ROUNDING_DN)
    return _spread_dn(level) / level.mean_dn if _spread_dn(level) > least_dn else 0.0


def _mixed_levels(frames: _Frames) -> list[LevelStatistics]:
    """Return the levels that mix exposures, gains or lamp settings."""
    flats = [flat for flat in frames.open_flats if flat.mean_dn > frames.dark_dn]
    # The beat of a lamp does not affect exposures of whole periods, so if nearly all flats differ the light changed.
    spreads = [_spread_dn(flat) / (flat.mean_dn - frames.dark_dn) for flat in flats if _relative_spread(flat) > 0.0]
    if len(spreads) >= _LEAST_LEVELS and len(spreads) == len(flats) and np.quantile(spreads, _STEADY_SHARE) > _MIXED:
        return flats
    return [one for one in frames.levels if _relative_spread(one) > _MIXED and not _is_usual_spread(frames, one)]


def _unsteady_level(frames: _Frames) -> Flag | None:
    unsteady = [level for level in frames.levels if _relative_spread(level) > _UNSTEADY]
    if not unsteady:
        return None
    level = max(unsteady, key=_relative_spread)
    worst, names, mixed = _relative_spread(level), level_names(unsteady), _mixed_levels(frames)
    if not mixed:
        return _flag("unsteady_level", worst=worst, levels=names, limit=_UNSTEADY)
    worst, names = max(map(_relative_spread, mixed)), level_names(mixed)
    advice = "keep automatic exposure and gain off, and give frames of different light as different levels"
    if any(level.exposure_s is None for level in unsteady):
        advice = (
            "no exposure was recognised, so frames of all exposures count as one level: write it in the file names "
            "with its unit (flat_10ms_001.png, exp000522us), state that of bare numbers (exp000522) with "
            "--exposure-unit, or give a table (--table FILE.csv with the columns file, kind, exposure_ms)"
        )
    return _flag("mixed_level", refuses=True, worst=worst, levels=names, limit=_MIXED, advice=advice)


def _is_usual_spread(frames: _Frames, level: LevelStatistics) -> bool:
    """Return whether other flats vary by as many counts, as in the beat of a lamp on alternating current."""
    if level.kind == "dark" or len(frames.open_flats) < _LEAST_LEVELS:
        return False
    return _spread_dn(level) < _USUAL_SPREAD * float(np.median([_spread_dn(flat) for flat in frames.open_flats]))


def _lamp_flicker(frames: _Frames) -> Flag | None:
    if not frames.open_flats:
        return None
    # In very dark levels the black level drifts.
    limit_dn = _LIT * max(flat.mean_dn for flat in frames.open_flats)
    lit = [flat for flat in frames.open_flats if flat.mean_dn > limit_dn]
    noise = column(lit, "temporal_variance_dn2") / column(lit, "n_pixels")
    squares = np.square(column(lit, "mean_dn"))
    variance = float(np.mean((np.array([np.var(flat.frame_means_dn, ddof=1) for flat in lit]) - noise) / squares))
    if variance < _FLICKER**2 or variance < _SIGMA * float(np.mean(noise / squares)):
        return None
    return _flag("lamp_flicker", wander=np.sqrt(variance), limit=_FLICKER)


def _outlier_pixels(frames: _Frames) -> Flag | None:
    # Near saturation the few pixels that still change are no defects.
    shares = [
        (level, 1.0 - level.n_pixels / (level.shape[0] * level.shape[1]))
        for level in frames.levels
        if level.kind == "dark" or level.samples.max_fraction < SATURATED_FRACTION
    ]
    touched = [level for level, share in shares if share > _OUTLIER_SHARE]
    if not touched:
        return None
    return _flag("outlier_pixels", share=max(share for _, share in shares), levels=level_names(touched))


def _uneven_light(frames: _Frames) -> Flag | None:
    flats = [v for v in frames.flats if v.spatial_variance_dn2 > _SIGMA * v.spatial_std_error_dn2]
    if not flats:
        return None
    # The fixed pattern comes from the level with the most frames, the brightest of several.
    level = max(flats, key=lambda flat: (flat.n_frames, flat.spatial_variance_dn2))
    share = 1.0 - level.small_scale_variance_dn2 / level.spatial_variance_dn2
    if share < _UNEVEN_SHARE:
        return None
    return _flag("uneven_light", share=share, level=describe_level(level), limit=_UNEVEN_SHARE)


def _correlations(level: LevelStatistics) -> tuple[float, float]:
    """Return the correlation of neighbours across and down, without the part common to whole lines."""
    of, variance = level.shared, level.temporal_variance_dn2 or 1.0
    return of.horizontal - of.row_variance_dn2 / variance, of.vertical - of.column_variance_dn2 / variance


def _correlation_of_flats(frames: _Frames) -> tuple[float, float, float]:
    """Return the correlation of neighbours in bright flats across and down, and its error."""
    flats = frames.bright_flats
    across, down = (float(one) for one in np.mean([_correlations(flat) for flat in flats], axis=0))
    return across, down, float(np.mean([flat.shared.std_error for flat in flats])) / np.sqrt(len(flats))


def _correlated_noise(frames: _Frames) -> Flag | None:
    if not frames.bright_flats:
        return None
    across, down, error = _correlation_of_flats(frames)
    largest = max(abs(across), abs(down))
    if largest < _CORRELATION or largest < _SIGMA * error:
        return None
    return _flag("correlated_noise", refuses=largest > _FILTERED, across=across, down=down, limit=_CORRELATION)


def _compressed_frames(frames: _Frames) -> Flag | None:
    """Check the correlation of neighbours in dark noise. Filters and compression show in flats too, a readout not.

    A readout gives all darks the same covariance; dark current adds independent noise, which hides it in correlations.
    """
    darks = [dark for dark in frames.darks if dark.temporal_variance_dn2 > QUANTISATION_LIMIT_DN2]
    if not darks:
        return None
    variances = column(darks, "temporal_variance_dn2")
    together = np.array([_correlations(dark) for dark in darks]) * variances[:, None]
    errors = np.array([dark.shared.std_error for dark in darks]) * variances
    weights = errors**-2.0 / np.sum(errors**-2.0)
    # Of the noise of the darks with the least dark current.
    across, down = ((weights @ together) / variances.min()).tolist()
    error = float(np.sum(errors**-2.0) ** -0.5 / variances.min())
    larger = int(abs(down) > abs(across))
    size = (across, down)[larger]
    if abs(size) < max(_DARK_CORRELATION, _SIGMA * error):
        return None
    # Lossy compression removes a different share of the noise at each level. One level alone cannot show smoothing.
    apart = np.abs(together[:, larger] - weights @ together[:, larger])
    is_alike = bool(np.all(apart < np.maximum(_SIGMA * errors, _ALIKE * abs(size) * variances.min())))
    is_alike &= len(darks) > 1 or size < 0.0
    if frames.bright_flats:
        *flats, error = _correlation_of_flats(frames)
        if flats[larger] / size + _LEFT_SIGMA * error / abs(size) < _SAME_AS_DARK and is_alike:
            factor = float(np.sqrt(max(1.0 + 2.0 * (across + down), 0.0)))
            return _flag("readout_correlation", across=across, down=down, limit=_DARK_CORRELATION, factor=factor)
    return _flag("compressed_frames", refuses=True, across=across, down=down, limit=_DARK_CORRELATION)


def _lag(frames: _Frames) -> tuple[float, float] | None:
    """Return the share of noise carried from frame to frame, and its error; None without a stack."""
    # Rounding leaves noise in a few pixels only.
    noisy = [level for level in _open(frames.levels) if level.temporal_variance_dn2 > QUANTISATION_LIMIT_DN2]
    # Light that changes shows the response of each pixel in every difference.
    steady = [level for level in noisy if np.ptp(level.frame_means_dn[:3]) < _STEADY * level.mean_dn]
    stacks = [level.lag for level in steady if level.lag is not None]
    if not stacks:
        return None
    error = float(np.sqrt(np.sum([error**2 for _, error in stacks]))) / len(stacks)
    return float(np.mean([share for share, _ in stacks])), error


def _frames_go_together(frames: _Frames) -> Flag | None:
    share, error = _lag(frames) or (0.0, 0.0)
    if share < _LAG or share < _SIGMA * error:
        return None
    shown = (1.0 - share) / (1.0 + share)
    return _flag("frames_go_together", refuses=share > _FILTERED, share=share, shown=shown, limit=_LAG)


def _colour_mosaic(frames: _Frames) -> Flag | None:
    if not frames.bright_flats:
        return None
    flat = max(frames.bright_flats, key=lambda level: level.mean_dn)
    contrast = flat.mosaic_contrast * flat.mean_dn / (flat.mean_dn - frames.dark_dn)
    variance_dn2 = max(flat.spatial_variance_dn2, 0.0) + flat.temporal_variance_dn2 / flat.n_frames
    error = np.sqrt(variance_dn2 * 4.0 / flat.n_pixels) / flat.mean_dn
    if contrast < _MOSAIC or contrast < 2.0 * _SIGMA * error:
        return None
    return _flag("colour_mosaic", refuses=contrast > _COLOURS, contrast=contrast, limit=_MOSAIC)


def _line_variances(levels: Sequence[LevelStatistics]) -> FloatArray:
    """Return the variances that rows and columns share, shape (n, 2) [DN^2]."""
    return np.array([[v.shared.row_variance_dn2, v.shared.column_variance_dn2] for v in levels])


def _line_errors(levels: Sequence[LevelStatistics]) -> FloatArray:
    return np.array([[v.shared.row_std_error_dn2, v.shared.column_std_error_dn2] for v in levels])


def _row_noise(frames: _Frames) -> Flag | None:
    if not frames.darks:
        return None
    variances, errors = (np.mean(of(frames.darks), axis=0) for of in (_line_variances, _line_errors))
    total = float(np.mean([dark.temporal_variance_dn2 for dark in frames.darks]))
    sizes = [
        f"{np.sqrt(variance):.2g} DN by {line}"
        for line, variance, error in zip(("row", "column"), variances, errors, strict=True)
        if variance > _SIGMA * error and variance > _SHARED_VARIANCE * total
    ]
    return _flag("row_noise", sizes=", ".join(sizes), levels=level_names(frames.darks)) if sizes else None


def _banding(frames: _Frames) -> tuple[int, float, float]:
    """Return whether rows (0) or columns (1) of bright flats share more temporal noise, the share and its error."""
    flats = frames.bright_flats
    # Line noise in the dark has its own flag.
    in_dark = np.mean(_line_variances(frames.darks), axis=0) if frames.darks else np.zeros(2)
    noise = np.array([[flat.temporal_variance_dn2 or 1.0] for flat in flats])
    shares = np.mean((_line_variances(flats) - in_dark) / noise, axis=0)
    errors = np.mean(_line_errors(flats) / noise, axis=0) / np.sqrt(len(flats))
    worst = int(np.argmax(shares))
    return worst, float(shares[worst]), float(errors[worst])


def _banded_light(frames: _Frames) -> Flag | None:
    if not frames.bright_flats:
        return None
    _, share, error = _banding(frames)
    if share < _BANDED or share < _SIGMA * error:
        return None
    return _flag("banded_light", refuses=share > _FILTERED, share=share, limit=_BANDED)


def _non_monotonic_sweep(levels: Sequence[LevelStatistics], wrong: Sequence[LevelStatistics]) -> Flag | None:
    flats = [level for level in levels if level.kind == "flat" and level.exposure_s is not None]
    flats.sort(key=lambda level: (level.exposure_s or 0.0, level.mean_dn))
    drops = [
        after
        for before, after in pairwise(flats)
        if after.exposure_s != before.exposure_s and after.mean_dn < (1.0 - _UNSTEADY) * before.mean_dn
    ]
    if not drops:
        return None
    where, named = level_names(drops), wrong or [one for one in drops if _is_darker_than_neighbours(one, flats)]
    if wrong:
        where = f"this is due to {level_names(wrong)}, which the others do not confirm"
    message = _MESSAGES["non_monotonic_sweep"].format(limit=_UNSTEADY, where=where)
    return Flag(name="non_monotonic_sweep", level=describe_level(named[0]) if named else None, message=message)


def _is_darker_than_neighbours(level: LevelStatistics, flats: Sequence[LevelStatistics]) -> bool:
    """Return whether a flat has less than half the mean of the flat before, and that one less than half of the next."""
    place = next(index for index, one in enumerate(flats) if one is level)
    if not 0 < place < len(flats) - 1:
        return False
    before, after = flats[place - 1].mean_dn, flats[place + 1].mean_dn
    return level.mean_dn < 0.5 * before < 0.5 * after


def _light_not_constant(levels: Sequence[LevelStatistics], dark_dn: float) -> Flag | None:
    flats = _open([level for level in levels if level.kind == "flat"])
    # Above the flat of largest noise the sensor saturates.
    peak_dn = max(flats, key=lambda flat: flat.temporal_variance_dn2).mean_dn if flats else 0.0
    flats = [flat for flat in flats if flat.mean_dn <= peak_dn]
    exposures = column(flats, "exposure_s")
    if np.isnan(exposures).any() or len(np.unique(exposures)) < max(_LEAST_LEVELS, len(flats) // 2):
        return None
    signal = column(flats, "mean_dn") - dark_dn
    # The shortest exposures often differ from the stated ones by a fixed time, and include dark current.
    is_lit = signal > _LIT * signal.max()
    if signal.min() <= 0.0 or np.count_nonzero(is_lit) < _LEAST_LEVELS:
        return None
    rate = signal[is_lit] / exposures[is_lit]
    off = float(np.abs(rate / np.median(rate) - 1.0).max())
    return None if off < _NOT_PROPORTIONAL else _flag("light_not_constant", off=off, limit=_NOT_PROPORTIONAL)


def _bend(transfer: PhotonTransfer) -> tuple[float, float]:
    """Return the departure of the curve from its first slope at the brightest point of the fit, and its error."""
    top_dn, gain = transfer.top_dn, transfer.gain_dn_per_e
    gradient = top_dn ** np.arange(1, len(transfer.fit.parameters))
    error = float(np.sqrt(gradient @ transfer.fit.covariance[1:, 1:] @ gradient)) / gain
    return (transfer.bend + transfer.cubic * top_dn) * top_dn / gain, error


def _not_photon_noise(transfer: PhotonTransfer) -> Flag | None:
    bend, error = _bend(transfer)
    is_line = transfer.gain_dn_per_e > 0.0 and (abs(bend) < _NO_LINE or abs(bend) < _BEND_SIGMA * error)
    points, peak = transfer.points, transfer.saturation
    # The variance is largest far below the signal of other unsaturated levels.
    is_tone_curve = peak is not None and float(points.signal_dn[~points.saturated].max()) > (
        _BEYOND_SATURATION * points.signal_dn[peak.upper]
    )
    if is_line and not is_tone_curve:
        return None
    ends = np.flatnonzero(~points.saturated if is_line else transfer.used)[[0, -1]]
    words = {"variance": points.variance_dn2[ends].tolist(), "signal": points.signal_dn[ends].tolist()}
    return _flag("not_photon_noise", refuses=True, **words)


def _too_few_levels(transfer: PhotonTransfer) -> Flag | None:
    used = int(np.count_nonzero(transfer.used))
    if used >= BEND_LEVELS:
        return None
    return _flag("too_few_levels", used=used, all=len(transfer.used), limit=BEND_LEVELS)


def _saturation_not_reached(flats: Sequence[LevelStatistics], transfer: PhotonTransfer) -> Flag | None:
    if transfer.saturation is not None:
        return None
    more = "continue with a brighter lamp" if is_lamp_sweep(flats) else "add longer exposures"
    return _flag("saturation_not_reached", brightest=transfer.points.signal_dn.max(), more=more)


def _bent_photon_transfer(transfer: PhotonTransfer) -> Flag | None:
    bend, error = _bend(transfer)
    if abs(bend) < _BEND or abs(bend) < _BEND_SIGMA * error:
        return None
    cause = _cause_of_bend(transfer, rises=bend > 0.0)
    return _flag("bent_photon_transfer", top=transfer.top_dn, bend=bend, limit=_BEND, cause=cause)


def _cause_of_bend(transfer: PhotonTransfer, *, rises: bool) -> str:
    """Return the cause of the bend, from its direction and the response of the sensor."""
    spreading, curve = brighter_fatter(transfer), transfer.linearity
    if spreading is None or curve is None:
        # Charge that spreads between pixels can only lower the variance.
        return (
            "the response is not linear (digital corrections, gamma), or light or gain changed within levels"
            if rises
            else "the sensor is not linear, or charge spreads between pixels"
        )
    found = f"mean against {curve.light} is {curve.departure(transfer.top_dn):+.2%} off its line there"
    left = percent_with_error(*spreading)
    if abs(spreading[0]) < _LEFT_SIGMA * spreading[1]:
        return f"{found}, and the remainder ({left}) is within its error"
    if spreading[0] > 0.0:
        return f"{found}; spreading charge cannot cause the remaining {left}: another noise grows with the light"
    return f"{found}, and {left} remains for charge that spreads between pixels"


def _scattered_photon_transfer(transfer: PhotonTransfer) -> Flag | None:
    scatter, chi2 = transfer.fit.scatter / abs(transfer.gain_dn_per_e), transfer.fit.chi2_per_dof
    if chi2 is None or chi2 < _SCATTER_CHI2_PER_DOF or scatter < _SCATTER:
        return None
    return _flag("scattered_photon_transfer", scatter=scatter, chi2=chi2)


def _response_not_linear(transfer: PhotonTransfer) -> Flag | None:
    curve, top_dn = transfer.linearity, transfer.top_dn
    if curve is None:
        return None
    off = curve.departure(top_dn)
    gradient = np.array([top_dn, top_dn**2])
    error = float(np.sqrt(gradient @ curve.covariance @ gradient))
    if abs(off) < _NOT_LINEAR or abs(off) < _BEND_SIGMA * error:
        return None
    words, linear_dn = percent_with_error(off, error), _NOT_LINEAR / abs(off) * top_dn
    return _flag("response_not_linear", top=top_dn, off=words, limit=_NOT_LINEAR, linear_dn=linear_dn)


def _unsteady_lamp(transfer: PhotonTransfer) -> Flag | None:
    curve = transfer.linearity
    if curve is None or curve.relative_scatter < _LAMP:
        return None
    return _flag("unsteady_lamp", scatter=curve.relative_scatter, light=curve.light, limit=_LAMP)


def _dark_exposure_missing(
    flats: Sequence[LevelStatistics], darks: Sequence[LevelStatistics], transfer: PhotonTransfer
) -> Flag | None:
    beyond = [flats[index] for index in np.flatnonzero(transfer.used & beyond_darks(flats, darks)).tolist()]
    return _flag("dark_exposure_missing", levels=level_names(beyond)) if beyond else None


def _single_dark_exposure(dark: DarkSignal) -> Flag | None:
    return None if dark.has_slope or dark.is_curved else _flag("single_dark_exposure")


def _dark_current_changed(dark: DarkSignal) -> Flag | None:
    if not dark.is_curved:
        return None
    bend, error = float(dark.mean_fit.parameters[2]), float(np.sqrt(dark.mean_fit.covariance[2, 2]))
    return _flag("dark_current_changed", bend=number_with_error(bend, error, sign="+"))


def _quantisation_limited(transfer: PhotonTransfer, dark: DarkSignal) -> Flag | None:
    if not dark.quantisation_limited:
        return None
    limit_dn = np.sqrt(QUANTISATION_LIMIT_DN2)
    return _flag("quantisation_limited", limit=limit_dn, limit_e=limit_dn / abs(transfer.gain_dn_per_e))


def _black_clamp(transfer: PhotonTransfer, dark: DarkSignal) -> Flag | None:
    fit = dark.variance_fit
    if fit is None or not dark.has_slope:
        return None
    by_mean, by_variance = dark.mean_fit.parameters[1], fit.parameters[1] / transfer.gain_dn_per_e
    error = np.hypot(np.sqrt(dark.mean_fit.covariance[1, 1]), np.sqrt(fit.covariance[1, 1]) / transfer.gain_dn_per_e)
    if abs(by_mean - by_variance) < _SIGMA * error:
        return None
    return _flag("black_clamp", by_mean=by_mean, by_variance=by_variance, limit=_SIGMA)


# The unit of exposures


def _impossible_exposures(levels: Sequence[LevelStatistics], stated: StatedExposures) -> Flag | None:
    """Look at exposures that no camera's sweep has."""
    longest_s = _longest_s(levels)
    if longest_s is None or _SHORTEST_S <= longest_s <= _LONGEST_S:
        return None
    problem = f"no camera can take such a sweep: exposures are stated in another unit than {_as_read(stated)}"
    advice = _unit_advice(longest_s, stated)
    return _flag("wrong_time_unit", refuses=True, longest=longest_s, problem=problem, advice=advice)


def _longest_s(levels: Sequence[LevelStatistics]) -> float | None:
    return max((level.exposure_s for level in levels if level.exposure_s is not None), default=None)


def _as_read(stated: StatedExposures) -> str:
    """Return the unit that exposures were read in, in words."""
    if stated.unit is None:
        return f"was read from {stated.where}"
    return f"the {_UNITS[stated.unit][1]} that were read from {stated.where}"


def _next_unit(stated: StatedExposures, step: int) -> str:
    """Return how to state the next larger or smaller unit."""
    units = list(_UNITS)
    place = -1 if stated.unit is None else units.index(stated.unit) + step
    if not stated.has_option or (stated.unit is not None and place not in range(len(units))):
        return f"correct {stated.where}"
    if stated.unit is None:
        return f"look at {stated.where}, or state it with --exposure-unit"
    return f"if {stated.where} has {_UNITS[units[place]][1]}, state the unit with --exposure-unit {units[place]}"


def _unit_advice(longest_s: float, stated: StatedExposures) -> str:
    if not stated.has_option:
        return f"correct {stated.where}"
    others = [unit for unit in _UNITS if unit != stated.unit]
    likely = _likely_unit(longest_s, stated.unit)
    if stated.unit is None or likely is None:
        return f"state its unit with --exposure-unit {', '.join(others[:-1])} or {others[-1]}"
    seconds, name = _UNITS[likely]
    in_it_s = longest_s * seconds / _UNITS[stated.unit][0]
    return (
        f"if {stated.where} has {name}, it is {in_it_s:.3g} s, as usual: state the unit with --exposure-unit {likely}"
    )


def _likely_unit(longest_s: float, unit: str | None) -> str | None:
    """Return the nearest unit in which unusual exposures are usual; None if none or two are possible."""
    if unit is None or _USUAL_S <= longest_s <= _LONGEST_S:
        return None
    own_s = _UNITS[unit][0]
    factors = {name: seconds / own_s for name, (seconds, _) in _UNITS.items()}
    by_nearness = sorted(factors, key=lambda name: max(factors[name], 1.0 / factors[name]))
    return next((name for name in by_nearness if _USUAL_S <= longest_s * factors[name] <= _LONGEST_S), None)
