"""Joint law of degree and angle of linear polarization, and the circular statistics of the angle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from model.moments import checked_pair, require_covariance
from model.processing.dolp_distribution.cone import Border, density, directions
from model.processing.dolp_distribution.frame import dolp_frame
from model.processing.dolp_distribution.planar_sector import direction_density
from model.quadrature import integrate_panels
from model.stokes import aolp_rad, checked_stokes

FloatArray = NDArray[np.float64]

# Panel ends around a peak, in units of its width.
_GROWTH = np.concatenate([[0.0, 0.5, 1.5, 4.0], 4.0 * 3.0 ** np.arange(1.0, 32.0)])


@dataclass(frozen=True, kw_only=True)
class AngleStatistics:
    """Circular statistics of the angle of linear polarization, each of shape (...).

    Parameters
    ----------
    mean_rad
        Mean direction, half of the argument of E exp(2 i psi), in [0, pi).
    resultant
        |E exp(2 i psi)|: 1 for a known angle, 0 for an angle without preference.
    std_rad
        Circular standard deviation sqrt(-ln(resultant) / 2); grows without limit as the resultant goes to 0.
    first_order_std_rad
        What propagation of errors gives, sqrt(variance across the polarization) / (2 Q); infinite where Q = 0.
    """

    mean_rad: FloatArray
    resultant: FloatArray
    std_rad: FloatArray
    first_order_std_rad: FloatArray


def joint_pdf(x: ArrayLike, aolp: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return the joint density of DoLP and angle of polarization given S0 > 0.

    Parameters
    ----------
    x
        DoLP, >= 0 and finite.
    aolp
        Angle of polarization [rad]; period pi. Both broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3), of rank 2 at least, the plane of fluctuation not through zero light.

    Returns
    -------
    ndarray
        Density per unit of DoLP and radian; integrates to 1 over x >= 0 and an interval of length pi.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, x is negative, or the covariance leaves no joint density.

    References
    ----------
    L. Montier et al., A&A 574 (2015) A135, doi:10.1051/0004-6361/201322271, here for S0 > 0.
    """
    frame, law_shape = dolp_frame(stokes_mean, stokes_cov)
    if np.any(frame.radius_2 * np.hypot(frame.mean_0, frame.sigma_0) + np.abs(frame.excess_2) == 0.0):
        raise ValueError("stokes_cov is singular in a way that leaves no joint density of DoLP and angle")
    degree, angle = np.asarray(x, dtype=np.float64), np.asarray(aolp, dtype=np.float64)
    if np.any(~((degree >= 0.0) & np.isfinite(degree))):
        raise ValueError("x has values that are negative or not finite; allowed is a DoLP of 0 or more")
    shape = np.broadcast_shapes(degree.shape, angle.shape, law_shape)
    index = np.broadcast_to(np.arange(len(frame)).reshape(law_shape), shape).ravel()
    flat = np.broadcast_to(degree, shape).ravel()
    border = Border(frame=frame[index], a=np.ones_like(flat), b=flat)
    doubled = 2.0 * np.broadcast_to(angle, shape).ravel() - border.frame.axis_rad
    offset = doubled - np.arctan2(border.frame.mean_2, border.frame.mean_1)
    joint = 2.0 * density(border, directions(border, offset[:, None]))[:, 0] / ndtr(border.frame.snr_0)
    return np.asarray(joint.reshape(shape)[()])


