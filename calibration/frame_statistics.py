"""Mean, temporal and spatial variance of one level of light, in one pass over its frames."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.pattern_parts import PatternParts, pattern_parts
from calibration.sample_tally import SampleCounter, SampleTally

FloatArray = NDArray[np.float64]
LevelKind = Literal["dark", "flat"]

# A difference of two frames beyond this many standard deviations is no noise (2e-9 of normal noise is).
_OUTLIER_SIGMA = 6.0
# Rounding alone makes differences of this size: what is smaller is never called an outlier.
_ROUNDING_DIFFERENCE_VAR_DN2 = 0.5
_OUTLIER_PASSES = 5
_LEAST_PIXELS = 4
# The coarse grid on which uneven light is told from pixel noise.
_BLOCKS_ACROSS = 16
# Pixels that are worked on at a time: 128 kB of float64.
_BLOCK_PIXELS = 16384
# Sums of samples fit into 32 bits.
_MOST_FRAMES = 65536


@dataclass(frozen=True, kw_only=True)
class LevelStatistics:
    """What is known of one level: frames of one kind, exposure and illumination.

    Attributes
    ----------
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time [s], None where it is not known.
    photons : float or None
        Mean photons that a pixel received, as somebody measured them; None where they are not known.
    n_frames : int
        At least 2.
    shape : (int, int)
        Rows and columns.
    n_pixels : int
        Pixels without an outlier; mean and variances are theirs.
    mean_dn : float
        Mean of all frames [DN].
    frame_means_dn : tuple of float
        Mean of each frame, outliers too [DN].
    temporal_variance_dn2, temporal_std_error_dn2 : float
        Mean over pixels of the variance in time, rounding included [DN^2].
    spatial_variance_dn2, spatial_std_error_dn2 : float
        Variance from pixel to pixel of what stays the same in time [DN^2]; may be below 0 by its error. The
        error counts the pixels as drawn from a larger population.
    temporal_spatial_cov_dn4 : float
        Covariance of the errors of these two [DN^4].
    large_scale_variance_dn2 : float
        The part of the spatial variance that is smooth on a sixteenth of the picture [DN^2].
    pattern : PatternParts
        The spatial variance by rows, columns and pixels.
    samples : SampleTally
        The samples as integers.
    """

    kind: LevelKind
    exposure_s: float | None
    photons: float | None
    n_frames: int
    shape: tuple[int, int]
    n_pixels: int
    mean_dn: float
    frame_means_dn: tuple[float, ...]
    temporal_variance_dn2: float
    temporal_std_error_dn2: float
    spatial_variance_dn2: float
    spatial_std_error_dn2: float
    temporal_spatial_cov_dn4: float
    large_scale_variance_dn2: float
    pattern: PatternParts
    samples: SampleTally


def level_statistics(
    frames: Iterable[NDArray[np.uint16]], *, kind: LevelKind, exposure_s: float | None, photons: float | None = None
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

    Raises
    ------
    CalibrationError
        Fewer than two frames, frames of different size, or hardly any pixels.

    Notes
    -----
    The temporal variance is half the mean square of the differences of consecutive frames, each with its mean
    taken off: light that flickers as a whole, and slow drift, leave it alone. The spatial variance is the
    variance of the mean picture less the temporal variance over the number of frames. Standard errors come
    from how the squares scatter from pixel to pixel, not from an assumed law; noise that neighbours share
    (rows, stripes) makes them too small.

    A pixel with a difference beyond 6 standard deviations (cosmic hit, telegraph noise) is left out of this
    level. Memory: a few pictures, however many frames there are.

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
    accumulator = _Accumulator(first)
    for frame in sequence:
        accumulator.add(frame)
    return accumulator.result(kind=kind, exposure_s=exposure_s, photons=photons)


class _Accumulator:
    """Sums over frames, pixel by pixel."""

    def __init__(self, first: NDArray[np.uint16]) -> None:
        self._shape = (first.shape[0], first.shape[1])
        self._counter = SampleCounter()
        self._means: list[float] = []
        self._sum = np.zeros(self._shape, dtype=np.uint32)
        self._square_sum: FloatArray | None = None
        self._outlier: NDArray[np.bool_] | None = None
        self._previous = first
        self._add_frame(first)

    def add(self, frame: NDArray[np.uint16]) -> None:
        if frame.shape != self._shape:
            raise CalibrationError(
                f"frames of one level differ in size: {self._shape} and {frame.shape} (rows, columns); "
                f"all must be of one region of the sensor"
            )
        if len(self._means) == _MOST_FRAMES:
            raise CalibrationError(f"a level has more than {_MOST_FRAMES} frames; make several levels of them")
        self._add_frame(frame)
        self._add_difference(frame)
        self._previous = frame

    def _add_frame(self, frame: NDArray[np.uint16]) -> None:
        self._sum += frame
        self._means.append(cv2.mean(frame)[0])
        self._counter.add(frame)

    def _add_difference(self, frame: NDArray[np.uint16]) -> None:
        square = np.empty(self._shape)
        total, peak = self._square_deviation(frame, self._means[-1] - self._means[-2], out=square)
        if peak > _outlier_limit(total / square.size):
            outlier = _outliers(square)
            kept = ~outlier
            offset = float(frame[kept].mean()) - float(self._previous[kept].mean())
            self._square_deviation(frame, offset, out=square)
            self._outlier = outlier if self._outlier is None else self._outlier | outlier
        if self._square_sum is None:
            self._square_sum = square
        else:
            self._square_sum += square

    def _square_deviation(self, frame: NDArray[np.uint16], offset_dn: float, *, out: FloatArray) -> tuple[float, float]:
        """Fill in the squares of the difference to the frame before, less its mean; return their sum and largest."""
        total = peak = 0.0
        for rows in _row_blocks(self._shape):
            block = out[rows]
            cv2.subtract(frame[rows], self._previous[rows], dst=block, dtype=cv2.CV_64F)
            block -= offset_dn
            np.square(block, out=block)
            total += float(block.sum())
            peak = max(peak, float(block.max()))
        return total, peak

    def result(self, *, kind: LevelKind, exposure_s: float | None, photons: float | None) -> LevelStatistics:
        n_frames = len(self._means)
        if self._square_sum is None:
            raise CalibrationError(f"a level needs at least two frames, to see noise; this {kind} has {n_frames}")
        mean_picture = self._sum / n_frames
        kept_means = self._kept(mean_picture)
        n_pixels, mean_dn = kept_means.size, float(kept_means.mean())
        moments = _variance_moments(self._kept(self._square_sum), kept_means, mean_dn=mean_dn, n_frames=n_frames)
        return LevelStatistics(
            kind=kind,
            exposure_s=exposure_s,
            photons=photons,
            n_frames=n_frames,
            shape=self._shape,
            n_pixels=n_pixels,
            mean_dn=mean_dn,
            frame_means_dn=tuple(self._means),
            temporal_variance_dn2=moments.temporal_dn2,
            temporal_std_error_dn2=float(np.sqrt(moments.temporal_error_dn4)),
            spatial_variance_dn2=moments.spatial_dn2,
            spatial_std_error_dn2=float(np.sqrt(moments.spatial_error_dn4)),
            temporal_spatial_cov_dn4=moments.covariance_dn4,
            large_scale_variance_dn2=_large_scale_variance(mean_picture),
            pattern=pattern_parts(
                self._filled(mean_picture, mean_dn),
                spatial_variance_dn2=moments.spatial_dn2,
                noise_dn2=moments.temporal_dn2 / n_frames,
            ),
            samples=self._counter.tally(),
        )

    def _kept(self, picture: FloatArray) -> FloatArray:
        return picture.ravel() if self._outlier is None else picture[~self._outlier]

    def _filled(self, picture: FloatArray, mean_dn: float) -> FloatArray:
        """Return the picture with the mean of the others in place of outliers."""
        return picture if self._outlier is None else np.where(self._outlier, mean_dn, picture)


def _row_blocks(shape: tuple[int, int]) -> Iterator[slice]:
    """Yield slices of rows with so few pixels that a block of them stays in the processor's cache."""
    step = max(1, _BLOCK_PIXELS // shape[1])
    for start in range(0, shape[0], step):
        yield slice(start, start + step)


def _outliers(square: FloatArray) -> NDArray[np.bool_]:
    """Return where a squared difference is too large to be noise."""
    limit = _outlier_limit(square.mean())
    for _ in range(_OUTLIER_PASSES):
        # An outlier raises the mean that it is judged by: judge again without it.
        tighter = _outlier_limit(square[square <= limit].mean())
        if tighter >= limit:
            break
        limit = tighter
    return square > limit


def _outlier_limit(mean_square: float) -> float:
    return _OUTLIER_SIGMA**2 * max(mean_square, _ROUNDING_DIFFERENCE_VAR_DN2)


@dataclass(frozen=True, kw_only=True)
class _VarianceMoments:
    """Means over pixels of temporal and spatial variance, and the covariance of their errors."""

    temporal_dn2: float
    spatial_dn2: float
    temporal_error_dn4: float
    spatial_error_dn4: float
    covariance_dn4: float


def _variance_moments(
    square_sum: FloatArray, pixel_means: FloatArray, *, mean_dn: float, n_frames: int
) -> _VarianceMoments:
    n = square_sum.size
    correction = n / (n - 1)
    sums = np.zeros(5)
    for start in range(0, n, _BLOCK_PIXELS):
        block = slice(start, start + _BLOCK_PIXELS)
        temporal = square_sum[block] * (correction / (2.0 * (n_frames - 1)))
        spatial = pixel_means[block] - mean_dn
        np.square(spatial, out=spatial)
        spatial *= correction
        spatial -= temporal / n_frames
        # Not `@`: for sums this short its threads cost more than they save.
        products = [
            np.einsum("i,i->", *pair) for pair in ((temporal, temporal), (spatial, spatial), (temporal, spatial))
        ]
        sums += [temporal.sum(), spatial.sum(), *products]
    first, second = sums[:2] / n
    errors = (sums[2:] / n - [first * first, second * second, first * second]) / (n - 1)
    return _VarianceMoments(
        temporal_dn2=float(first),
        spatial_dn2=float(second),
        temporal_error_dn4=max(float(errors[0]), 0.0),
        spatial_error_dn4=max(float(errors[1]), 0.0),
        covariance_dn4=float(errors[2]),
    )


def _large_scale_variance(picture: FloatArray) -> float:
    """Return the variance of block means beyond what independent pixels would give them."""
    side = max(2, min(picture.shape) // _BLOCKS_ACROSS)
    rows, columns = picture.shape[0] // side, picture.shape[1] // side
    if rows * columns < 2:
        return 0.0
    blocks = picture[: rows * side, : columns * side].reshape(rows, side, columns, side).mean(axis=(1, 3))
    return float(blocks.var(ddof=1) - picture.var() / side**2)
