"""Check of the DoLP of a region's pixels against the distribution that the region's own Stokes moments give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.processing import dolp
from model.stokes import dolp as degree_of_polarization

FloatArray = NDArray[np.float64]

# Pairs (i, j) of a symmetric 3 x 3 matrix that are free.
_FREE = tuple((i, j) for i in range(3) for j in range(i, 3))
# Step of a numerical derivative in units of the pixels' own deviation.
_STEP = 1e-3
_TOLERANCE = 1e-7


@dataclass(frozen=True, kw_only=True)
class DistributionCheck:
    """One statistic of the pixels' DoLP, by the distribution and by the pixels, with the error of the difference."""

    predicted: float
    measured: float
    std_error: float


def check_dolp_distribution(
    frame_stokes: ArrayLike, mean_stokes: ArrayLike, added_cov: ArrayLike
) -> dict[str, DistributionCheck]:
    """Return mean, deviation and SNR of the pixels' DoLP beside those of the Gaussian distribution of their moments.

    Parameters
    ----------
    frame_stokes
        Stokes parameters of one cycle's pixels, shape (3, P), every S0 above 0; any unit.
    mean_stokes
        The same pixels in the mean of all cycles, shape (3, P); equal to `frame_stokes` where there is one cycle.
    added_cov
        What the noise of one cycle adds to the covariance of the mean of all, shape (3, 3); zero where there is one.

    Returns
    -------
    dict
        "mean", "std" and "snr".

    Raises
    ------
    ValueError
        The distribution has no moments: S0 is not bounded away from zero.

    Notes
    -----
    Both sides come from the same pixels, so the error of the difference is far smaller than that of either. It is
    taken from the scatter of each pixel's influence on the difference (infinitesimal jackknife).

    References
    ----------
    [MK14] eq. (21)-(29); Efron, B. (1982), "The Jackknife, the Bootstrap and Other Resampling Plans",
    doi:10.1137/1.9781611970319.
    """
    frame, mean = np.asarray(frame_stokes, dtype=np.float64), np.asarray(mean_stokes, dtype=np.float64)
    moments = _pack(mean.mean(axis=1), np.cov(mean, bias=True))
    added = np.asarray(added_cov, dtype=np.float64)
    distribution = _distribution(moments, added)
    influence_of_moments = _influence_on_moments(mean, moments).T @ _gradient(moments, added).T
    values = np.asarray(degree_of_polarization(frame.T))
    found = _statistics(float(values.mean()), float(values.std()))
    influence = _influence_on_statistics(values) - influence_of_moments
    errors = influence.std(axis=0) / np.sqrt(values.size)
    return {
        name: DistributionCheck(predicted=float(distribution[k]), measured=float(found[k]), std_error=float(errors[k]))
        for k, name in enumerate(("mean", "std", "snr"))
    }


def _statistics(mean: float, std: float) -> FloatArray:
    return np.array([mean, std, mean / std])


def _distribution(packed: FloatArray, added: FloatArray) -> FloatArray:
    distribution = dolp.moments(packed[:3], _unpack_cov(packed) + added, tolerance=_TOLERANCE)
    if not bool(distribution.exists):
        raise ValueError(f"mean and deviation of the pixels' DoLP do not exist: {distribution.reason}")
    return _statistics(float(distribution.mean), float(distribution.std))


def _pack(mean: FloatArray, cov: FloatArray) -> FloatArray:
    return np.concatenate([mean, [cov[i, j] for i, j in _FREE]])


def _unpack_cov(packed: FloatArray) -> FloatArray:
    cov = np.empty((3, 3))
    for value, (i, j) in zip(packed[3:], _FREE, strict=True):
        cov[i, j] = cov[j, i] = value
    return cov


def _influence_on_moments(pixels: FloatArray, packed: FloatArray) -> FloatArray:
    """Return how much each pixel shifts each of the nine moments, shape (9, P)."""
    off = pixels - packed[:3, None]
    products = np.stack([off[i] * off[j] for i, j in _FREE])
    return np.concatenate([off, products - packed[3:, None]])


def _influence_on_statistics(values: FloatArray) -> FloatArray:
    """Return how much each pixel shifts mean, deviation and their ratio, shape (P, 3)."""
    mean, std = values.mean(), values.std()
    on_mean = values - mean
    on_std = (on_mean**2 - std**2) / (2.0 * std)
    return np.stack([on_mean, on_std, on_mean / std - mean * on_std / std**2], axis=1)


def _gradient(packed: FloatArray, added: FloatArray) -> FloatArray:
    """Return the derivative of the distribution's three statistics by the nine moments, shape (3, 9)."""
    deviations = np.sqrt(np.diag(_unpack_cov(packed) + added))
    scales = np.concatenate([deviations, [deviations[i] * deviations[j] for i, j in _FREE]])
    columns = []
    for k, scale in enumerate(scales):
        step = np.zeros(9)
        step[k] = _STEP * scale
        columns.append((_distribution(packed + step, added) - _distribution(packed - step, added)) / (2.0 * step[k]))
    return np.stack(columns, axis=1)
