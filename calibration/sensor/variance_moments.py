"""Temporal and spatial variance over the pixels of a level, and how well both are known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Pixels that are worked on at a time; a scalar product of so few is not given to threads.
_BLOCK_PIXELS = 8192


@dataclass(frozen=True, kw_only=True)
class VarianceMoments:
    """Means over pixels of temporal and spatial variance, and the covariance of their errors.

    Attributes
    ----------
    n_pixels : int
        Pixels.
    mean_dn : float
        Mean over pixels and frames [DN].
    temporal_dn2, spatial_dn2 : float
        Variances [DN^2].
    temporal_error_dn4, spatial_error_dn4, covariance_dn4 : float
        Variances of the errors of these two, and their covariance [DN^4].
    """

    n_pixels: int
    mean_dn: float
    temporal_dn2: float
    spatial_dn2: float
    temporal_error_dn4: float
    spatial_error_dn4: float
    covariance_dn4: float


def variance_moments(
    square_sums: NDArray[np.float32], sample_sums: NDArray[np.uint32], *, n_frames: int
) -> VarianceMoments:
    """Return temporal and spatial variance of a level.

    Parameters
    ----------
    square_sums : (n,) array of float32
        Sum over consecutive frames of the squared difference of each pixel, the mean difference taken off [DN^2].
    sample_sums : (n,) array of uint32
        Sum of the samples of each pixel [DN].
    n_frames : int
        At least 2.
    """
    n = sample_sums.size
    total = int(sample_sums.sum(dtype=np.uint64))
    sums = _sums(square_sums, sample_sums, centre=total / n)
    # The mean of each takes one degree of freedom.
    correction = n / (n - 1)
    # Temporal and spatial variance of a pixel, by its squared differences and its squared deviation from the mean.
    weights = correction * np.array([[0.5 / (n_frames - 1), 0.0], [-0.5 / (n_frames - 1) / n_frames, n_frames**-2]])
    means = sums[:2] / n
    scatter = (np.array([[sums[2], sums[3]], [sums[3], sums[4]]]) / n - np.outer(means, means)) / (n - 1)
    errors = weights @ scatter @ weights.T
    temporal, spatial = weights @ means
    return VarianceMoments(
        n_pixels=n,
        mean_dn=total / (n * n_frames),
        temporal_dn2=float(temporal),
        spatial_dn2=float(spatial),
        temporal_error_dn4=max(float(errors[0, 0]), 0.0),
        spatial_error_dn4=max(float(errors[1, 1]), 0.0),
        covariance_dn4=float(errors[0, 1]),
    )


def _sums(square_sums: NDArray[np.float32], sample_sums: NDArray[np.uint32], *, centre: float) -> NDArray[np.float64]:
    """Return the sums of squared differences, of squared deviations, and of the products of both."""
    sums = np.zeros(5)
    for start in range(0, sample_sums.size, _BLOCK_PIXELS):
        block = slice(start, start + _BLOCK_PIXELS)
        temporal = square_sums[block].astype(np.float64)
        spatial = sample_sums[block] - centre
        spatial *= spatial
        sums += (
            temporal.sum(),
            spatial.sum(),
            np.dot(temporal, temporal),
            np.dot(temporal, spatial),
            np.dot(spatial, spatial),
        )
    return sums
