"""Fixed pattern of a sensor pixel by pixel: spectrograms, histograms and defects."""

import math
from dataclasses import dataclass
from enum import IntFlag

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from calibration.results import Flag
from calibration.sensor.curves import QUANTISATION_LIMIT_DN2
from calibration.sensor.levels import LevelPicture, LevelStatistics, some_pixels
from model.counts import hit_limit

# Outlying pixels: in the dark, in the light, or in their noise

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

# Chance of the limit of a hit, 6 standard deviations.
_CHANCE = 2e-9
_NEIGHBOURHOOD = 5
# Smaller deviations are rounding [DN].
_LEAST_DN = 1.0


class Defect(IntFlag):
    """Kinds of defect of a pixel; values of a defect map add up."""

    HOT = 1
    COLD = 2
    BRIGHT = 4
    WEAK = 8
    NOISY = 16
    JUMPING = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class DefectMap:
    """Which pixels are defect."""

    mask: NDArray[np.uint8]
    counts: dict[str, int]
    n_defect: int
    dark_limit_dn: float
    response_limit: float
    noise_limit_dn2: float


def _defect_map(dark: LevelPicture, flat: LevelPicture, *, n_dark_frames: int) -> DefectMap:
    """Return the pixels more than 6 standard deviations from the others.

    Hot and cold: by the dark mean; bright and weak: by the mean with light less dark. Both are compared with the median
    of the 5 x 5 pixels around, which removes uneven light, in standard deviations that defects do not widen. Noisy:
    temporal variance in the dark, compared with chi-squared for the degrees of freedom of consecutive differences.
    Jumping: a difference of two frames beyond 6 standard deviations, perhaps a cosmic hit. Less than one count is no
    defect. Longer stacks show smaller defects.

    Definition. EMVA Standard 1288, Release 4.0 Linear, leaves the limits to the application.
    """
    mask, counts = np.zeros(dark.mean_dn.shape, dtype=np.uint8), {}

    def mark(defect: Defect, where: NDArray[np.bool_]) -> None:
        mask[where] |= defect.value
        counts[str(defect.name).lower()] = int(np.count_nonzero(where))

    # One picture at a time, to save memory.
    deviation = _local_deviation(dark.mean_dn)
    dark_limit_dn = _limit(deviation, least=_LEAST_DN)
    mark(Defect.HOT, deviation > dark_limit_dn)
    mark(Defect.COLD, deviation < -dark_limit_dn)
    del deviation
    response = flat.mean_dn - dark.mean_dn
    signal_dn = max(float(np.median(some_pixels(response))), 1.0)
    response = _local_deviation(response)
    response /= np.float32(signal_dn)
    response_limit = _limit(response, least=_LEAST_DN / signal_dn)
    mark(Defect.BRIGHT, response > response_limit)
    mark(Defect.WEAK, response < -response_limit)
    del response
    noise_limit = _noise_limit(dark.temporal_variance_dn2, n_dark_frames)
    mark(Defect.NOISY, dark.temporal_variance_dn2 > noise_limit)
    mark(Defect.JUMPING, dark.outlier | flat.outlier)
    return DefectMap(
        mask=mask,
        counts=counts,
        n_defect=int(np.count_nonzero(mask)),
        dark_limit_dn=dark_limit_dn,
        response_limit=response_limit,
        noise_limit_dn2=noise_limit,
    )


def _local_deviation(picture: SingleArray) -> SingleArray:
    """Return each pixel less the median of the 5 x 5 pixels around it."""
    deviation: SingleArray = np.asarray(cv2.medianBlur(np.ascontiguousarray(picture), _NEIGHBOURHOOD), np.float32)
    np.subtract(picture, deviation, out=deviation)
    return deviation


def _limit(deviation: SingleArray, *, least: float) -> float:
    some = some_pixels(deviation)
    return max(hit_limit(some - np.median(some)), least)


