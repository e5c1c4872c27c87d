"""Image lag: the part of a frame's noise that goes over into the next, as averaging in time leaves it behind."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# So many pixels, of the first rows, show it well enough.
_PIXELS = 98304
# A difference of two frames beyond this many standard deviations is no noise.
_OUTLIER_SIGMA = 6.0
_SIGMA_OF_MEDIAN = 1.4826


@dataclass(frozen=True, kw_only=True)
class ImageLag:
    """Correlation of a pixel's noise from one frame to the next.

    Attributes
    ----------
    share : float
        0 where frames are independent.
    std_error : float
        Of this, where they are.
    """

    share: float
    std_error: float


def shown_rows(frame: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return the part of a frame that `image_lag` looks at, as a copy."""
    return frame[: max(2, _PIXELS // frame.shape[1])].copy()


def image_lag(first: NDArray[np.uint16], second: NDArray[np.uint16], third: NDArray[np.uint16]) -> ImageLag | None:
    """Return how much of the noise goes over from frame to frame, None where there is no noise.

    Parameters
    ----------
    first, second, third : (H, W) arrays of uint16
        Three frames of one level, one after the other [DN].

    Notes
    -----
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
