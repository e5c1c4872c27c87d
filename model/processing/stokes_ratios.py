"""First-order moments of what a Stokes vector is like whatever the scale: s1 = S1/S0, s2 = S2/S0, and AoLP."""

import numpy as np
from numpy.typing import NDArray

from model.moments import Moments, propagate_first_order
from model.stokes import aolp_rad

FloatArray = NDArray[np.float64]


def normalized_moments(stokes: Moments) -> Moments:
    """Return first-order moments of (S1/S0, S2/S0).

    Parameters
    ----------
    stokes
        Moments of one Stokes vector, shape (3,), S0 > 0.

    Raises
    ------
    ValueError
        S0 is not above 0.

    References
    ----------
    Definition; delta method.
    """
    s0, s1, s2 = _with_light(stokes)
    jacobian = np.array([[-s1 / s0**2, 1.0 / s0, 0.0], [-s2 / s0**2, 0.0, 1.0 / s0]])
    return propagate_first_order(stokes, np.array([s1 / s0, s2 / s0]), jacobian)


def aolp_moments_rad(stokes: Moments) -> Moments:
    """Return first-order moments, one component, of the AoLP of a Stokes vector [rad].

    Parameters
    ----------
    stokes
        Moments of one Stokes vector, shape (3,), polarised.

    Returns
    -------
    Moments
        Mean in [0, pi). The deviation means something only where it is small against 1 rad.

    Raises
    ------
    ValueError
        S0 is not above 0, or S1 = S2 = 0: there is no angle.

    References
    ----------
    Definition; delta method.
    """
    _, s1, s2 = _with_light(stokes)
    squared = s1 * s1 + s2 * s2
    if squared == 0.0:
        raise ValueError("S1 and S2 are both 0: unpolarised light has no angle of polarization")
    jacobian = np.array([[0.0, -s2 / (2.0 * squared), s1 / (2.0 * squared)]])
    return propagate_first_order(stokes, np.array([float(aolp_rad(stokes.mean))]), jacobian)


def _with_light(stokes: Moments) -> FloatArray:
    if not stokes.mean[0] > 0.0:
        raise ValueError(f"S0 is {stokes.mean[0]:g}; normalised Stokes parameters need S0 above 0")
    return stokes.mean
