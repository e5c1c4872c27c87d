"""The response of each pixel behind the polarizer at one angle, from even light."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError

FloatArray = NDArray[np.float64]

_LEAST_FRAMES = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatField:
    """A picture of even light, over its mean.

    Attributes
    ----------
    response : (H, W) array
        Of each pixel, mean 1.
    std_error : (H, W) array
        Of it, from how frames differ.
    mean_dn, mean_error_dn : float
        The light, dark taken off, and its standard error [DN].
    frames : int
        How many frames.
    """

    response: FloatArray
    std_error: FloatArray
    mean_dn: float
    mean_error_dn: float
    frames: int

    @property
    def pattern_rms(self) -> float:
        """Standard deviation from pixel to pixel, the flat's own noise taken off; relative."""
        return float(np.sqrt(max(0.0, float(np.var(self.response)) - self.noise_rms**2)))

    @property
    def noise_rms(self) -> float:
        """Noise of the flat itself, relative: dividing by it adds this as a pattern."""
        return float(np.sqrt(np.mean(np.square(self.std_error))))


def flat_field(frames: Iterable[NDArray[np.uint16]], dark_dn: FloatArray) -> FlatField:
    """Return the flat field of frames of even light.

    Parameters
    ----------
    frames : iterable of (H, W) arrays
        Two or more, taken one after the other with one setting; read one at a time.
    dark_dn : (H, W) array
        Counts of each pixel without light at their exposure [DN].

    Raises
    ------
    CalibrationError
        There are fewer than two frames, or no light.

    Notes
    -----
    Each pixel's error is from its own scatter over the frames. The noise of the dark is not in it: take as many darks
    as flats, and the flats near saturation. The error of the mean is from how the means of frames differ.
    """
    total, squares, means = np.zeros_like(dark_dn), np.zeros_like(dark_dn), []
    for frame in frames:
        signal = frame - dark_dn
        total += signal
        squares += np.square(signal)
        means.append(float(signal.mean()))
    count = len(means)
    if count < _LEAST_FRAMES:
        raise CalibrationError(f"{count} flat frames at an angle; two or more are needed, to know their noise")
    mean_dn = float(np.mean(means))
    if mean_dn <= 0.0:
        raise CalibrationError("flat frames are not brighter than dark frames: check the lamp and the exposures")
    variance = np.maximum(squares - np.square(total) / count, 0.0) / (count - 1)
    return FlatField(
        response=total / count / mean_dn,
        std_error=np.sqrt(variance / count) / mean_dn,
        mean_dn=mean_dn,
        mean_error_dn=float(np.std(means, ddof=1) / np.sqrt(count)),
        frames=count,
    )