def _noise_limit(variance_dn2: SingleArray, n_frames: int) -> float:
    """Return the variance that a pixel of median noise exceeds once in 5e8."""
    differences = n_frames - 1
    # Consecutive differences share frames: two of n - 1 have a covariance of a quarter of their variance.
    freedom = 2.0 * differences**2 / (3.0 * n_frames - 4.0)
    per_freedom = float(np.median(some_pixels(variance_dn2))) / float(chdtri(freedom, 0.5))
    # If rounding hides the noise, half of the pixels may never change; the others are not noisy.
    return max(per_freedom, QUANTISATION_LIMIT_DN2 / freedom) * float(chdtri(freedom, _CHANCE))


# Distribution of the pixels' own deviations, for a logarithmic histogram

_BINS = 256
_SIDE = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class PatternHistogram:
    """Counts of pixels by their deviation, and those of a normal law of the same width."""

    centres: FloatArray  #: (n,): middle of each bin, in the unit of the deviation
    counts: NDArray[np.int64]  #: (n,): pixels
    normal_counts: FloatArray  #: (n,): pixels by a normal law
    sigma: float  #: its standard deviation, from the quartiles

    @property
    def at_least(self) -> NDArray[np.int64]:
        """Pixels that deviate by at least each value of `reach`, to either side."""
        order = np.argsort(np.abs(self.centres))[::-1]
        found: NDArray[np.int64] = np.cumsum(self.counts[order])[::-1]
        return found

    @property
    def reach(self) -> FloatArray:
        """Absolute deviations in ascending order."""
        return np.sort(np.abs(self.centres))


def _pattern_histogram(picture: NDArray[np.float32], *, quantum: float) -> PatternHistogram:
    """Return the histogram of the deviations of pixels from the mean of the 5 x 5 pixels around them.

    EMVA Standard 1288, Release 4.0 Linear, histograms: high-pass of 5 x 5 pixels, 256 bins or fewer, logarithmic
    counts, and a normal law.
    """
    kernel = (_SIDE, _SIDE)
    # Corrects the deviation for the pixel itself, one of the 25.
    deviation: SingleArray = np.asarray(cv2.blur(picture, kernel), np.float32)
    np.subtract(picture, deviation, out=deviation)
    deviation *= np.float32(_SIDE**2 / (_SIDE**2 - 1.0))
    step = quantum / (_SIDE**2 - 1.0)
    low, high = float(deviation.min()) - 0.5 * step, float(deviation.max()) + 0.5 * step
    step *= np.ceil((high - low) / (_BINS * step))
    size = int((high - low) / step) + 1
    counts = cv2.calcHist([deviation], [0], None, [size], [low, low + size * step]).ravel()
    centres = low + step * (np.arange(size) + 0.5)
    quarter, middle, three_quarters = np.percentile(some_pixels(deviation), (25.0, 50.0, 75.0))
    # Quartiles of a normal law are 1.349 standard deviations apart.
    sigma = float(three_quarters - quarter) / 1.349
    density = np.exp(-0.5 * np.square((centres - middle) / sigma)) / (sigma * np.sqrt(2.0 * np.pi)) if sigma else 0.0
    return PatternHistogram(
        centres=centres,
        counts=counts.astype(np.int64),
        normal_counts=np.asarray(density * deviation.size * step * np.ones(len(centres))),
        sigma=sigma,
    )


# Spectrograms: the fixed pattern by spatial frequency, along rows and along columns

