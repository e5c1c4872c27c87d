"""Ratios that do not depend on scale, to first order: s1 = S1/S0, s2 = S2/S0, AoLP, and counts over their mean."""

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


def channel_ratios(channels: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the counts of each channel over the mean of all channels, and their standard errors to first order.

    Parameters
    ----------
    channels
        Mean counts, shape (N,), dark level taken off, with their covariance.

    Raises
    ------
    ValueError
        The mean of all channels is not above 0.

    Notes
    -----
    N ratios of which N - 1 are free: their mean is 1.
    """
    whole = float(channels.mean.mean())
    if not whole > 0.0:
        raise ValueError(f"the mean of all channels is {whole:.3g}; a ratio needs it above 0")
    ratios = channels.mean / whole
    count = channels.mean.size
    jacobian = (np.eye(count) - ratios[:, None] / count) / whole
    variances = np.einsum("ij,jk,ik->i", jacobian, channels.cov, jacobian)
    # Of an error that is common to all channels only rounding is left, of either sign.
    return ratios, np.sqrt(np.maximum(variances, 0.0))
