"""Saturation of a sensor: the signal at which its temporal variance is largest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# A fall of the variance by this much is saturation; real points scatter by a per cent or two.
_FALL = 0.1


@dataclass(frozen=True, kw_only=True)
class SaturationLevel:
    """The signal of largest variance, between two levels of a sweep.

    Attributes
    ----------
    signal_dn, std_error_dn : float
        Middle of the interval, and the standard deviation of a value evenly likely within it [DN].
    lower, upper : int
        The two levels that enclose it.
    """

    signal_dn: float
    std_error_dn: float
    lower: int
    upper: int


def saturation_level(*, signal_dn: FloatArray, variance_dn2: FloatArray) -> SaturationLevel | None:
    """Return the signal at which the temporal variance is largest, None if the sweep does not show it rise and fall.

    Parameters
    ----------
    signal_dn : (n,) array
        Mean less dark mean [DN], ascending.
    variance_dn2 : (n,) array
        Temporal variance less that of the dark [DN^2].

    Notes
    -----
    The variance rises with the signal and then falls within a few of its own square roots; between two levels
    of a sweep its course is not known. What is known: the peak is below the first level
    whose variance is a tenth less than the largest that was seen (less than that may be scatter), and not below the
    signal at which the rise, in proportion from the level before, has that largest variance. The
    result is the middle of this interval, and its error is the interval's.

    References
    ----------
    EMVA Standard 1288, Release 4.0 Linear, section 6.7, which takes the sampled level itself.
    """
    peak = int(np.argmax(variance_dn2))
    fallen = np.flatnonzero(variance_dn2[peak:] < (1.0 - _FALL) * variance_dn2[peak])
    if peak == 0 or fallen.size == 0:
        return None
    upper = peak + int(fallen[0])
    low = float(signal_dn[peak])
    if variance_dn2[peak - 1] > 0.0:
        low = min(low, float(variance_dn2[peak] * signal_dn[peak - 1] / variance_dn2[peak - 1]))
    high = float(signal_dn[upper])
    return SaturationLevel(
        signal_dn=0.5 * (low + high), std_error_dn=(high - low) / np.sqrt(12.0), lower=peak, upper=upper
    )
