"""Directions, azimuths and the horizontal axes of Stokes parameters.

World axes are east, north, up. Zenith angles count from up, azimuths clockwise from north; a direction points from
the target to the sun, the sky or the camera. Along a ray that travels along k, h is horizontal and to the right of
who looks back to where the light comes from, v = k x h is up, and (h, v, k) is right-handed.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def direction(*, zenith_rad: ArrayLike, azimuth_rad: ArrayLike) -> FloatArray:
    """Return the unit vector of a direction given by its angles.

    Parameters
    ----------
    zenith_rad
        Angle from up [rad].
    azimuth_rad
        Clockwise from north [rad].

    Returns
    -------
    ndarray
        Shape (..., 3): east, north, up; the angles broadcast.

    Raises
    ------
    ValueError
        If an angle is not finite.
    """
    zenith, azimuth = np.broadcast_arrays(_angle("zenith_rad", zenith_rad), _angle("azimuth_rad", azimuth_rad))
    sine = np.sin(zenith)
    return np.stack([sine * np.sin(azimuth), sine * np.cos(azimuth), np.cos(zenith)], axis=-1)


def angle_between_rad(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Return the angle between two directions.

    Parameters
    ----------
    first, second
        Unit vectors, shape (..., 3), broadcast.

    Returns
    -------
    ndarray
        Shape (...), [rad], 0 to pi; keeps its digits at 0 and at pi, where an arccosine would lose half of them.

    References
    ----------
    Definition: 2 atan2(|a - b|, |a + b|).
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    apart = np.linalg.norm(a - b, axis=-1)
    return np.asarray(2.0 * np.arctan2(apart, np.linalg.norm(a + b, axis=-1)))


def horizontal_axis(azimuth_rad: ArrayLike, *, travels_to_target: bool) -> FloatArray:
    """Return h, the horizontal axis of the Stokes parameters of a ray between target and a point of an azimuth.

    Parameters
    ----------
    azimuth_rad
        Azimuth of the point (sun, sky or camera) as seen from the target, clockwise from north [rad].
    travels_to_target
        True for light that comes from the point, False for light that goes to it.

    Returns
    -------
    ndarray
        Shape (..., 3). Defined by the azimuth also for a point at the zenith.

    Raises
    ------
    ValueError
        If an angle is not finite.

    References
    ----------
    Definition: unit(up x k).
    """
    azimuth = _angle("azimuth_rad", azimuth_rad)
    sign = 1.0 if travels_to_target else -1.0
    return np.stack([sign * np.cos(azimuth), -sign * np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)


def axis_rotation_rad(from_axis: ArrayLike, to_axis: ArrayLike, *, travel: ArrayLike) -> FloatArray:
    """Return the angle by which one transverse axis is turned from another.

    Parameters
    ----------
    from_axis, to_axis
        Unit vectors perpendicular to the ray, shape (..., 3).
    travel
        Unit vector k along which the light travels, shape (..., 3).

    Returns
    -------
    ndarray
        Shape (...), [rad], in [-pi, pi], counter-clockwise for who looks back along the ray to its source; the
        argument of `model.stokes.rotation`.
    """
    start, end = np.asarray(from_axis, dtype=np.float64), np.asarray(to_axis, dtype=np.float64)
    upright = np.cross(np.asarray(travel, dtype=np.float64), start)
    return np.asarray(np.arctan2(np.sum(upright * end, axis=-1), np.sum(start * end, axis=-1)))


def _angle(name: str, value: ArrayLike) -> FloatArray:
    angle = np.asarray(value, dtype=np.float64)
    if not np.all(np.isfinite(angle)):
        raise ValueError(f"{name} = {angle[~np.isfinite(angle)].flat[0]} rad; allowed are finite angles")
    return angle
