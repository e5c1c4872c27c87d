"""Statistics of one level of a sensor: frames of one kind, exposure and light, read once and not kept.

The *temporal* variance is the noise of a pixel from frame to frame. It comes from differences of consecutive frames
less their mean, from which the fixed pattern and flicker drop out. The *spatial* variance is that of constant
differences between pixels: the variance of the mean picture less its temporal noise. EMVA Standard 1288, Release 4.0
Linear, sections 6.6 and 8.2.

The same pass collects signs of unfit frames: the samples as integers, correlated noise of neighbours, rows, columns and
consecutive frames, and outlying pixels.
"""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.results import CalibrationError
from model.counts import HIT_SIGMA, hit_limit

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
Frame = NDArray[np.uint16]
Mask = NDArray[np.bool_]
LevelKind = Literal["dark", "flat"]

_LEAST_PIXELS = 4
# Sums of samples fit into 32 bits.
_MOST_FRAMES = 65536
# Pixels of a block that stays in the processor's cache.
_BLOCK_PIXELS = 49152
# Pixels of the first rows used for correlations; pixels used for a histogram and for the limit of outliers.
_CORRELATION_PIXELS, _HISTOGRAM_PIXELS, _SOME_PIXELS = 98304, 65536, 65536
# Least deviation of the difference of two frames, and of a mean picture, by rounding alone.
_ROUNDING_DIFFERENCE_DN, _ROUNDING_STD_DN = 0.5**0.5, 12.0**-0.5
# With a larger share of defects they are shading or structure, and none is left out.
_MOST_DEFECTS = 0.03
# Blocks along the shorter side of a picture, to separate uneven light from differences of pixels.
_BLOCKS_ACROSS = 16
# Expected count of a value that is missing by chance once in 1e10 (Poisson).
_LEAST_EXPECTED, _NEIGHBOURS = 25.0, 9
_ROWS_APART = 4
# Significance from which on noise of whole rows and columns is counted.
_SHARED_SIGMA = 5.0
_NAMED_LEVELS = 3


@dataclass(frozen=True, kw_only=True)
class SharedNoise:
    """Temporal noise common to several pixels, from the difference of the first two frames."""

    horizontal: float  #: correlation of neighbours along rows, and down columns
    vertical: float
    std_error: float  #: of both
    row_variance_dn2: float  #: variance that the pixels of a row share, and those of a column
    column_variance_dn2: float
    row_std_error_dn2: float
    column_std_error_dn2: float


@dataclass(frozen=True, kw_only=True)
class OrdinaryPattern:
    """The fixed pattern without outlying pixels (hot, dead and other defects)."""

    variance_dn2: float
    std_error_dn2: float
    temporal_cov_dn4: float  #: covariance with the error of the temporal variance
    small_scale_variance_dn2: float  #: without what is smooth across the picture
    left_out: int  #: number of pixels left out


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelPicture:
    """A level pixel by pixel."""

    mean_dn: SingleArray
    temporal_variance_dn2: SingleArray
    outlier: Mask


@dataclass(frozen=True, kw_only=True)
class LevelStatistics:
    """Statistics of one level: frames of one kind, exposure and illumination."""

    kind: LevelKind  #: without light, or with even light
    exposure_s: float | None  #: exposure time [s], None where it is not known
    #: measured mean photons per pixel; None where not known
    photons: float | None
    n_frames: int  #: at least 2
    shape: tuple[int, int]  #: rows and columns
    n_pixels: int  #: pixels without an outlier, used for mean and variances
    mean_dn: float  #: mean of all frames [DN]
    frame_means_dn: tuple[float, ...]  #: mean of each frame, outliers too [DN]
    temporal_variance_dn2: float  #: mean over pixels of the temporal variance, rounding included [DN^2]
    temporal_std_error_dn2: float
    #: variance of the constant differences between pixels [DN^2]; may be below 0 by its error, which includes the
    #: sampling of pixels from a larger population
    spatial_variance_dn2: float
    spatial_std_error_dn2: float
    small_scale_variance_dn2: float  #: the spatial variance without what is smooth on a sixteenth of the picture [DN^2]
    pattern_dn2: tuple[float, float, float]  #: the spatial variance by rows, by columns and by pixels [DN^2]
    ordinary: OrdinaryPattern  #: the spatial variance without defect pixels
    mosaic_contrast: float  #: largest difference of the means of the four pixels of a 2 x 2 cell, relative to the mean
    shared: SharedNoise
    samples: "SampleTally"  #: the samples as integers
    #: share of a pixel's noise carried into the next frame, and its error; None with two frames or without noise
    lag: tuple[float, float] | None = None
    picture: LevelPicture | None = None  #: pixel by pixel, if requested


