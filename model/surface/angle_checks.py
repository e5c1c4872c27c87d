"""Checks of the angles that functions of this room are given."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def checked_zenith(name: str, angle_rad: ArrayLike) -> FloatArray:
    """Return zenith angles as a float64 array.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    angle_rad
        Zenith angle [rad], any shape, 0 to pi.

    Returns
    -------
    ndarray
        The same values.

    Raises
    ------
    ValueError
        If a value is not finite or outside 0 to pi.
    """
    angle = _finite(name, angle_rad)
    outside = (angle < 0.0) | (angle > np.pi)
    if np.any(outside):
        raise ValueError(
            f"{name} = {angle[outside].flat[0]:.6g} rad; allowed is 0 to pi, counted from the surface normal. "
            "The other side of the normal is the azimuth's business: add pi to phi_rad"
        )
    return angle


def checked_azimuth(name: str, angle_rad: ArrayLike) -> FloatArray:
    """Return azimuths as a float64 array.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    angle_rad
        Azimuth [rad], any shape, any finite value.

    Returns
    -------
    ndarray
        The same values.

    Raises
    ------
    ValueError
        If a value is not finite.
    """
    return _finite(name, angle_rad)


def _finite(name: str, angle_rad: ArrayLike) -> FloatArray:
    angle = np.asarray(angle_rad, dtype=np.float64)
    if not np.all(np.isfinite(angle)):
        bad = angle[~np.isfinite(angle)].flat[0]
        raise ValueError(f"{name} = {bad} rad; allowed are finite angles")
    return angle
