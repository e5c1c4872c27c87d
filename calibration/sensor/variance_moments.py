"""Temporal and spatial variance over the pixels of a level, and how well both are known."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import starmap

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]

_BLOCK_PIXELS = 49152


@dataclass(frozen=True, kw_only=True)
class VarianceMoments:
    """Means over pixels of temporal and spatial variance, and the covariance of their errors.

    Attributes
    ----------
    n_pixels : int
        Pixels.
    temporal_dn2, spatial_dn2 : float
        Variances [DN^2].
    temporal_error_dn4, spatial_error_dn4, covariance_dn4 : float
        Variances of the errors of these two, and their covariance [DN^4].
    """

    n_pixels: int
    temporal_dn2: float
    spatial_dn2: float
    temporal_error_dn4: float
    spatial_error_dn4: float
    covariance_dn4: float


def variance_moments(square_sums: SingleArray, deviations: SingleArray, *, n_frames: int) -> VarianceMoments:
    """Return temporal and spatial variance of a level.

    Parameters
    ----------
    square_sums : array of float32
        Sum over consecutive frames of the squared difference of each pixel, the mean difference taken off [DN^2].
    deviations : array of float32
        Mean of each pixel less that of all, same shape [DN].
    n_frames : int
        At least 2.
    """
    n = deviations.size
    sums = sum(starmap(_sums, _blocks(square_sums.ravel(), deviations.ravel())), np.zeros(5))
    # The mean of each takes one degree of freedom.
    correction = n / (n - 1)
    # Temporal and spatial variance of a pixel, by its squared differences and its squared deviation from the mean.
    weights = correction * np.array([[0.5 / (n_frames - 1), 0.0], [-0.5 / (n_frames - 1) / n_frames, 1.0]])
    means = sums[:2] / n
    scatter = (np.array([[sums[2], sums[3]], [sums[3], sums[4]]]) / n - np.outer(means, means)) / (n - 1)
    errors = weights @ scatter @ weights.T
    temporal, spatial = weights @ means
    return VarianceMoments(
        n_pixels=n,
        temporal_dn2=float(temporal),
        spatial_dn2=float(spatial),
        temporal_error_dn4=max(float(errors[0, 0]), 0.0),
        spatial_error_dn4=max(float(errors[1, 1]), 0.0),
        covariance_dn4=float(errors[0, 1]),
    )


def _blocks(square_sums: SingleArray, deviations: SingleArray) -> Iterator[tuple[SingleArray, SingleArray]]:
    """Yield both so few pixels at a time that they stay in the processor's cache, the deviations squared."""
    for start in range(0, deviations.size, _BLOCK_PIXELS):
        block = slice(start, start + _BLOCK_PIXELS)
        yield square_sums[block], np.square(deviations[block])


def _sums(temporal: SingleArray, spatial: SingleArray) -> FloatArray:
    """Return the sums of both, and of their products: of the first's square, of both, of the second's square."""
    # OpenCV adds in double precision, and without threads that would cost more than they save.
    of_temporal, of_spatial = cv2.norm(temporal, cv2.NORM_L2SQR), cv2.norm(spatial, cv2.NORM_L2SQR)
    of_difference = cv2.norm(temporal, spatial, cv2.NORM_L2SQR)
    return np.array(
        [
            cv2.sumElems(temporal)[0],
            cv2.sumElems(spatial)[0],
            of_temporal,
            0.5 * (of_temporal + of_spatial - of_difference),
            of_spatial,
        ]
    )