class SampleTally:
    """The samples of a level as integers, counted frame by frame."""

    def __init__(self) -> None:
        self.max_dn = -1  #: largest sample
        self.used_bits = 0  #: bits that are set in any sample
        self.missing_codes = 0.0  #: share of values between others that never occur in the first frame
        #: two numbers per frame that identify it; none for frames with one value
        self.digests: list[tuple[int, int]] = []
        self._samples = self._zeros = self._at_max = 0

    @property
    def zero_fraction(self) -> float:
        """Share of samples that are 0."""
        return self._zeros / self._samples

    @property
    def max_fraction(self) -> float:
        """Share of samples that are the largest."""
        return self._at_max / self._samples

    def add(self, frame: Frame) -> None:
        """Count one frame."""
        low, high = int(frame.min()), int(frame.max())
        if not self._samples:
            self.missing_codes = _missing_codes(frame, low)
        if high > self.max_dn:
            self.max_dn, self._at_max = high, 0
        if high == self.max_dn:
            self._at_max += int(np.count_nonzero(frame == high))
        if low == 0:
            self._zeros += frame.size - int(np.count_nonzero(frame))
        self._samples += frame.size
        self.used_bits |= int(np.bitwise_or.reduce(frame, axis=None))
        if low < high:
            # Both together identify a million frames; the sum of a frame alone scatters over thousands.
            some_rows = np.ascontiguousarray(frame[::_ROWS_APART])
            self.digests.append((round(cv2.sumElems(frame)[0]), zlib.crc32(some_rows.data)))


