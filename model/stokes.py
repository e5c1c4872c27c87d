"""Algebra of linear Stokes parameters, and their directions and axes.

S1 = horizontal - vertical, S2 = (+45 deg) - (-45 deg); angles counter-clockwise from horizontal
as the camera sees the scene ([MK14] eq. 11).

World axes are east, north, up. Zenith angles count from up, azimuths clockwise from north; a direction points from
the target to the sun, the sky or the camera. Along a ray that travels along k, h is horizontal and to the right of an
observer who looks toward the source of the light, v = k x h is up, and (h, v, k) is right-handed.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def dolp(stokes: ArrayLike) -> FloatArray:
    """Return the degree of linear polarization sqrt(S1^2 + S2^2) / S0.

    Parameters
    ----------
    stokes
        Shape (..., 3), S0 > 0.

    Returns
    -------
    ndarray
        Shape (...). Not clipped: noise may take it above 1.

    Raises
    ------
    ValueError
        If the last axis is not 3 long or a value of S0 is not positive.

    References
    ----------
    [MK14] eq. (5).
    """
    array = checked_stokes(stokes)
    require_positive_intensity(array)
    return np.asarray(np.hypot(array[..., 1], array[..., 2]) / array[..., 0])


def aolp_rad(stokes: ArrayLike) -> FloatArray:
    """Return the angle of linear polarization, half of the argument of S1 + i S2.

    Parameters
    ----------
    stokes
        Shape (..., 3).

    Returns
    -------
    ndarray
        Shape (...), [rad], in [0, pi). 0 for S1 = S2 = 0, where the angle is undefined.
    """
    array = checked_stokes(stokes)
    angle = 0.5 * np.arctan2(array[..., 2], array[..., 1])
    wrapped = np.where(angle < 0.0, angle + np.pi, angle)
    # A tiny negative angle plus pi rounds to pi itself, which is the direction 0.
    return np.asarray(np.where(wrapped >= np.pi, 0.0, wrapped) + 0.0)


def analyzer_row(angle_rad: ArrayLike, tau_parallel: ArrayLike = 1.0, tau_perpendicular: ArrayLike = 0.0) -> FloatArray:
    """Return the row of the system matrix of a linear polarizer in front of a detector.

    [MK14] eq. (11)-(14).
    """
    along = np.asarray(tau_parallel, dtype=np.float64)
    across = np.asarray(tau_perpendicular, dtype=np.float64)
    _require_transmittances(along, across)
    angle, total, difference = np.broadcast_arrays(
        np.asarray(angle_rad, dtype=np.float64), along + across, along - across
    )
    return 0.5 * np.stack([total, difference * np.cos(2.0 * angle), difference * np.sin(2.0 * angle)], axis=-1)


def rotate_frame(stokes: ArrayLike, angle_rad: ArrayLike) -> FloatArray:
    """Return the same light's Stokes parameters in axes turned by an angle."""
    turned: FloatArray = np.einsum("...ij,...j->...i", rotation(angle_rad), checked_stokes(stokes))
    return turned


def rotation(angle_rad: ArrayLike) -> FloatArray:
    """Return the matrix that expresses Stokes parameters in axes turned by an angle.

    Parameters
    ----------
    angle_rad
        Angle [rad] by which the new horizontal axis is turned counter-clockwise from the old one.

    Returns
    -------
    ndarray
        Shape (..., 3, 3). Applied to Stokes parameters it lowers the angle of polarization by `angle_rad`.
    """
    twice = 2.0 * np.asarray(angle_rad, dtype=np.float64)
    matrix = np.zeros((*twice.shape, 3, 3))
    matrix[..., 0, 0] = 1.0
    matrix[..., 1, 1] = matrix[..., 2, 2] = np.cos(twice)
    matrix[..., 1, 2] = np.sin(twice)
    matrix[..., 2, 1] = -np.sin(twice)
    return matrix


def checked_stokes(stokes: ArrayLike) -> FloatArray:
    """Return Stokes parameters as a float64 array with a last axis of length 3."""
    array = np.asarray(stokes, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"stokes has shape {array.shape}; allowed is (..., 3), that is S0, S1, S2")
    return array


def require_positive_intensity(stokes: FloatArray) -> None:
    """Raise unless S0 is positive everywhere."""
    bad = ~(stokes[..., 0] > 0.0)
    if np.any(bad):
        raise ValueError(
            f"S0 is not positive in {np.sum(bad)} of {bad.size} places "
            f"(lowest {np.min(stokes[..., 0]):.3g}); DoLP needs S0 > 0: mask those places"
        )


def direction(*, zenith_rad: ArrayLike, azimuth_rad: ArrayLike) -> FloatArray:
    """Return the unit vector of a direction given by its angles."""
    angles = finite_angle("zenith_rad", zenith_rad), finite_angle("azimuth_rad", azimuth_rad)
    zenith, azimuth = np.broadcast_arrays(*angles)
    sine = np.sin(zenith)
    return np.stack([sine * np.sin(azimuth), sine * np.cos(azimuth), np.cos(zenith)], axis=-1)


def angle_between_rad(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Return the angle between two directions.

    Definition: 2 atan2(|a - b|, |a + b|).
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    apart = np.linalg.norm(a - b, axis=-1)
    return np.asarray(2.0 * np.arctan2(apart, np.linalg.norm(a + b, axis=-1)))


def horizontal_axis(azimuth_rad: ArrayLike, *, travels_to_target: bool) -> FloatArray:
    """Return h, the horizontal axis of the Stokes parameters of a ray between target and a point of an azimuth.

    Definition: unit(up x k).
    """
    azimuth = finite_angle("azimuth_rad", azimuth_rad)
    sign = 1.0 if travels_to_target else -1.0
    return np.stack([sign * np.cos(azimuth), -sign * np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)


def axis_rotation_rad(from_axis: ArrayLike, to_axis: ArrayLike, *, travel: ArrayLike) -> FloatArray:
    """Return the angle by which one transverse axis is turned from another."""
    start, end = np.asarray(from_axis, dtype=np.float64), np.asarray(to_axis, dtype=np.float64)
    upright = np.cross(np.asarray(travel, dtype=np.float64), start)
    return np.asarray(np.arctan2(np.sum(upright * end, axis=-1), np.sum(start * end, axis=-1)))


def _require_transmittances(along: FloatArray, across: FloatArray) -> None:
    if np.any(~((across >= 0.0) & (across <= along) & (along <= 1.0))):
        raise ValueError(
            f"tau_parallel = {along} and tau_perpendicular = {across}; "
            "allowed is 0 <= tau_perpendicular <= tau_parallel <= 1 (power transmittances)"
        )


def finite_angle(name: str, value: ArrayLike) -> FloatArray:
    """Return angles as a float64 array; raise ValueError unless all are finite."""
    angle = np.asarray(value, dtype=np.float64)
    if not np.all(np.isfinite(angle)):
        raise ValueError(f"{name} = {angle[~np.isfinite(angle)].flat[0]} rad; allowed are finite angles")
    return angle
