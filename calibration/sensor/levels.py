"""Statistics of one level of light or darkness, in one pass over its frames."""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.results import CalibrationError

# Errors that rounding to whole counts leaves in means and variances whose noise hardly dithers it

FloatArray = NDArray[np.float64]

_HALVINGS = 30


def least_noise_dn2(variance_dn2: FloatArray, spatial_dn2: FloatArray) -> FloatArray:
    """Return the least noise in time before rounding that a measured variance may come of [DN^2].

    Noise that hardly dithers is seen larger by up to its rounding error, where the mean is half-way between two
    counts; taken at its face it would promise a dither that is not there. What is seen at most grows with the noise, so
    that halving an interval finds the root.
    """
    low, high = np.zeros_like(variance_dn2), np.maximum(variance_dn2, 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        seen = middle + 1.0 / 12.0 + np.sqrt(2.0) * variance_rounding_error_dn2(middle, spatial_dn2)
        low, high = np.where(seen < variance_dn2, middle, low), np.where(seen < variance_dn2, high, middle)
    return low


def mean_rounding_error_dn(noise_dn2: FloatArray) -> FloatArray:
    """Return the rms error that rounding leaves in a mean, over all places between two counts [DN].

    The first harmonic: exp(-2 pi^2 noise) sin(2 pi mean) / pi.

    Widrow and Kollar, Quantization Noise (2008), chapter 4.
    """
    error: FloatArray = np.exp(-2.0 * np.pi**2 * noise_dn2) / (np.pi * np.sqrt(2.0))
    return error


def variance_rounding_error_dn2(temporal_dn2: FloatArray, spatial_dn2: FloatArray) -> FloatArray:
    """Return the rms error that rounding leaves in a variance in time beyond 1/12 DN^2, over all places [DN^2].

    The first harmonic: (4 noise + 1 / pi^2) exp(-2 pi^2 noise) cos(2 pi mean).

    Widrow and Kollar, Quantization Noise (2008), chapter 4.
    """
    decay = np.exp(-2.0 * np.pi**2 * (temporal_dn2 + spatial_dn2))
    error: FloatArray = (4.0 * temporal_dn2 + 1.0 / np.pi**2) * decay / np.sqrt(2.0)
    return error


def spatial_rounding_error_dn2(temporal_dn2: FloatArray, spatial_dn2: FloatArray) -> FloatArray:
    """Return the rms error that rounding leaves in a variance from pixel to pixel, over all places [DN^2].

    Where rounding moves means by exp(-2 pi^2 noise) sin(2 pi mean) / pi, pixels that differ are pushed together or
    apart by its slope: twice the covariance of place and move, by Stein's lemma.
    """
    error: FloatArray = np.sqrt(8.0) * spatial_dn2 * np.exp(-2.0 * np.pi**2 * (temporal_dn2 + spatial_dn2))
    return error


# Temporal and spatial variance over the pixels of a level, and how well both are known

SingleArray = NDArray[np.float32]

_BLOCK_PIXELS = 49152


@dataclass(frozen=True, kw_only=True)
class VarianceMoments:
    """Means over pixels of temporal and spatial variance, and the covariance of their errors."""

    n_pixels: int
    temporal_dn2: float
    spatial_dn2: float
    temporal_error_dn4: float
    spatial_error_dn4: float
    covariance_dn4: float


def _variance_moments(square_sums: SingleArray, deviations: SingleArray, *, n_frames: int) -> VarianceMoments:
    """Return temporal and spatial variance of a level."""
    n = deviations.size
    sums = sum(starmap(_sums, _blocks(square_sums.ravel(), deviations.ravel())), np.zeros(5))
    # The mean of each takes one degree of freedom.
    correction = n / (n - 1)
    # Temporal and spatial variance of a pixel, by its squared differences and its squared deviation from the mean.
    weights = correction * np.array([[0.5 / (n_frames - 1), 0.0], [-0.5 / (n_frames - 1) / n_frames, 1.0]])
    means = sums[:2] / n
    scatter = (np.array([[sums[2], sums[3]], [sums[3], sums[4]]]) / n - np.outer(means, means)) / (n - 1)
    errors = weights @ scatter @ weights.T
    temporal, spatial = weights @ means
    return VarianceMoments(
        n_pixels=n,
        temporal_dn2=float(temporal),
        spatial_dn2=float(spatial),
        temporal_error_dn4=max(float(errors[0, 0]), 0.0),
        spatial_error_dn4=max(float(errors[1, 1]), 0.0),
        covariance_dn4=float(errors[0, 1]),
    )


def _blocks(square_sums: SingleArray, deviations: SingleArray) -> Iterator[tuple[SingleArray, SingleArray]]:
    """Yield both so few pixels at a time that they stay in the processor's cache, the deviations squared."""
    for start in range(0, deviations.size, _BLOCK_PIXELS):
        block = slice(start, start + _BLOCK_PIXELS)
        yield square_sums[block], np.square(deviations[block])


def _sums(temporal: SingleArray, spatial: SingleArray) -> FloatArray:
    """Return the sums of both, and of their products: of the first's square, of both, of the second's square."""
    # OpenCV adds in double precision, and without threads that would cost more than they save.
    of_temporal, of_spatial = cv2.norm(temporal, cv2.NORM_L2SQR), cv2.norm(spatial, cv2.NORM_L2SQR)
    of_difference = cv2.norm(temporal, spatial, cv2.NORM_L2SQR)
    return np.array(
        [
            cv2.sumElems(temporal)[0],
            cv2.sumElems(spatial)[0],
            of_temporal,
            0.5 * (of_temporal + of_spatial - of_difference),
            of_spatial,
        ]
    )


# Raw samples of a level as integers: range, zeros, unused bits, repeated frames

# As many pixels show it well enough.
_HISTOGRAM_PIXELS = 65536
# A value that its neighbours say should occur this often is missing by chance once in 1e10 (Poisson).
_LEAST_EXPECTED = 25.0
_NEIGHBOURS = 9
_ROWS_APART = 4


@dataclass(frozen=True, kw_only=True)
class SampleTally:
    """Integer facts over all frames of one level."""

    min_dn: int
    max_dn: int
    zero_fraction: float
    max_fraction: float
    used_bits: int
    missing_codes: float
    digests: tuple[tuple[int, int], ...]


class SampleCounter:
    """Builds a tally, frame by frame. Its memory grows by two numbers a frame."""

    def __init__(self) -> None:
        self._min_dn = np.iinfo(np.uint16).max
        self._max_dn = -1
        self._at_max = 0
        self._zeros = 0
        self._samples = 0
        self._used_bits = 0
        self._missing_codes: float | None = None
        self._digests: list[tuple[int, int]] = []

    def add(self, frame: NDArray[np.uint16]) -> None:
        """Take one frame into account."""
        low, high = int(frame.min()), int(frame.max())
        self._min_dn = min(self._min_dn, low)
        self._count_maximum(frame, high)
        if low == 0:
            self._zeros += frame.size - int(np.count_nonzero(frame))
        self._samples += frame.size
        self._used_bits |= int(np.bitwise_or.reduce(frame, axis=None))
        if self._missing_codes is None:
            self._missing_codes = _missing_codes(frame)
        if low < high:
            # Both together tell a million frames apart: the sum of a frame alone scatters over thousands.
            some_rows = np.ascontiguousarray(frame[::_ROWS_APART])
            self._digests.append((round(cv2.sumElems(frame)[0]), zlib.crc32(some_rows.data)))

    def _count_maximum(self, frame: NDArray[np.uint16], high: int) -> None:
        if high > self._max_dn:
            self._max_dn, self._at_max = high, 0
        if high == self._max_dn:
            self._at_max += int(np.count_nonzero(frame == high))

    def tally(self) -> SampleTally:
        """Return what has been counted; at least one frame must have been added."""
        return SampleTally(
            min_dn=self._min_dn,
            max_dn=self._max_dn,
            zero_fraction=self._zeros / self._samples,
            max_fraction=self._at_max / self._samples,
            used_bits=self._used_bits,
            missing_codes=self._missing_codes or 0.0,
            digests=tuple(self._digests),
        )


def _missing_codes(frame: NDArray[np.uint16]) -> float:
    low = int(frame.min())
    counts = np.bincount(frame.ravel()[:_HISTOGRAM_PIXELS] - low)
    if len(counts) < _NEIGHBOURS:
        return 0.0
    expected = np.convolve(counts, np.full(_NEIGHBOURS, 1.0 / _NEIGHBOURS), mode="same")
    filled = expected >= _LEAST_EXPECTED
    return float(np.count_nonzero(filled & (counts == 0))) / max(int(np.count_nonzero(filled)), 1)


# Row and column noise, and noise in time that neighbouring pixels share


# So many pixels, of the first rows, show it well enough.
_PIXELS = 98304


@dataclass(frozen=True, kw_only=True)
class RowColumnNoise:
    """From the difference of two frames, its mean taken off."""

    horizontal: float
    vertical: float
    std_error: float
    row_variance_dn2: float
    column_variance_dn2: float
    row_std_error_dn2: float
    column_std_error_dn2: float


def _row_column_noise(
    first: NDArray[np.uint16], second: NDArray[np.uint16], *, outlier: NDArray[np.bool_] | None
) -> RowColumnNoise:
    """Return what pixels share of the noise in time.

    A sensor's noise is independent from pixel to pixel. Neighbours share noise where a camera filters, interpolates
    colours or compresses, and where charge spreads; the gain of a photon-transfer curve is then wrong by as much.
    """
    shown = slice(max(2, _PIXELS // first.shape[1]))
    difference = np.subtract(second[shown], first[shown], dtype=np.float32)
    difference -= cv2.mean(difference)[0]
    if outlier is not None:
        difference[outlier[shown]] = 0.0
    rows, columns = difference.shape
    total = _product(difference, difference)
    variance_dn2 = 0.5 * total / difference.size
    of_rows = (
        0.5 * float(np.square(cv2.reduce(difference, 1, cv2.REDUCE_AVG, dtype=cv2.CV_64F)).mean())
        - variance_dn2 / columns
    )
    of_columns = (
        0.5 * float(np.square(cv2.reduce(difference, 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F)).mean()) - variance_dn2 / rows
    )
    return RowColumnNoise(
        horizontal=_product(difference[:, 1:], difference[:, :-1]) / total if total else 0.0,
        vertical=_product(difference[1:], difference[:-1]) / total if total else 0.0,
        std_error=float(1.0 / np.sqrt(difference.size)),
        row_variance_dn2=of_rows,
        column_variance_dn2=of_columns,
        row_std_error_dn2=float(variance_dn2 / columns * np.sqrt(2.0 / rows)),
        column_std_error_dn2=float(variance_dn2 / rows * np.sqrt(2.0 / columns)),
    )


def _product(one: SingleArray, other: SingleArray) -> float:
    # Not `@`: its threads cost more than they save.
    return float(np.einsum("ij,ij->i", one, other).sum(dtype=np.float64))


# Image lag: the part of a frame's noise that goes over into the next, as averaging in time leaves it behind

# A difference of two frames beyond this many standard deviations is no noise.
_OUTLIER_SIGMA = 6.0
_SIGMA_OF_MEDIAN = 1.4826


@dataclass(frozen=True, kw_only=True)
class ImageLag:
    """Correlation of a pixel's noise from one frame to the next."""

    share: float
    std_error: float


def _shown_rows(frame: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return the part of a frame that `_image_lag` looks at, as a copy."""
    return frame[: max(2, _PIXELS // frame.shape[1])].copy()


def _image_lag(first: NDArray[np.uint16], second: NDArray[np.uint16], third: NDArray[np.uint16]) -> ImageLag | None:
    """Return how much of the noise goes over from frame to frame, None where there is no noise.

    Two differences that follow one another share the middle frame: of independent frames their correlation is -1/2. A
    camera that mixes each frame with the one before, share a, has -(1 - a) / 2, and a variance that is smaller than
    the sensor's by (1 - a) / (1 + a); differences show only (1 - a)^2 / (1 - a^2) of it.
    """
    differences = [np.subtract(*pair, dtype=np.float32).ravel() for pair in ((second, first), (third, second))]
    for one in differences:
        one -= np.median(one)
    limits = [_OUTLIER_SIGMA * max(1.0, _SIGMA_OF_MEDIAN * float(np.median(np.abs(one)))) for one in differences]
    kept = (np.abs(differences[0]) < limits[0]) & (np.abs(differences[1]) < limits[1])
    before, after = (one[kept].astype(np.float64) - one[kept].mean() for one in differences)
    total = 0.5 * float(before @ before + after @ after)
    if total == 0.0:
        return None
    # Of three independent normal values: variance of twice the correlation of their differences.
    return ImageLag(
        share=1.0 + 2.0 * float(before @ after) / total, std_error=float(np.sqrt(3.0 / np.count_nonzero(kept)))
    )


# Sums over the frames of a level, pixel by pixel, as they come


# Rounding alone makes differences of this size: what is smaller is never called an outlier.
_ROUNDING_DIFFERENCE_VAR_DN2 = 0.5
_OUTLIER_PASSES = 5
# Sums of samples fit into 32 bits.
_MOST_FRAMES = 65536
_FRAMES_OF_LAG = 3


class FrameSums:
    """Sum of the samples, and of the squares of differences to the frame before."""

    def __init__(self, first: NDArray[np.uint16]) -> None:
        self.shape = (first.shape[0], first.shape[1])
        self.row_column: RowColumnNoise | None = None
        self.lag: ImageLag | None = None
        self._counter = SampleCounter()
        self._means: list[float] = []
        self._sum = first.astype(np.uint32)
        self._square_sum: SingleArray | None = None
        self._outlier: NDArray[np.bool_] | None = None
        self._previous = first
        self._first_rows = _shown_rows(first)
        self._count(first)

    def add(self, frame: NDArray[np.uint16]) -> None:
        """Take the next frame into account."""
        if frame.shape != self.shape:
            raise CalibrationError(
                f"frames of one level differ in size: {self.shape} and {frame.shape} (rows, columns); "
                f"all must be of one region of the sensor"
            )
        if len(self._means) == _MOST_FRAMES:
            raise CalibrationError(f"a level has more than {_MOST_FRAMES} frames; make several levels of them")
        self._sum += frame
        self._count(frame)
        self._add_difference(frame)
        if self.n_frames == _FRAMES_OF_LAG:
            self.lag = _image_lag(self._first_rows, _shown_rows(self._previous), _shown_rows(frame))
        self._previous = frame

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self._means)

    @property
    def frame_means_dn(self) -> tuple[float, ...]:
        """Mean of each frame, outliers too [DN]."""
        return tuple(self._means)

    @property
    def samples(self) -> SampleTally:
        """The samples as integers."""
        return self._counter.tally()

    def mean_dn(self) -> float:
        """Return the mean of all pixels without an outlier [DN]."""
        kept = self._sum if self._outlier is None else self._sum[~self._outlier]
        return int(kept.sum(dtype=np.uint64)) / (kept.size * self.n_frames)

    def kept(self, picture: SingleArray) -> SingleArray:
        """Return the pixels without an outlier."""
        return picture if self._outlier is None else picture[~self._outlier]

    def kept_mask(self) -> NDArray[np.bool_] | None:
        """Return which pixels had no outlier, None where none had one."""
        return None if self._outlier is None else ~self._outlier

    def squares(self) -> SingleArray:
        """Return the sum of the squared differences of each pixel [DN^2]."""
        return np.zeros(self.shape, dtype=np.float32) if self._square_sum is None else self._square_sum

    def deviations(self, mean_dn: float) -> SingleArray:
        """Return the mean of each pixel less that of all, 0 where there was an outlier [DN]."""
        picture: SingleArray = np.multiply(self._sum, 1.0 / self.n_frames, dtype=np.float32)
        picture -= mean_dn
        if self._outlier is not None:
            picture[self._outlier] = 0.0
        return picture

    def temporal_variance(self) -> SingleArray:
        """Return the temporal variance of each pixel, outliers too [DN^2]; the squares are then used up."""
        variance = self.squares()
        variance *= np.float32(0.5 / (self.n_frames - 1))
        return variance

    def outlier_mask(self) -> NDArray[np.bool_]:
        """Return which pixels had an outlier."""
        return np.zeros(self.shape, dtype=bool) if self._outlier is None else self._outlier

    def _count(self, frame: NDArray[np.uint16]) -> None:
        self._means.append(cv2.mean(frame)[0])
        self._counter.add(frame)

    def _add_difference(self, frame: NDArray[np.uint16]) -> None:
        square = np.empty(self.shape, dtype=np.float32)
        total, peak = self._square_deviation(frame, self._means[-1] - self._means[-2], out=square)
        outlier = _outliers(square) if peak > _outlier_limit(total / square.size) else None
        if outlier is not None:
            kept = ~outlier
            offset = float(frame[kept].mean()) - float(self._previous[kept].mean())
            self._square_deviation(frame, offset, out=square)
            self._outlier = outlier if self._outlier is None else self._outlier | outlier
        if self._square_sum is None:
            self._square_sum = square
            self.row_column = _row_column_noise(self._previous, frame, outlier=outlier)
        else:
            self._square_sum += square

    def _square_deviation(
        self, frame: NDArray[np.uint16], offset_dn: float, *, out: SingleArray
    ) -> tuple[float, float]:
        """Fill in the squares of the difference to the frame before, less its mean; return their sum and largest."""
        total = peak = 0.0
        for rows in _row_blocks(self.shape):
            block = out[rows]
            np.subtract(frame[rows], self._previous[rows], out=block, dtype=np.float32)
            block -= offset_dn
            np.square(block, out=block)
            total += cv2.sumElems(block)[0]
            peak = max(peak, float(block.max()))
        return total, peak


def _row_blocks(shape: tuple[int, int]) -> Iterator[slice]:
    """Yield slices of rows with so few pixels that a block of them stays in the processor's cache."""
    step = max(1, _BLOCK_PIXELS // shape[1])
    for start in range(0, shape[0], step):
        yield slice(start, start + step)


def _outliers(square: SingleArray) -> NDArray[np.bool_]:
    """Return where a squared difference is too large to be noise."""
    limit = _outlier_limit(float(square.mean()))
    for _ in range(_OUTLIER_PASSES):
        # An outlier raises the mean that it is judged by: judge again without it.
        tighter = _outlier_limit(float(square[square <= limit].mean()))
        if tighter >= limit:
            break
        limit = tighter
    return square > limit


def _outlier_limit(mean_square: float) -> float:
    return _OUTLIER_SIGMA**2 * max(mean_square, _ROUNDING_DIFFERENCE_VAR_DN2)


# The fixed pattern of a level, split into what rows, columns, single pixels and uneven light have of it


# The coarse grid on which uneven light is told from pixel noise.
_BLOCKS_ACROSS = 16


@dataclass(frozen=True, kw_only=True)
class PatternParts:
    """Variances [DN^2] that add up to the spatial variance; each may be below 0 by its error."""

    row_dn2: float
    column_dn2: float
    pixel_dn2: float


def _pattern_parts(picture_dn: SingleArray, *, spatial_variance_dn2: float, noise_dn2: float) -> PatternParts:
    """Return the parts of the spatial variance that rows, columns and pixels have.

    A picture of one row, one column or 2 x 2 pixels has no parts that could be told apart; all of it counts as pixels'.

    EMVA Standard 1288, Release 4.0 Linear, section 8.2: the means of rows and of columns hold their own pattern
    and a share of the pixels', which three linear equations take apart.
    """
    rows, columns = picture_dn.shape
    freedom = rows * columns - rows - columns
    if freedom <= 0:
        return PatternParts(row_dn2=0.0, column_dn2=0.0, pixel_dn2=spatial_variance_dn2)
    of_columns = float(np.var(cv2.reduce(picture_dn, 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F))) - noise_dn2 / rows
    of_rows = float(np.var(cv2.reduce(picture_dn, 1, cv2.REDUCE_AVG, dtype=cv2.CV_64F))) - noise_dn2 / columns
    n = rows * columns
    return PatternParts(
        row_dn2=((n - columns) * of_rows - rows * (spatial_variance_dn2 - of_columns)) / freedom,
        column_dn2=((n - rows) * of_columns - columns * (spatial_variance_dn2 - of_rows)) / freedom,
        pixel_dn2=n * (spatial_variance_dn2 - of_columns - of_rows) / freedom,
    )


def _small_scale_variance(picture_dn: SingleArray) -> float | None:
    """Return the variance of pixels about the mean of their block, noise included [DN^2]; None for a tiny picture.

    Blocks have a sixteenth of the shorter side; the last rows and columns that fill none are left out.
    """
    side = _block_side(picture_dn.shape)
    if side == 0:
        return None
    rows, columns = picture_dn.shape[0] // side, picture_dn.shape[1] // side
    whole = picture_dn[: rows * side, : columns * side]
    # By whole numbers, area interpolation is the mean of each block.
    blocks = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    within = cv2.norm(whole, cv2.NORM_L2SQR) - side**2 * cv2.norm(blocks, cv2.NORM_L2SQR)
    return float(within) / (whole.size - blocks.size)


def small_scale_freedom(shape: tuple[int, int]) -> float:
    """Return the share of the pixels' degrees of freedom that is left once block means are taken off."""
    side = _block_side(shape)
    return 1.0 - side**-2 if side else 1.0


def _block_side(shape: tuple[int, ...]) -> int:
    """Return the side of a block, 0 where there are not two of them."""
    side = max(2, min(shape) // _BLOCKS_ACROSS)
    return side if (shape[0] // side) * (shape[1] // side) > 1 else 0


def mosaic_contrast(picture_dn: SingleArray, *, mean_dn: float) -> float:
    """Return the largest difference of the means of the four pixels of a 2 x 2 cell, relative to the mean."""
    rows, columns = (size - size % 2 for size in picture_dn.shape)
    if rows * columns == 0 or mean_dn <= 0.0:
        return 0.0
    lines = [cv2.reduce(picture_dn[start:rows:2], 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F)[0] for start in (0, 1)]
    cells = [line[side:columns:2].mean() for line in lines for side in (0, 1)]
    return float(max(cells) - min(cells)) / mean_dn


# The fixed pattern of a level by spatial frequency, along rows and along columns


# Rows that are transformed at a time.
_ROWS_AT_A_TIME = 64
# Below this frequency a pattern is uneven light, and not periodic.
_LOWEST_PERIODIC_PER_PIXEL = 0.02
_LEAST_SHARE, _CHANCE = 0.1, 10.0
_SIGMA = 8.0
# The power of fewer lines scatters too much.
_LEAST_LINES = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrogram:
    """Amplitude of a picture by frequency; independent noise has its own deviation at each frequency."""

    frequency_per_pixel: FloatArray  #: (n,): above 0, up to 0.5 [1/pixel]
    amplitude: FloatArray  #: (n,): root of the mean power over all lines, in the unit of the picture
    n_lines: int  #: rows or columns that it is the mean of

    @property
    def median(self) -> float:
        """Median of the amplitude, which peaks do not change; 0 for lines of one pixel."""
        return float(np.median(self.amplitude)) if self.amplitude.size else 0.0


def spectrogram(picture: NDArray[np.float32], *, along: int) -> Spectrogram:
    """Return the spectrogram of a picture.

    EMVA Standard 1288, Release 4.0 Linear, spectrograms: mean over rows of the squared Fourier amplitude over its
    length.
    """
    lines = picture if along == 1 else picture.T
    mean = float(picture.mean(dtype=np.float64))
    size = lines.shape[1]
    power = np.zeros(size // 2 + 1)
    for start in range(0, lines.shape[0], _ROWS_AT_A_TIME):
        block = np.fft.rfft(lines[start : start + _ROWS_AT_A_TIME] - mean, axis=1)
        power += np.square(np.abs(block)).sum(axis=0)
    return Spectrogram(
        frequency_per_pixel=np.arange(1, size // 2 + 1) / size,
        amplitude=np.sqrt(power[1:] / (size * lines.shape[0])),
        n_lines=lines.shape[0],
    )


def spectral_peak(found: Spectrogram, *, variance: float) -> tuple[float, float] | None:
    """Return the frequency [1/pixel] that has most of a fixed pattern, and its share; None where none has a tenth.

    Lines of one pattern (columns) have one power for each frequency, exponentially distributed: the largest of 300 has
    6 times the mean, 2 % of the variance. With few frequencies the limit is higher by so much.
    """
    periodic = found.frequency_per_pixel >= _LOWEST_PERIODIC_PER_PIXEL
    if not periodic.any() or variance <= 0.0 or found.n_lines < _LEAST_LINES:
        return None
    frequencies = len(found.amplitude)
    power = np.square(found.amplitude[periodic]) - found.median**2
    largest = int(np.argmax(power))
    share = float(power[largest]) / (frequencies * variance)
    noise = _SIGMA * found.median**2 / np.sqrt(found.n_lines)
    if share < _LEAST_SHARE + _CHANCE / frequencies or power[largest] < noise:
        return None
    return float(found.frequency_per_pixel[periodic][largest]), share


# The fixed pattern of the pixels that are like the others: without hot, dead and otherwise defect ones


# A pixel this many standard deviations from the others is a defect: of a million ordinary ones, none.
_DEFECT_SIGMA = 6.0
# More than this share is no matter of single pixels, but of shading or structure: nothing is left out then.
_MOST_DEFECTS = 0.03
# So many pixels show the median well enough: to 2 % of a standard deviation.
_SHOWN = 4096
_ROUNDING_STD_DN = 12.0**-0.5


@dataclass(frozen=True, kw_only=True)
class OrdinaryPattern:
    """The fixed pattern without defects."""

    variance_dn2: float
    std_error_dn2: float
    temporal_cov_dn4: float
    small_scale_variance_dn2: float
    left_out: int


def _ordinary_pattern(
    squares: SingleArray,
    deviations: SingleArray,
    *,
    kept: NDArray[np.bool_] | None,
    moments: VarianceMoments,
    small_scale_dn2: float | None,
    n_frames: int,
) -> OrdinaryPattern:
    """Return the fixed pattern of a level without its defect pixels."""
    noise_dn2 = moments.temporal_dn2 / n_frames
    defect = _defects(deviations, least_std_dn=float(np.hypot(np.sqrt(noise_dn2), _ROUNDING_STD_DN)))
    left_out = 0
    if defect is not None:
        ordinary = ~defect if kept is None else kept & ~defect
        # From the mean of the ordinary ones: that of all holds the defects.
        mean_dn, all_deviations = deviations[ordinary].mean(dtype=np.float64), deviations
        deviations = np.empty_like(all_deviations)
        for rows in _row_blocks((deviations.shape[0], deviations.shape[1])):
            deviations[rows] = np.where(defect[rows], 0.0, all_deviations[rows] - mean_dn)
        moments = _variance_moments(squares[ordinary], deviations[ordinary], n_frames=n_frames)
        left_out, small_scale_dn2 = int(np.count_nonzero(defect)), _small_scale_variance(deviations)
    return OrdinaryPattern(
        variance_dn2=moments.spatial_dn2,
        std_error_dn2=float(np.sqrt(moments.spatial_error_dn4)),
        temporal_cov_dn4=moments.covariance_dn4,
        small_scale_variance_dn2=(
            moments.spatial_dn2 if small_scale_dn2 is None else small_scale_dn2 - moments.temporal_dn2 / n_frames
        ),
        left_out=left_out,
    )


def _defects(deviations: SingleArray, *, least_std_dn: float) -> NDArray[np.bool_] | None:
    """Return which pixels are far from the others, None where there are none or so many that they are no defects."""
    # An odd step, so that they do not all stand in the same columns.
    some = deviations.ravel()[:: (deviations.size // _SHOWN) | 1]
    middle_dn = float(np.median(some))
    limit_dn = _DEFECT_SIGMA * max(_SIGMA_OF_MEDIAN * float(np.median(np.abs(some - middle_dn))), least_std_dn)
    low, high, _, _ = cv2.minMaxLoc(deviations)
    if middle_dn - low <= limit_dn and high - middle_dn <= limit_dn:
        return None
    defect: NDArray[np.bool_] = np.abs(deviations - np.float32(middle_dn)) > limit_dn
    return defect if np.count_nonzero(defect) <= _MOST_DEFECTS * defect.size else None


# Mean, temporal and spatial variance of one level of light, in one pass over its frames

LevelKind = Literal["dark", "flat"]

_LEAST_PIXELS = 4
_SHARED_SIGMA = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelPicture:
    """A level pixel by pixel."""

    mean_dn: NDArray[np.float32]
    temporal_variance_dn2: NDArray[np.float32]
    outlier: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class LevelStatistics:
    """Statistics of one level: frames of one kind, exposure and illumination."""

    kind: LevelKind  #: without light, or with even light
    exposure_s: float | None  #: exposure time [s], None where it is not known
    #: mean photons that a pixel received, as somebody measured them; None where they are not known
    photons: float | None
    n_frames: int  #: at least 2
    shape: tuple[int, int]  #: rows and columns
    n_pixels: int  #: pixels without an outlier; mean and variances are theirs
    mean_dn: float  #: mean of all frames [DN]
    frame_means_dn: tuple[float, ...]  #: mean of each frame, outliers too [DN]
    temporal_variance_dn2: float  #: mean over pixels of the variance in time, rounding included [DN^2]
    temporal_std_error_dn2: float
    #: variance from pixel to pixel of what stays the same in time [DN^2]; may be below 0 by its error. The error counts
    #: the pixels as drawn from a larger population.
    spatial_variance_dn2: float
    spatial_std_error_dn2: float
    temporal_spatial_cov_dn4: float  #: covariance of the errors of these two [DN^4]
    small_scale_variance_dn2: float  #: the spatial variance without what is smooth on a sixteenth of the picture [DN^2]
    ordinary: OrdinaryPattern  #: the spatial variance without defect pixels
    mosaic_contrast: float  #: largest difference of the means of the four pixels of a 2 x 2 cell, relative to the mean
    pattern: PatternParts  #: the spatial variance by rows, columns and pixels
    row_column: RowColumnNoise  #: what pixels share of the noise in time
    samples: SampleTally  #: the samples as integers
    lag: ImageLag | None = None  #: what goes over from frame to frame; None with two frames, or without noise
    picture: LevelPicture | None = None  #: pixel by pixel, where that was asked for


def level_statistics(
    frames: Iterable[NDArray[np.uint16]],
    *,
    kind: LevelKind,
    exposure_s: float | None,
    photons: float | None = None,
    keep_picture: bool = False,
) -> LevelStatistics:
    """Return the statistics of one level.

    Parameters
    ----------
    frames : iterable of (H, W) arrays of uint16
        In the order in which they were taken; at least two, all of one size [DN]. Each is looked at once.
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time of each frame [s], None where it is not known.
    photons : float or None
        Mean photons that a pixel receives in a frame, None where they are not known.
    keep_picture : bool
        Whether the mean and the variance of each pixel are to be kept too.

    Raises
    ------
    CalibrationError
        Fewer than two frames, frames of different size, or hardly any pixels.

    Notes
    -----
    The temporal variance is half the mean square of the differences of consecutive frames, each with its mean
    taken off: light that flickers as a whole, and slow drift, leave it alone. The spatial variance is the
    variance of the mean picture less the temporal variance over the number of frames. Standard errors come
    from how the squares scatter from pixel to pixel, not from an assumed law, and hold noise that whole rows or columns
    share; other noise that neighbours share makes them too small.

    A pixel with a difference beyond 6 standard deviations (cosmic hit, telegraph noise) is left out of this
    level. Memory: a few pictures, however many frames there are. Squares are taken in single precision: 1e-7 of
    each, and of the variance less.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6.6 and 8.2; here with more than one pair a level.
    """
    sequence = iter(frames)
    first = next(sequence, None)
    if first is None:
        raise CalibrationError(f"a level needs at least two frames, to see noise; this {kind} has none")
    if first.ndim != 2 or first.size < _LEAST_PIXELS:
        raise CalibrationError(
            f"a frame has to be (rows, columns) with {_LEAST_PIXELS} pixels or more, not {first.shape}"
        )
    sums = FrameSums(first)
    for frame in sequence:
        sums.add(frame)
    return _statistics(sums, kind=kind, exposure_s=exposure_s, photons=photons, keep_picture=keep_picture)


def _statistics(
    sums: FrameSums, *, kind: LevelKind, exposure_s: float | None, photons: float | None, keep_picture: bool
) -> LevelStatistics:
    n_frames, row_column = sums.n_frames, sums.row_column
    if row_column is None:
        raise CalibrationError(f"a level needs at least two frames, to see noise; this {kind} has {n_frames}")
    mean_dn = sums.mean_dn()
    deviations = sums.deviations(mean_dn)
    moments = _variance_moments(sums.kept(sums.squares()), sums.kept(deviations), n_frames=n_frames)
    small = _small_scale_variance(deviations)
    of_rows_dn2 = _shared_by_rows_dn2(row_column, sums.shape)
    found = LevelStatistics(
        kind=kind,
        exposure_s=exposure_s,
        photons=photons,
        n_frames=n_frames,
        shape=sums.shape,
        n_pixels=moments.n_pixels,
        mean_dn=mean_dn,
        frame_means_dn=sums.frame_means_dn,
        temporal_variance_dn2=moments.temporal_dn2,
        temporal_std_error_dn2=float(np.sqrt(moments.temporal_error_dn4 + of_rows_dn2**2 / (n_frames - 1))),
        spatial_variance_dn2=moments.spatial_dn2,
        spatial_std_error_dn2=float(np.sqrt(moments.spatial_error_dn4 + (of_rows_dn2 / n_frames) ** 2)),
        temporal_spatial_cov_dn4=moments.covariance_dn4,
        small_scale_variance_dn2=moments.spatial_dn2 if small is None else small - moments.temporal_dn2 / n_frames,
        ordinary=_ordinary(sums, deviations, moments, small_scale_dn2=small, of_rows_dn2=of_rows_dn2),
        mosaic_contrast=mosaic_contrast(deviations, mean_dn=mean_dn),
        pattern=_pattern_parts(
            deviations,
            spatial_variance_dn2=moments.spatial_dn2,
            noise_dn2=moments.temporal_dn2 / n_frames,
        ),
        row_column=row_column,
        samples=sums.samples,
        lag=sums.lag,
    )
    if not keep_picture:
        return found
    deviations += np.float32(mean_dn)
    variance = sums.temporal_variance()
    picture = LevelPicture(mean_dn=deviations, temporal_variance_dn2=variance, outlier=sums.outlier_mask())
    return replace(found, picture=picture)


def _ordinary(
    sums: FrameSums,
    deviations: NDArray[np.float32],
    moments: VarianceMoments,
    *,
    small_scale_dn2: float | None,
    of_rows_dn2: float,
) -> OrdinaryPattern:
    """Return the spatial variance without defect pixels, its error with the noise that rows share."""
    found = _ordinary_pattern(
        sums.squares(),
        deviations,
        kept=sums.kept_mask(),
        moments=moments,
        small_scale_dn2=small_scale_dn2,
        n_frames=sums.n_frames,
    )
    return replace(found, std_error_dn2=float(np.hypot(found.std_error_dn2, of_rows_dn2 / sums.n_frames)))


def _shared_by_rows_dn2(found: RowColumnNoise, shape: tuple[int, int]) -> float:
    """Return the error of a variance by noise that rows and columns share, of which there are few [DN^2]."""
    rows, columns = (
        variance if variance > _SHARED_SIGMA * error else 0.0
        for variance, error in (
            (found.row_variance_dn2, found.row_std_error_dn2),
            (found.column_variance_dn2, found.column_std_error_dn2),
        )
    )
    return float(np.hypot(rows * np.sqrt(2.0 / shape[0]), columns * np.sqrt(2.0 / shape[1])))


# Names of levels in messages

_NAMED = 3


def describe_level(level: LevelStatistics) -> str:
    """Return a level's name for a message."""
    exposure = "unknown exposure" if level.exposure_s is None else f"{level.exposure_s * 1e3:.6g} ms"
    photons = "" if level.photons is None else f"{level.photons:.6g} photons, "
    return f"{level.kind} at {exposure} ({photons}mean {level.mean_dn:.4g} DN)"


def level_names(levels: Sequence[LevelStatistics]) -> str:
    """Return the names of several levels, the first three in full."""
    named = ", ".join(describe_level(level) for level in levels[:_NAMED])
    return named if len(levels) <= _NAMED else f"{named} and {len(levels) - _NAMED} more"