# Rows transformed at a time.
_ROWS_AT_A_TIME = 64
# Below this frequency a pattern is uneven light rather than periodic.
_LOWEST_PERIODIC_PER_PIXEL = 0.02
# Least share of the variance in a periodic pattern: this, and the share that chance gives one of few frequencies.
_LEAST_SHARE, _CHANCE_SHARE = 0.1, 10.0
_PEAK_SIGMA = 8.0
# Least lines for a spectrum; fewer scatter too much.
_LEAST_LINES = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrogram:
    """Amplitude of a picture by frequency; independent noise has its own deviation at each frequency."""

    frequency_per_pixel: FloatArray  #: (n,): above 0, up to 0.5 [1/pixel]
    amplitude: FloatArray  #: (n,): root of the mean power over all lines, in the unit of the picture
    n_lines: int  #: rows or columns averaged

    @property
    def median(self) -> float:
        """Median of the amplitude, which peaks do not change; 0 for lines of one pixel."""
        return float(np.median(self.amplitude)) if self.amplitude.size else 0.0

    def peak(self, *, variance: float) -> tuple[float, float] | None:
        """Return the frequency [1/pixel] with most of a fixed pattern's variance, and its share; None below a tenth.

        The power of random lines is exponentially distributed: the largest of 300 frequencies has 6 times the mean, 2 %
        of the variance. With few frequencies the limit is higher accordingly.
        """
        periodic = self.frequency_per_pixel >= _LOWEST_PERIODIC_PER_PIXEL
        if not periodic.any() or variance <= 0.0 or self.n_lines < _LEAST_LINES:
            return None
        n_frequencies, noise = len(self.amplitude), _PEAK_SIGMA * self.median**2 / np.sqrt(self.n_lines)
        power = np.square(self.amplitude[periodic]) - self.median**2
        largest = int(np.argmax(power))
        share = float(power[largest]) / (n_frequencies * variance)
        if share < _LEAST_SHARE + _CHANCE_SHARE / n_frequencies or power[largest] < noise:
            return None
        return float(self.frequency_per_pixel[periodic][largest]), share


