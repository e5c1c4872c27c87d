"""Sums over the frames of a level, pixel by pixel, as they come."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.sensor.image_lag import ImageLag, image_lag, shown_rows
from calibration.sensor.row_column_noise import RowColumnNoise, row_column_noise
from calibration.sensor.sample_tally import SampleCounter, SampleTally

SingleArray = NDArray[np.float32]

# A difference of two frames beyond this many standard deviations is no noise (2e-9 of normal noise is).
_OUTLIER_SIGMA = 6.0
# Rounding alone makes differences of this size: what is smaller is never called an outlier.
_ROUNDING_DIFFERENCE_VAR_DN2 = 0.5
_OUTLIER_PASSES = 5
# Pixels that are worked on at a time: 384 kB of samples and differences.
_BLOCK_PIXELS = 49152
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
        self._first_rows = shown_rows(first)
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
            self.lag = image_lag(self._first_rows, shown_rows(self._previous), shown_rows(frame))
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
        """Return the temporal variance of each pixel, outliers too [DN^2]."""
        variance: SingleArray = self.squares() * np.float32(0.5 / (self.n_frames - 1))
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
            self.row_column = row_column_noise(self._previous, frame, outlier=outlier)
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
