"""The fixed pattern of the pixels that are like the others: without hot, dead and otherwise defect ones."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.sensor.pattern_parts import small_scale_variance
from calibration.sensor.variance_moments import VarianceMoments, variance_moments

SingleArray = NDArray[np.float32]

# A pixel this many standard deviations from the others is a defect: of a million ordinary ones, none.
_DEFECT_SIGMA = 6.0
_SIGMA_OF_MEDIAN = 1.4826
# More than this share is no matter of single pixels, but of shading or structure: nothing is left out then.
_MOST_DEFECTS = 0.03
# So many pixels show the median well enough: to 2 % of a standard deviation.
_SHOWN = 4096
_ROUNDING_STD_DN = 12.0**-0.5


@dataclass(frozen=True, kw_only=True)
class OrdinaryPattern:
    """The fixed pattern without defects.

    Attributes
    ----------
    variance_dn2, std_error_dn2 : float
        Variance from pixel to pixel of what stays the same in time [DN^2]; may be below 0 by its error.
    temporal_cov_dn4 : float
        Covariance of its error with that of the temporal variance [DN^4].
    small_scale_variance_dn2 : float
        The same without what is smooth on a sixteenth of the picture [DN^2].
    left_out : int
        Pixels that are more than 6 standard deviations from the others, as the median absolute deviation has it.
    """

    variance_dn2: float
    std_error_dn2: float
    temporal_cov_dn4: float
    small_scale_variance_dn2: float
    left_out: int


def ordinary_pattern(
    squares: SingleArray,
    deviations: SingleArray,
    *,
    kept: NDArray[np.bool_] | None,
    moments: VarianceMoments,
    small_scale_dn2: float | None,
    n_frames: int,
) -> OrdinaryPattern:
    """Return the fixed pattern of a level without its defect pixels.

    Parameters
    ----------
    squares, deviations : (H, W) arrays of float32
        Sum of the squared differences of each pixel [DN^2], and its mean less that of all [DN].
    kept : (H, W) array of bool or None
        Pixels without an outlier in time; None means all.
    moments : VarianceMoments
        Of the pixels without an outlier, defects among them.
    small_scale_dn2 : float or None
        What `small_scale_variance` says of all pixels [DN^2].
    n_frames : int
        At least 2.
    """
    noise_dn2 = moments.temporal_dn2 / n_frames
    defect = _defects(deviations, least_std_dn=float(np.hypot(np.sqrt(noise_dn2), _ROUNDING_STD_DN)))
    left_out = 0
    if defect is not None:
        ordinary = ~defect if kept is None else kept & ~defect
        # From the mean of the ordinary ones: that of all holds the defects.
        deviations = np.where(defect, np.float32(0.0), deviations - deviations[ordinary].mean(dtype=np.float64))
        deviations = deviations.astype(np.float32)
        moments = variance_moments(squares[ordinary], deviations[ordinary], n_frames=n_frames)
        left_out, small_scale_dn2 = int(np.count_nonzero(defect)), small_scale_variance(deviations)
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
