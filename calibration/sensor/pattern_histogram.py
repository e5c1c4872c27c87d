"""Distribution of the pixels' own deviations, for a logarithmic histogram."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.sensor.defects import some_pixels

FloatArray = NDArray[np.float64]

_BINS = 256
_SIDE = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class PatternHistogram:
    """Counts of pixels by their deviation, beside those of a normal law of the same width.

    Attributes
    ----------
    centres : (n,) array
        Middle of each bin, in the unit of the deviation.
    counts : (n,) array of int
        Pixels.
    normal_counts : (n,) array
        Pixels by a normal law.
    sigma : float
        Its standard deviation, from the quartiles.
    """

    centres: FloatArray
    counts: NDArray[np.int64]
    normal_counts: FloatArray
    sigma: float

    @property
    def at_least(self) -> NDArray[np.int64]:
        """Pixels that deviate as much as each of `reach` or more, to either side."""
        order = np.argsort(np.abs(self.centres))[::-1]
        found: NDArray[np.int64] = np.cumsum(self.counts[order])[::-1]
        return found

    @property
    def reach(self) -> FloatArray:
        """Absolute deviations in ascending order."""
        return np.sort(np.abs(self.centres))


def pattern_histogram(picture: NDArray[np.float32], *, quantum: float) -> PatternHistogram:
    """Return the histogram of how far each pixel is from the mean of the 5 x 5 pixels around it.

    Parameters
    ----------
    picture : (M, N) array
        Any unit.
    quantum : float
        Smallest step between two means of that many frames, same unit: bins that are no multiple of it would show a
        comb.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, histograms: high-pass of 5 x 5 pixels, 256 bins or fewer, logarithmic
    counts, a normal law beside.
    """
    kernel = (_SIDE, _SIDE)
    # The pixel itself is one of 25: without this its deviation would be 4 % too small.
    deviation = (picture - cv2.blur(picture, kernel)) * np.float32(_SIDE**2 / (_SIDE**2 - 1.0))
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
