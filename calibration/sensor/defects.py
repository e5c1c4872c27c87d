"""Pixels that are not like the others: in the dark, in the light, or in their noise."""

from dataclasses import dataclass
from enum import IntFlag

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from calibration.sensor.dark_signal import QUANTISATION_LIMIT_DN2
from calibration.sensor.frame_statistics import LevelPicture

SingleArray = NDArray[np.float32]

# Normal deviations are larger than this once in 5e8.
DEFECT_SIGMA = 6.0
_CHANCE = 2e-9
_NEIGHBOURHOOD = 5
_SIGMA_PER_MAD = 1.4826
# What is smaller is rounding [DN].
_LEAST_DN = 1.0
_MANY_PIXELS, _STEP = 100_000, 7


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
    """Which pixels are defect.

    Attributes
    ----------
    mask : (H, W) array of uint8
        Sum of the values of `Defect`, 0 for a good pixel.
    counts : dict
        Pixels of each kind, by its name in lower case; a pixel may be of several.
    n_defect : int
        Pixels of any kind.
    dark_limit_dn : float
        Hot and cold pixels are further from their neighbours than this [DN].
    response_limit : float
        Bright and weak pixels are further from their neighbours than this, relative.
    noise_limit_dn2 : float
        Noisy pixels have a larger temporal variance in the dark than this [DN^2].
    """

    mask: NDArray[np.uint8]
    counts: dict[str, int]
    n_defect: int
    dark_limit_dn: float
    response_limit: float
    noise_limit_dn2: float


def defect_map(dark: LevelPicture, flat: LevelPicture, *, n_dark_frames: int) -> DefectMap:
    """Return the pixels that are further from the others than 6 standard deviations.

    Parameters
    ----------
    dark, flat : LevelPicture
        Stacks without and with light, of one size.
    n_dark_frames : int
        Frames of the dark stack.

    Notes
    -----
    Hot and cold: by the dark mean; bright and weak: by the mean with light, dark taken off; each against the median of
    the 5 x 5 pixels around, so that uneven light does not count, and by a standard deviation from the median absolute
    deviation, which defects do not widen. Noisy: temporal variance in the dark, against the law of chi-squared with the
    degrees of freedom of consecutive differences. Jumping: a difference of two frames beyond 6 standard deviations,
    which may be a cosmic hit. Less than one count is no defect. The more frames a stack has, the smaller the defects
    that are seen.

    References
    ----------
    Definition. EMVA Standard 1288, Release 4.0 Linear, leaves the limits to the application.
    """
    of_dark = local_deviation(dark.mean_dn)
    response = flat.mean_dn - dark.mean_dn
    signal_dn = max(float(np.median(some_pixels(response))), 1.0)
    of_response = local_deviation(response) / np.float32(signal_dn)
    limits = _limit(of_dark, least=_LEAST_DN), _limit(of_response, least=_LEAST_DN / signal_dn)
    noise_limit = _noise_limit(dark.temporal_variance_dn2, n_dark_frames)
    found = {
        Defect.HOT: of_dark > limits[0],
        Defect.COLD: of_dark < -limits[0],
        Defect.BRIGHT: of_response > limits[1],
        Defect.WEAK: of_response < -limits[1],
        Defect.NOISY: dark.temporal_variance_dn2 > noise_limit,
        Defect.JUMPING: dark.outlier | flat.outlier,
    }
    mask = np.zeros(dark.mean_dn.shape, dtype=np.uint8)
    for defect, where in found.items():
        mask[where] |= defect.value
    return DefectMap(
        mask=mask,
        counts={str(defect.name).lower(): int(np.count_nonzero(where)) for defect, where in found.items()},
        n_defect=int(np.count_nonzero(mask)),
        dark_limit_dn=limits[0],
        response_limit=limits[1],
        noise_limit_dn2=noise_limit,
    )


def local_deviation(picture: SingleArray) -> SingleArray:
    """Return each pixel less the median of the 5 x 5 pixels around it."""
    deviation: SingleArray = picture - cv2.medianBlur(np.ascontiguousarray(picture), _NEIGHBOURHOOD)
    return deviation


def some_pixels(picture: SingleArray) -> SingleArray:
    """Return every so many-th pixel of a large picture: their median is as good, and there sooner."""
    # A step that shares no factor with the usual widths, so that all columns are met.
    step = _STEP if picture.size > _MANY_PIXELS else 1
    return picture.ravel()[::step]


def _limit(deviation: SingleArray, *, least: float) -> float:
    some = some_pixels(deviation)
    return max(DEFECT_SIGMA * _SIGMA_PER_MAD * float(np.median(np.abs(some - np.median(some)))), least)


def _noise_limit(variance_dn2: SingleArray, n_frames: int) -> float:
    """Return the variance that a pixel of median noise has once in 5e8."""
    differences = n_frames - 1
    # Consecutive differences share frames: two of n - 1 have a covariance of a quarter of their variance.
    freedom = 2.0 * differences**2 / (3.0 * n_frames - 4.0)
    per_freedom = float(np.median(some_pixels(variance_dn2))) / float(chdtri(freedom, 0.5))
    # Where rounding hides the noise, half of the pixels may never change, which does not make the others noisy.
    return max(per_freedom, QUANTISATION_LIMIT_DN2 / freedom) * float(chdtri(freedom, _CHANCE))
