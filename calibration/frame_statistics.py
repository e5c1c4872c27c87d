"""Mean, temporal and spatial variance of one level of light, in one pass over its frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
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


@dataclass(frozen=True, kw_only=True)
class LevelStatistics:
    """What is known of one level: frames of one kind, exposure and illumination.

    Attributes
    ----------
    kind : {"dark", "flat"}
        Without light, or with even light.
    exposure_s : float or None
        Exposure time [s], None where it is not known.
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
    samples : SampleTally
        The samples as integers.
    """

    kind: LevelKind
    exposure_s: float | None
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
    samples: SampleTally


def level_statistics(
    frames: Iterable[NDArray[np.uint16]], *, kind: LevelKind, exposure_s: float | None
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
    return accumulator.result(kind=kind, exposure_s=exposure_s)


class _Accumulator:
    """Sums over frames, pixel by pixel."""

    def __init__(self, first: NDArray[np.uint16]) -> None:
        self._shape = (first.shape[0], first.shape[1])
        self._counter = SampleCounter()
        self._means: list[float] = []
        self._sum = np.zeros(self._shape, dtype=np.int64)
        self._square_sum = np.zeros(self._shape)
        self._work = np.empty(self._shape)
        self._outlier: NDArray[np.bool_] | None = None
        self._previous = first
        self._add_frame(first)

    def add(self, frame: NDArray[np.uint16]) -> None:
        if frame.shape != self._shape:
            raise CalibrationError(
                f"frames of one level differ in size: {self._shape} and {frame.shape} (rows, columns); "
                f"all must be of one region of the sensor"
            )
        self._add_difference(frame)
        self._add_frame(frame)
        self._previous = frame

    def _add_frame(self, frame: NDArray[np.uint16]) -> None:
        self._sum += frame
        self._means.append(float(frame.mean()))
        self._counter.add(frame)

    def _add_difference(self, frame: NDArray[np.uint16]) -> None:
        square = self._squared_deviation(frame, kept=None)
        outlier = _outliers(square)
        if outlier is not None:
            square = self._squared_deviation(frame, kept=~outlier)
            self._outlier = outlier if self._outlier is None else self._outlier | outlier
        self._square_sum += square

    def _squared_deviation(self, frame: NDArray[np.uint16], *, kept: NDArray[np.bool_] | None) -> FloatArray:
        """Return the squares of the difference to the frame before, less its mean over the kept pixels."""
        deviation = self._work
        np.subtract(frame, self._previous, out=deviation, dtype=np.float64)
        deviation -= deviation.mean() if kept is None else deviation[kept].mean()
        return np.square(deviation, out=deviation)

    def result(self, *, kind: LevelKind, exposure_s: float | None) -> LevelStatistics:
        n_frames = len(self._means)
        if n_frames < 2:
            raise CalibrationError(f"a level needs at least two frames, to see noise; this {kind} has {n_frames}")
        mean_picture = self._sum / n_frames
        temporal, pixel_means = self._kept(self._square_sum), self._kept(mean_picture)
        n_pixels = temporal.size
        temporal = temporal * (n_pixels / (n_pixels - 1) / (2.0 * (n_frames - 1)))
        spatial = np.square(pixel_means - pixel_means.mean()) * (n_pixels / (n_pixels - 1)) - temporal / n_frames
        covariance = _covariance_of_means(temporal, spatial)
        return LevelStatistics(
            kind=kind,
            exposure_s=exposure_s,
            n_frames=n_frames,
            shape=self._shape,
            n_pixels=n_pixels,
            mean_dn=float(pixel_means.mean()),
            frame_means_dn=tuple(self._means),
            temporal_variance_dn2=float(temporal.mean()),
            temporal_std_error_dn2=float(np.sqrt(covariance[0])),
            spatial_variance_dn2=float(spatial.mean()),
            spatial_std_error_dn2=float(np.sqrt(covariance[1])),
            temporal_spatial_cov_dn4=float(covariance[2]),
            large_scale_variance_dn2=_large_scale_variance(mean_picture),
            samples=self._counter.tally(),
        )

    def _kept(self, picture: FloatArray) -> FloatArray:
        return picture.ravel() if self._outlier is None else picture[~self._outlier]


def _outliers(square: FloatArray) -> NDArray[np.bool_] | None:
    """Return where a squared difference is too large to be noise, None if nowhere."""
    limit = _outlier_limit(square.mean())
    if square.max() <= limit:
        return None
    for _ in range(_OUTLIER_PASSES):
        # An outlier raises the mean that it is judged by: judge again without it.
        tighter = _outlier_limit(square[square <= limit].mean())
        if tighter >= limit:
            break
        limit = tighter
    return square > limit


def _outlier_limit(mean_square: float) -> float:
    return _OUTLIER_SIGMA**2 * max(mean_square, _ROUNDING_DIFFERENCE_VAR_DN2)


def _covariance_of_means(first: FloatArray, second: FloatArray) -> tuple[float, float, float]:
    """Return the variances of two means over pixels, and their covariance."""
    first = first - first.mean()
    second = second - second.mean()
    scale = 1.0 / (first.size * (first.size - 1))
    return float(first @ first) * scale, float(second @ second) * scale, float(first @ second) * scale


def _large_scale_variance(picture: FloatArray) -> float:
    """Return the variance of block means beyond what independent pixels would give them."""
    side = max(2, min(picture.shape) // _BLOCKS_ACROSS)
    rows, columns = picture.shape[0] // side, picture.shape[1] // side
    if rows * columns < 2:
        return 0.0
    blocks = picture[: rows * side, : columns * side].reshape(rows, side, columns, side).mean(axis=(1, 3))
    return float(blocks.var(ddof=1) - picture.var() / side**2)
