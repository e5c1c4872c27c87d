"""Gaussian Stokes parameters in the frame in which the distribution of DoLP is computed.

Units are divided out, and the axes of (S1, S2) are turned to the principal axes of their covariance given S0. Then

    S0 = m0 + s z0,   S1 = m1 + c1 z0 + r1 z1,   S2 = m2 + c2 z0 + r2 z2

with independent standard normal z and r1 >= r2 >= 0, for singular covariances too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.moments import checked_pair, require_covariance
from model.processing.dolp_distribution.double_double import product

FloatArray = NDArray[np.float64]

_NO_LIGHT = 1e-60


@dataclass(frozen=True, kw_only=True)
class DolpFrame:
    """Parameters of M Gaussian distributions, each of shape (M,), in units of `unit`.

    Parameters
    ----------
    mean_0, mean_1, mean_2
        Mean of S0, S1, S2.
    sigma_0
        Standard deviation of S0.
    slope_1, slope_2
        Change of S1 and S2 per standard deviation of S0.
    radius_1, radius_2
        Standard deviation of S1 and S2 given S0, the larger one first.
    excess_1, excess_2
        sigma_0 mean_j - slope_j mean_0: zero where S0 and Sj fluctuate by a common factor. Kept apart because the
        difference loses digits.
    axis_rad
        Angle of the frame's first axis in the (S1, S2) plane (twice an angle of polarization) [rad].
    unit
        What all else is divided by, in the unit of the Stokes parameters.
    """

    mean_0: FloatArray
    mean_1: FloatArray
    mean_2: FloatArray
    sigma_0: FloatArray
    slope_1: FloatArray
    slope_2: FloatArray
    radius_1: FloatArray
    radius_2: FloatArray
    excess_1: FloatArray
    excess_2: FloatArray
    axis_rad: FloatArray
    unit: FloatArray

    def __len__(self) -> int:
        return int(self.mean_0.size)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> "DolpFrame":
        return DolpFrame(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})

    @property
    def snr_0(self) -> FloatArray:
        """Mean over standard deviation of S0; infinite where S0 is known."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.mean_0 / self.sigma_0)

    @property
    def polarized(self) -> FloatArray:
        """Length of the mean of (S1, S2)."""
        return np.asarray(np.hypot(self.mean_1, self.mean_2))


def dolp_frame(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> tuple[DolpFrame, tuple[int, ...]]:
    """Return the frames of Gaussian Stokes parameters, flattened, and the shape of their leading axes.

    Parameters
    ----------
    stokes_mean
        Shape (..., 3), any unit.
    stokes_cov
        Shape (..., 3, 3), positive semi-definite, in the square of that unit.

    Returns
    -------
    frame
        One entry per distribution.
    shape
        Broadcast leading axes of the arguments.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance of three components, or S0 > 0 has no probability.
    """
    mean, cov = checked_pair(stokes_mean, stokes_cov)
    if mean.shape[-1] != 3:
        raise ValueError(f"stokes_mean has shape {mean.shape}; allowed is (..., 3), that is S0, S1, S2")
    require_covariance(cov, name="stokes_cov")
    shape = np.broadcast_shapes(mean.shape[:-1], cov.shape[:-2])
    flat_mean = np.broadcast_to(mean, (*shape, 3)).reshape(-1, 3)
    flat_cov = np.broadcast_to(cov, (*shape, 3, 3)).reshape(-1, 3, 3)
    dark = (flat_mean[:, 0] <= 0.0) & (flat_cov[:, 0, 0] <= 0.0)
    if np.any(dark):
        raise ValueError(f"S0 > 0 has no probability in {np.sum(dark)} places: mean <= 0 and no variance")
    return _framed(flat_mean, flat_cov), shape


def _framed(mean: FloatArray, cov: FloatArray) -> DolpFrame:
    unit = np.hypot(mean[:, 0], np.sqrt(np.maximum(cov[:, 0, 0], 0.0)))
    # A power of two, so that scaling rounds nothing.
    unit = np.exp2(np.round(np.log2(unit)))
    mu = mean / unit[:, None]
    sigma = 0.5 * (cov + np.swapaxes(cov, 1, 2)) / unit[:, None, None] ** 2
    sigma_0 = np.sqrt(np.maximum(sigma[:, 0, 0], 0.0))
    # A mean of exactly zero has no direction; any will do.
    mu[:, 0] = np.where(np.any(mu != 0.0, axis=1), mu[:, 0], _NO_LIGHT * sigma_0)
    radius_1, radius_2, axis = _principal(sigma)
    known = sigma_0 == 0.0
    divisor = np.where(known, 1.0, sigma_0)
    slopes = np.where(known[:, None], 0.0, sigma[:, 0, 1:] / divisor[:, None])
    excess = _excess(mu, sigma) / divisor[:, None]
    mean_1, mean_2 = _turned(mu[:, 1:], axis)
    slope_1, slope_2 = _turned(slopes, axis)
    excess_1, excess_2 = _turned(np.where(known[:, None], 0.0, excess), axis)
    return DolpFrame(
        mean_0=mu[:, 0],
        mean_1=mean_1,
        mean_2=mean_2,
        sigma_0=sigma_0,
        slope_1=slope_1,
        slope_2=slope_2,
        radius_1=radius_1,
        radius_2=radius_2,
        excess_1=excess_1,
        excess_2=excess_2,
        axis_rad=axis,
        unit=unit,
    )


def _turned(plane: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    cos, sin = np.cos(axis), np.sin(axis)
    return cos * plane[:, 0] + sin * plane[:, 1], cos * plane[:, 1] - sin * plane[:, 0]


def _excess(mu: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return var(S0) mean_j - cov(S0, Sj) mean_0, with the cancellation done exactly."""
    variance, mean_0 = sigma[:, :1, 0], mu[:, :1]
    return np.asarray((product(variance, mu[:, 1:]) - product(sigma[:, 0, 1:], mean_0)).value)


def _principal(sigma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return both standard deviations of (S1, S2) given S0, and the angle of the larger one.

    Schur complement and determinant cancel for correlated parameters and thin ellipses: they are taken in twice
    the working precision, so that the result is right for the covariance as given.
    """
    variance = np.where(sigma[:, 0, 0] > 0.0, sigma[:, 0, 0], 1.0)
    link_1, link_2 = sigma[:, 0, 1], sigma[:, 0, 2]
    first = product(variance, sigma[:, 1, 1]) - product(link_1, link_1)
    cross = product(variance, sigma[:, 1, 2]) - product(link_1, link_2)
    second = product(variance, sigma[:, 2, 2]) - product(link_2, link_2)
    determinant = (first * second - cross * cross).value / variance**2
    trace = (first + second).value / variance
    difference = (first - second).value / variance
    twice_cross = 2.0 * cross.value / variance
    larger = 0.5 * (trace + np.hypot(difference, twice_cross))
    safe = np.where(larger > 0.0, larger, 1.0)
    smaller = np.clip(determinant / safe, 0.0, np.maximum(larger, 0.0))
    axis = 0.5 * np.arctan2(twice_cross, difference)
    return np.sqrt(np.maximum(larger, 0.0)), np.sqrt(smaller), axis