def aolp_pdf(aolp: ArrayLike, stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> FloatArray:
    """Return the density of the angle of polarization.

    Parameters
    ----------
    aolp
        Angle [rad], period pi; broadcast against the leading axes of the other arguments.
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3); that of (S1, S2) must not be singular.

    Returns
    -------
    ndarray
        [rad^-1]; integrates to 1 over an interval of length pi. Whatever the sign of S0.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, or that of (S1, S2) is singular.

    References
    ----------
    Definition (projected normal distribution).
    """
    plane, law_shape = _plane(stokes_mean, stokes_cov)
    angle = np.asarray(aolp, dtype=np.float64)
    shape = np.broadcast_shapes(angle.shape, law_shape)
    index = np.broadcast_to(np.arange(plane.distance.size).reshape(law_shape), shape).ravel()
    doubled = 2.0 * np.broadcast_to(angle, shape).ravel()
    values = 2.0 * _angle_density(plane, index, doubled[:, None] - plane.mean_angle[index][:, None])[:, 0]
    return np.asarray(values.reshape(shape)[()])


def aolp_statistics(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> AngleStatistics:
    """Return mean direction, resultant length and circular standard deviation of the angle of polarization.

    Parameters
    ----------
    stokes_mean
        Mean of (S0, S1, S2), shape (..., 3), any unit.
    stokes_cov
        Covariance, shape (..., 3, 3); that of (S1, S2) must not be singular.

    Returns
    -------
    AngleStatistics
        By quadrature, to about 1e-10 of each deviation; whatever the sign of S0.

    Raises
    ------
    ValueError
        If the arguments are no mean and covariance, or that of (S1, S2) is singular.

    References
    ----------
    Definition.
    """
    plane, shape = _plane(stokes_mean, stokes_cov)

    def integrand(index: NDArray[np.int64], offset: FloatArray) -> FloatArray:
        weight = _angle_density(plane, index, offset)
        return np.stack([weight * 2.0 * np.sin(0.5 * offset) ** 2, weight * np.sin(offset)])

    found = integrate_panels(integrand, cuts=_cuts(plane), tolerance=1e-12, noise=np.full(plane.distance.size, 1e-13))
    lost, side = found.value[:, 0], found.value[:, 1]
    # |1 - lost + i side|, with the small loss kept apart so that a narrow law keeps its width.
    shrink = np.maximum(lost * (2.0 - lost) - side**2, 0.0)
    resultant = np.hypot(1.0 - lost, side)
    with np.errstate(divide="ignore"):
        std = 0.5 * np.sqrt(-np.log1p(-np.minimum(shrink, 1.0)))
        first = plane.across / (2.0 * plane.length)
    mean_angle = plane.mean_angle + np.arctan2(side, 1.0 - lost)
    direction = np.stack([np.ones_like(lost), np.cos(mean_angle), np.sin(mean_angle)], axis=-1)
    return AngleStatistics(
        mean_rad=aolp_rad(direction).reshape(shape)[()],
        resultant=resultant.reshape(shape)[()],
        std_rad=std.reshape(shape)[()],
        first_order_std_rad=first.reshape(shape)[()],
    )


@dataclass(frozen=True, kw_only=True)
class _Plane:
    """Gaussian (S1, S2), whitened, each parameter of shape (M,) or (M, 2, 2)."""

    whiten: NDArray[np.float64]
    mean_angle: FloatArray
    whitened_angle: FloatArray
    distance: FloatArray
    length: FloatArray
    across: FloatArray


def _plane(stokes_mean: ArrayLike, stokes_cov: ArrayLike) -> tuple[_Plane, tuple[int, ...]]:
    mean, cov = checked_pair(checked_stokes(stokes_mean), stokes_cov)
    require_covariance(cov, name="stokes_cov")
    shape = np.broadcast_shapes(mean.shape[:-1], cov.shape[:-2])
    center = np.broadcast_to(mean, (*shape, 3)).reshape(-1, 3)[:, 1:]
    block = np.broadcast_to(cov, (*shape, 3, 3)).reshape(-1, 3, 3)[:, 1:, 1:]
    values, vectors = np.linalg.eigh(block)
    if np.any(values[:, 0] <= 1e-14 * values[:, 1]):
        raise ValueError("covariance of S1 and S2 is singular: the angle of polarization has no density")
    whiten = np.swapaxes(vectors, 1, 2) / np.sqrt(values)[:, :, None]
    white = np.einsum("mij,mj->mi", whiten, center)
    length = np.hypot(center[:, 0], center[:, 1])
    angle = np.arctan2(center[:, 1], center[:, 0])
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return (
        _Plane(
            whiten=whiten,
            mean_angle=angle,
            whitened_angle=np.arctan2(white[:, 1], white[:, 0]),
            distance=np.hypot(white[:, 0], white[:, 1]),
            length=length,
            across=np.sqrt(np.einsum("mi,mij,mj->m", normal, block, normal)),
        ),
        shape,
    )


def _angle_density(plane: _Plane, index: NDArray[np.int64], offset: FloatArray) -> FloatArray:
    """Return the density of the doubled angle at an offset from that of the mean, shape (K, n)."""
    beta = plane.mean_angle[index][:, None] + offset
    direction = np.stack([np.cos(beta), np.sin(beta)], axis=-1)
    white = np.einsum("kij,knj->kni", plane.whiten[index], direction)
    squared = np.sum(white**2, axis=-1)
    jacobian = np.abs(np.linalg.det(plane.whiten[index]))[:, None] / squared
    angle = np.arctan2(white[..., 1], white[..., 0]) - plane.whitened_angle[index][:, None]
    return np.asarray(direction_density(plane.distance[index][:, None], angle) * jacobian)


def _cuts(plane: _Plane) -> FloatArray:
    """Return panel ends in the offset: around the mean, and around the long axis of a thin ellipse."""
    thin = 1.0 / np.linalg.cond(plane.whiten)
    long_axis = np.arctan2(plane.whiten[:, 1, 1], plane.whiten[:, 1, 0]) - plane.mean_angle
    marks = [np.tile(np.linspace(-np.pi, np.pi, 9), (thin.size, 1))]
    graded = np.concatenate([-_GROWTH[::-1], _GROWTH])
    marks.append(np.multiply.outer(thin / (1.0 + plane.distance), graded))
    for turn in (0.0, np.pi):
        centre = np.remainder(long_axis + turn + np.pi, 2.0 * np.pi) - np.pi
        marks.append(np.multiply.outer(thin, graded) + centre[:, None])
    return np.sort(np.clip(np.concatenate(marks, axis=1), -np.pi, np.pi), axis=1)