def spectrogram(picture: SingleArray, *, along: int) -> Spectrogram:
    """Return the spectrogram of a picture along its rows (1) or columns (0).

    EMVA Standard 1288, Release 4.0 Linear, spectrograms: mean over lines of the squared Fourier amplitude over the
    length of a line.
    """
    lines = picture if along == 1 else picture.T
    mean, size = float(picture.mean(dtype=np.float64)), lines.shape[1]
    power = np.zeros(size // 2 + 1)
    for start in range(0, lines.shape[0], _ROWS_AT_A_TIME):
        block = np.fft.rfft(lines[start : start + _ROWS_AT_A_TIME] - mean, axis=1)
        power += np.square(np.abs(block)).sum(axis=0)
    return Spectrogram(
        frequency_per_pixel=np.arange(1, size // 2 + 1) / size,
        amplitude=np.sqrt(power[1:] / (size * lines.shape[0])),
        n_lines=lines.shape[0],
    )


# The fixed pattern of a sensor pixel by pixel: spectrograms, histograms, defects


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPattern:
    """Fixed pattern of two stacks."""

    dark: LevelPicture  #: the stacks themselves
    flat: LevelPicture
    n_dark_frames: int  #: frames of each
    n_flat_frames: int
    signal_dn: float  #: mean of the flat less that of the dark [DN]
    #: spatial variance of the dark mean [DN^2], and of flat less dark, relative; without temporal noise
    dark_variance_dn2: float
    response_variance: float
    dark_rows: Spectrogram  #: of the dark mean: horizontal and vertical frequencies [DN]
    dark_columns: Spectrogram
    response_rows: Spectrogram  #: of flat less dark, relative to the signal
    response_columns: Spectrogram
    #: of deviations from the neighbours, of the dark mean [DN] and of flat less dark, relative to the signal
    dark_histogram: PatternHistogram
    response_histogram: PatternHistogram
    defects: DefectMap  #: outlying pixels


def fixed_pattern(dark: LevelStatistics, flat: LevelStatistics) -> FixedPattern | None:
    """Return the fixed pattern of two levels of one exposure; None if either has no picture, or the flat no light."""
    signal_dn = flat.mean_dn - dark.mean_dn
    if dark.picture is None or flat.picture is None or signal_dn <= 0.0:
        return None
    response = (flat.picture.mean_dn - dark.picture.mean_dn) / np.float32(signal_dn)
    return FixedPattern(
        dark=dark.picture,
        flat=flat.picture,
        n_dark_frames=dark.n_frames,
        n_flat_frames=flat.n_frames,
        signal_dn=signal_dn,
        dark_variance_dn2=dark.spatial_variance_dn2,
        response_variance=(flat.spatial_variance_dn2 - dark.spatial_variance_dn2) / signal_dn**2,
        dark_rows=spectrogram(dark.picture.mean_dn, along=1),
        dark_columns=spectrogram(dark.picture.mean_dn, along=0),
        response_rows=spectrogram(response, along=1),
        response_columns=spectrogram(response, along=0),
        dark_histogram=_pattern_histogram(dark.picture.mean_dn, quantum=1.0 / dark.n_frames),
        response_histogram=_pattern_histogram(
            response, quantum=1.0 / math.lcm(dark.n_frames, flat.n_frames) / signal_dn
        ),
        defects=_defect_map(dark.picture, flat.picture, n_dark_frames=dark.n_frames),
    )


# Flags of the fixed pattern

_DEFECT_SHARE = 1e-3
_DEFECT_VARIANCE = 0.05
_LONG_STACK = 16


def pattern_flags(pattern: FixedPattern) -> tuple[Flag, ...]:
    """Return the flags of the fixed pattern."""
    found = (_periodic_pattern(pattern), _defect_pixels(pattern), _short_stack(pattern))
    return tuple(flag for flag in found if flag is not None)


def _periodic_pattern(pattern: FixedPattern) -> Flag | None:
    spectra = {
        "along dark rows": (pattern.dark_rows, pattern.dark_variance_dn2),
        "down dark columns": (pattern.dark_columns, pattern.dark_variance_dn2),
        "along rows with light": (pattern.response_rows, pattern.response_variance),
        "down columns with light": (pattern.response_columns, pattern.response_variance),
    }
    peaks = {
        name: peak
        for name, (spectrum, variance) in spectra.items()
        if (peak := spectrum.peak(variance=variance)) is not None
    }
    if not peaks:
        return None
    where = ", ".join(
        f"{name} at {frequency:.4g} cycles per pixel ({share:.0%} of its variance)"
        for name, (frequency, share) in peaks.items()
    )
    return Flag(
        name="periodic_pattern",
        message=f"the fixed pattern is periodic: {where}; DSNU or PRNU include this and describe single pixels less "
        "well: look for interference from supply or cables, several readout channels, or fringes of a window",
    )


def _defect_pixels(pattern: FixedPattern) -> Flag | None:
    share = pattern.defects.n_defect / pattern.defects.mask.size
    if share <= _DEFECT_SHARE:
        return None
    kinds = ", ".join(f"{count} {name}" for name, count in pattern.defects.counts.items() if count)
    return Flag(
        name="defect_pixels",
        message=f"{share:.2%} of the pixels are defective ({kinds}; more than {_DEFECT_SHARE:.1%}): the best DSNU and "
        "PRNU leave out pixels 6 standard deviations off, those of EMVA 1288 include all: use the defect map to keep "
        "them out of regions",
    )


def left_out_flags(dark: LevelStatistics, flat: LevelStatistics) -> tuple[Flag, ...]:
    """Return a flag if single pixels cause much of the fixed pattern."""
    shares = {
        name: 1.0 - level.ordinary.variance_dn2 / level.spatial_variance_dn2
        for name, level in (("dark", dark), ("flat", flat))
        if level.ordinary.left_out and level.spatial_variance_dn2 > 0.0
    }
    if not shares or max(shares.values()) < _DEFECT_VARIANCE:
        return ()
    counts = {"dark": dark.ordinary.left_out, "flat": flat.ordinary.left_out}
    where = " and ".join(
        f"{counts[name]} in the {name} stack ({share:.0%} of its variance)" for name, share in shares.items()
    )
    message = (
        f"single pixels are more than 6 standard deviations from all others: {where}: hot, dead or otherwise "
        "defective; the best DSNU and PRNU leave them out, those of EMVA 1288 include them: keep them out of regions "
        "with the map of --defects"
    )
    return (Flag(name="defect_pixels", message=message),)


def _short_stack(pattern: FixedPattern) -> Flag | None:
    if min(pattern.n_dark_frames, pattern.n_flat_frames) >= _LONG_STACK:
        return None
    return Flag(
        name="short_stack",
        message=f"the fixed pattern is from {pattern.n_flat_frames} flats and {pattern.n_dark_frames} darks, less than "
        f"the {_LONG_STACK} of EMVA 1288; defects and maps show temporal noise, DSNU and PRNU do not: take longer "
        "stacks at half of saturation and in the dark",
    )