def level_statistics(
    frames: Iterable[Frame],
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
        In the order in which they were taken; at least two, all of one size [DN]. Each is read once.
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time of each frame [s], None where it is not known.
    photons : float or None
        Mean photons that a pixel receives in a frame, None where they are not known.
    keep_picture : bool
        Also keep the mean and the variance of each pixel.

    Raises
    ------
    CalibrationError
        Fewer than two frames, frames of different size, or too few pixels.

    Notes
    -----
    Standard errors come from the scatter of the squares from pixel to pixel, not from an assumed law. They include
    noise common to rows or columns; other correlated noise makes them too small.

    A pixel with a difference beyond 6 standard deviations (cosmic hit, telegraph noise) is left out of this
    level. Memory: a few pictures. Squares are in single precision: an error of 1e-7 each, less in the
    variance.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, sections 6.6 and 8.2; here with more than one pair per level.
    """
    sequence = iter(frames)
    previous = next(sequence, None)
    if previous is None:
        raise CalibrationError(f"a level needs at least two frames to show noise; this {kind} has none")
    if previous.ndim != 2 or previous.size < _LEAST_PIXELS:
        raise CalibrationError(
            f"a frame must be (rows, columns) with at least {_LEAST_PIXELS} pixels; this one is {previous.shape}"
        )
    shape, total, first_rows = (previous.shape[0], previous.shape[1]), previous.astype(np.uint32), _first_rows(previous)
    samples, means = SampleTally(), [cv2.mean(previous)[0]]
    samples.add(previous)
    square_sum: SingleArray | None = None
    outlier: Mask | None = None
    lag = None
    for frame in sequence:
        _require_room(frame, shape, n_frames=len(means))
        total += frame
        means.append(cv2.mean(frame)[0])
        samples.add(frame)
        square, jumps = _squared_difference(previous, frame, offset_dn=means[-1] - means[-2])
        if jumps is not None:
            outlier = jumps if outlier is None else outlier | jumps
        if square_sum is None:
            square_sum, shared = square, _shared_noise(previous, frame, outlier=jumps)
        else:
            square_sum += square
        if len(means) == 3:
            lag = _image_lag(first_rows, _first_rows(previous), _first_rows(frame))
        previous = frame
    n_frames = len(means)
    if square_sum is None:
        raise CalibrationError(f"a level needs at least two frames to show noise; this {kind} has {n_frames}")

    kept = None if outlier is None else ~outlier
    n_pixels = total.size if kept is None else int(np.count_nonzero(kept))
    sum_dn = total.sum(dtype=np.uint64) if kept is None else total.sum(dtype=np.uint64, where=kept)
    mean_dn = int(sum_dn) / (n_pixels * n_frames)
    deviations: SingleArray = np.multiply(total, 1.0 / n_frames, dtype=np.float32)
    deviations -= mean_dn
    del total, previous, square  # pictures that would otherwise stay to the end
    if outlier is not None:
        deviations[outlier] = 0.0
    pixels = (square_sum, deviations) if kept is None else (square_sum[kept], deviations[kept])
    (temporal_dn2, spatial_dn2), errors = _variances(*pixels, n_frames=n_frames)
    small_dn2 = _small_scale_variance(deviations, spatial_dn2=spatial_dn2, noise_dn2=temporal_dn2 / n_frames)
    # Noise of rows and columns has few independent values, which makes variances scatter by more.
    by_lines_dn2 = _error_of_shared_noise(shared, shape)
    ordinary = _ordinary_pattern(
        square_sum,
        deviations,
        kept=kept,
        of_all=(temporal_dn2, spatial_dn2, errors, small_dn2),
        n_frames=n_frames,
        by_lines_dn2=by_lines_dn2,
    )
    pattern = _pattern_parts(deviations, spatial_dn2=spatial_dn2, noise_dn2=temporal_dn2 / n_frames)
    contrast = _mosaic_contrast(deviations, mean_dn=mean_dn)
    picture = None
    if keep_picture:
        deviations += np.float32(mean_dn)
        square_sum *= np.float32(0.5 / (n_frames - 1))
        jumped = np.zeros(shape, dtype=bool) if outlier is None else outlier
        picture = LevelPicture(mean_dn=deviations, temporal_variance_dn2=square_sum, outlier=jumped)
    return LevelStatistics(
        kind=kind,
        exposure_s=exposure_s,
        photons=photons,
        n_frames=n_frames,
        shape=shape,
        n_pixels=n_pixels,
        mean_dn=mean_dn,
        frame_means_dn=tuple(means),
        temporal_variance_dn2=temporal_dn2,
        temporal_std_error_dn2=float(np.sqrt(errors[0, 0] + by_lines_dn2**2 / (n_frames - 1))),
        spatial_variance_dn2=spatial_dn2,
        spatial_std_error_dn2=float(np.sqrt(errors[1, 1] + (by_lines_dn2 / n_frames) ** 2)),
        small_scale_variance_dn2=small_dn2,
        pattern_dn2=pattern,
        ordinary=ordinary,
        mosaic_contrast=contrast,
        shared=shared,
        samples=samples,
        lag=lag,
        picture=picture,
    )


def describe_level(level: LevelStatistics) -> str:
    """Return a level's name for a message."""
    exposure = "unknown exposure" if level.exposure_s is None else f"{level.exposure_s * 1e3:.6g} ms"
    photons = "" if level.photons is None else f"{level.photons:.6g} photons, "
    return f"{level.kind} at {exposure} ({photons}mean {level.mean_dn:.4g} DN)"


def level_names(levels: Sequence[LevelStatistics]) -> str:
    """Return the names of several levels, the first three in full."""
    names = ", ".join(describe_level(level) for level in levels[:_NAMED_LEVELS])
    return names if len(levels) <= _NAMED_LEVELS else f"{names} and {len(levels) - _NAMED_LEVELS} more"


def column(levels: Sequence[LevelStatistics], name: str) -> FloatArray:
    """Return one number of each level, nan if unknown."""
    return np.array([np.nan if (value := getattr(level, name)) is None else value for level in levels], dtype=float)


def pattern_variances(levels: Sequence[LevelStatistics]) -> FloatArray:
    """Return the variance of the fixed pattern of each level without defect pixels, at least 0 [DN^2]."""
    return np.array([max(level.ordinary.variance_dn2, 0.0) for level in levels])


def small_scale_freedom(shape: tuple[int, int]) -> float:
    """Return the share of the pixels' degrees of freedom that is left once block means are subtracted."""
    side = _block_side(shape)
    return 1.0 - side**-2 if side else 1.0


# Frame by frame


def _require_room(frame: Frame, shape: tuple[int, int], *, n_frames: int) -> None:
    if frame.shape != shape:
        raise CalibrationError(
            f"frames of one level differ in size: {shape} and {frame.shape} (rows, columns); "
            f"use one region of the sensor"
        )
    if n_frames == _MOST_FRAMES:
        raise CalibrationError(f"a level has more than {_MOST_FRAMES} frames; make several levels of them")


def _missing_codes(frame: Frame, low: int) -> float:
    """Return the share of values that never occur between neighbours that do."""
    counts = np.bincount(frame.ravel()[:_HISTOGRAM_PIXELS] - low)
    if len(counts) < _NEIGHBOURS:
        return 0.0
    expected = np.convolve(counts, np.full(_NEIGHBOURS, 1.0 / _NEIGHBOURS), mode="same")
    filled = expected >= _LEAST_EXPECTED
    return float(np.count_nonzero(filled & (counts == 0))) / max(int(np.count_nonzero(filled)), 1)


def _squared_difference(before: Frame, frame: Frame, *, offset_dn: float) -> tuple[SingleArray, Mask | None]:
    """Return the squared difference of two frames less its mean, and the outlying pixels."""
    square = np.empty(frame.shape, dtype=np.float32)
    total, largest = _fill_squares(square, before, frame, offset_dn)
    # No limit of a sample is needed where all are near.
    if largest <= HIT_SIGMA**2 * max(total / square.size, _ROUNDING_DIFFERENCE_DN**2):
        return square, None
    limit = hit_limit(np.sqrt(some_pixels(square)), least=_ROUNDING_DIFFERENCE_DN) ** 2
    if largest <= limit:
        return square, None
    outlier = square > limit
    kept = ~outlier
    _fill_squares(square, before, frame, float(frame[kept].mean()) - float(before[kept].mean()))
    return square, outlier


def _fill_squares(square: SingleArray, before: Frame, frame: Frame, offset_dn: float) -> tuple[float, float]:
    """Fill in the squares of the difference less an offset; return their sum and the largest."""
    total = largest = 0.0
    for rows in _row_blocks(square.shape):
        block = square[rows]
        np.subtract(frame[rows], before[rows], out=block, dtype=np.float32)
        block -= offset_dn
        np.square(block, out=block)
        total += cv2.sumElems(block)[0]
        largest = max(largest, float(block.max()))
    return total, largest


def some_pixels(picture: SingleArray) -> FloatArray:
    """Return a regular sample of the pixels of a large picture, for a fast median or limit."""
    # An odd step covers different columns.
    return picture.ravel()[:: (picture.size // _SOME_PIXELS) | 1].astype(np.float64)


def _row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield slices of rows that fit into the processor's cache."""
    step = max(1, _BLOCK_PIXELS // shape[1])
    for start in range(0, shape[0], step):
        yield slice(start, start + step)


def _first_rows(frame: Frame) -> Frame:
    """Return a copy of the rows used for correlations."""
    return frame[: max(2, _CORRELATION_PIXELS // frame.shape[1])].copy()


def _shared_noise(first: Frame, second: Frame, *, outlier: Mask | None) -> SharedNoise:
    """Return the temporal noise common to several pixels.

    A sensor's noise is independent from pixel to pixel. Filters, colour interpolation, compression and spreading charge
    correlate neighbours, and bias the gain of a photon-transfer curve by the same share.
    """
    chosen = slice(max(2, _CORRELATION_PIXELS // first.shape[1]))
    difference = np.subtract(second[chosen], first[chosen], dtype=np.float32)
    difference -= cv2.mean(difference)[0]
    if outlier is not None:
        difference[outlier[chosen]] = 0.0
    rows, columns = difference.shape
    total = _product(difference, difference)
    variance_dn2 = 0.5 * total / difference.size
    of_rows, of_columns = (
        0.5 * float(np.square(cv2.reduce(difference, axis, cv2.REDUCE_AVG, dtype=cv2.CV_64F)).mean())
        - variance_dn2 / length
        for axis, length in ((1, columns), (0, rows))
    )
    return SharedNoise(
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


def _image_lag(first: Frame, second: Frame, third: Frame) -> tuple[float, float] | None:
    """Return the share of the noise carried from frame to frame, and its error; None without noise.

    Consecutive differences share the middle frame, so for independent frames their correlation is -1/2. If a camera
    mixes each frame with the share a of the one before, it is -(1 - a) / 2, and the variance falls by the factor
    (1 - a) / (1 + a); differences show only (1 - a)^2 / (1 - a^2) of it.
    """
    differences = [np.subtract(*pair, dtype=np.float32).ravel() for pair in ((second, first), (third, second))]
    for one in differences:
        one -= np.median(one)
    limits = [hit_limit(one, least=1.0) for one in differences]
    kept = (np.abs(differences[0]) < limits[0]) & (np.abs(differences[1]) < limits[1])
    before, after = (one[kept].astype(np.float64) - one[kept].mean() for one in differences)
    total = 0.5 * float(before @ before + after @ after)
    if total == 0.0:
        return None
    # Of three independent normal values: variance of twice the correlation of their differences.
    return 1.0 + 2.0 * float(before @ after) / total, float(np.sqrt(3.0 / np.count_nonzero(kept)))


# From sums over frames to variances


def _variances(
    square_sums: SingleArray, deviations: SingleArray, *, n_frames: int
) -> tuple[tuple[float, float], FloatArray]:
    """Return temporal and spatial variance over pixels [DN^2], and the (2, 2) covariance of their errors [DN^4].

    `square_sums` are the sums of squared differences of each pixel, `deviations` its mean less that of all.
    """
    n, sums = deviations.size, np.zeros(5)
    temporal, spatial = square_sums.ravel(), deviations.ravel()
    for start in range(0, n, _BLOCK_PIXELS):
        one, other = temporal[start : start + _BLOCK_PIXELS], np.square(spatial[start : start + _BLOCK_PIXELS])
        # OpenCV adds in double precision and without costly threads.
        of_one, of_other = cv2.norm(one, cv2.NORM_L2SQR), cv2.norm(other, cv2.NORM_L2SQR)
        product = 0.5 * (of_one + of_other - cv2.norm(one, other, cv2.NORM_L2SQR))
        sums += (cv2.sumElems(one)[0], cv2.sumElems(other)[0], of_one, product, of_other)
    # The mean of each takes one degree of freedom.
    correction = n / (n - 1)
    # Temporal and spatial variance of a pixel, from its squared differences and its squared deviation from the mean.
    weights = correction * np.array([[0.5 / (n_frames - 1), 0.0], [-0.5 / (n_frames - 1) / n_frames, 1.0]])
    means = sums[:2] / n
    scatter = (np.array([[sums[2], sums[3]], [sums[3], sums[4]]]) / n - np.outer(means, means)) / (n - 1)
    errors = weights @ scatter @ weights.T
    np.fill_diagonal(errors, np.maximum(np.diag(errors), 0.0))
    temporal_dn2, spatial_dn2 = (weights @ means).tolist()
    return (temporal_dn2, spatial_dn2), errors


def _error_of_shared_noise(shared: SharedNoise, shape: tuple[int, int]) -> float:
    """Return the error of a variance due to noise of whole rows and columns [DN^2]."""
    rows, columns = (
        variance if variance > _SHARED_SIGMA * error else 0.0
        for variance, error in (
            (shared.row_variance_dn2, shared.row_std_error_dn2),
            (shared.column_variance_dn2, shared.column_std_error_dn2),
        )
    )
    return float(np.hypot(rows * np.sqrt(2.0 / shape[0]), columns * np.sqrt(2.0 / shape[1])))


def _ordinary_pattern(
    squares: SingleArray,
    deviations: SingleArray,
    *,
    kept: Mask | None,
    of_all: tuple[float, float, FloatArray, float],
    n_frames: int,
    by_lines_dn2: float,
) -> OrdinaryPattern:
    """Return the fixed pattern of a level without its defect pixels.

    `of_all` are temporal and spatial variance, their errors, and the small-scale variance with the defects.
    """
    temporal_dn2, spatial_dn2, errors, small_dn2 = of_all
    defect = _defects(deviations, least_std_dn=float(np.hypot(np.sqrt(temporal_dn2 / n_frames), _ROUNDING_STD_DN)))
    if defect is not None:
        ordinary = ~defect if kept is None else kept & ~defect
        # From the mean of the ordinary pixels: that of all includes the defects.
        mean_dn, without = deviations[ordinary].mean(dtype=np.float64), np.empty_like(deviations)
        for rows in _row_blocks(deviations.shape):
            without[rows] = np.where(defect[rows], 0.0, deviations[rows] - mean_dn)
        (temporal_dn2, spatial_dn2), errors = _variances(squares[ordinary], without[ordinary], n_frames=n_frames)
        small_dn2 = _small_scale_variance(without, spatial_dn2=spatial_dn2, noise_dn2=temporal_dn2 / n_frames)
    return OrdinaryPattern(
        variance_dn2=spatial_dn2,
        std_error_dn2=float(np.hypot(np.sqrt(errors[1, 1]), by_lines_dn2 / n_frames)),
        temporal_cov_dn4=float(errors[0, 1]),
        small_scale_variance_dn2=small_dn2,
        left_out=0 if defect is None else int(np.count_nonzero(defect)),
    )


def _defects(deviations: SingleArray, *, least_std_dn: float) -> Mask | None:
    """Return the outlying pixels, or None if no pixel or too many pixels deviate."""
    some = some_pixels(deviations)
    middle_dn = float(np.median(some))
    limit_dn = hit_limit(some - middle_dn, least=least_std_dn)
    low, high, _, _ = cv2.minMaxLoc(deviations)
    if middle_dn - low <= limit_dn and high - middle_dn <= limit_dn:
        return None
    defect: Mask = np.abs(deviations - np.float32(middle_dn)) > limit_dn
    return defect if np.count_nonzero(defect) <= _MOST_DEFECTS * defect.size else None


def _pattern_parts(picture_dn: SingleArray, *, spatial_dn2: float, noise_dn2: float) -> tuple[float, float, float]:
    """Return the spatial variance of rows, columns and pixels; each may be below 0 by its error.

    In a picture of one row, one column or 2 x 2 pixels the parts cannot be separated, and all counts as pixels'.

    EMVA Standard 1288, Release 4.0 Linear, section 8.2: the means of rows and of columns include a share of the
    pixels' pattern, which three linear equations separate.
    """
    rows, columns = picture_dn.shape
    n = rows * columns
    freedom = n - rows - columns
    if freedom <= 0:
        return 0.0, 0.0, spatial_dn2
    of_columns = float(np.var(cv2.reduce(picture_dn, 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F))) - noise_dn2 / rows
    of_rows = float(np.var(cv2.reduce(picture_dn, 1, cv2.REDUCE_AVG, dtype=cv2.CV_64F))) - noise_dn2 / columns
    return (
        ((n - columns) * of_rows - rows * (spatial_dn2 - of_columns)) / freedom,
        ((n - rows) * of_columns - columns * (spatial_dn2 - of_rows)) / freedom,
        n * (spatial_dn2 - of_columns - of_rows) / freedom,
    )


def _small_scale_variance(picture_dn: SingleArray, *, spatial_dn2: float, noise_dn2: float) -> float:
    """Return the spatial variance about the mean of each block; of a tiny picture, the whole spatial variance [DN^2].

    Blocks have a sixteenth of the shorter side; the last rows and columns that do not fill a block are left out.
    """
    side = _block_side(picture_dn.shape)
    if side == 0:
        return spatial_dn2
    rows, columns = picture_dn.shape[0] // side, picture_dn.shape[1] // side
    whole = picture_dn[: rows * side, : columns * side]
    # By whole numbers, area interpolation is the mean of each block.
    blocks = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    within = cv2.norm(whole, cv2.NORM_L2SQR) - side**2 * cv2.norm(blocks, cv2.NORM_L2SQR)
    return float(within) / (whole.size - blocks.size) - noise_dn2


def _block_side(shape: tuple[int, ...]) -> int:
    """Return the side of a block, 0 if there would be fewer than two."""
    side = max(2, min(shape) // _BLOCKS_ACROSS)
    return side if (shape[0] // side) * (shape[1] // side) > 1 else 0


def _mosaic_contrast(picture_dn: SingleArray, *, mean_dn: float) -> float:
    """Return the largest difference of the means of the four pixels of a 2 x 2 cell, relative to the mean."""
    rows, columns = (size - size % 2 for size in picture_dn.shape)
    if rows * columns == 0 or mean_dn <= 0.0:
        return 0.0
    lines = [cv2.reduce(picture_dn[start:rows:2], 0, cv2.REDUCE_AVG, dtype=cv2.CV_64F)[0] for start in (0, 1)]
    cells = [line[side:columns:2].mean() for line in lines for side in (0, 1)]
    return float(max(cells) - min(cells)) / mean_dn
