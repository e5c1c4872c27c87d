"""Fresnel reflection of a plane interface between air and a medium of index n + ik."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
AmplitudeArray = NDArray[np.inexact]


def amplitudes(*, cos2_psi: FloatArray, n: float, k: float) -> tuple[AmplitudeArray, AmplitudeArray]:
    """Return the amplitude reflection coefficients r_s and r_p.

    Parameters
    ----------
    cos2_psi
        Squared cosine of the angle of incidence, above 0.
    n, k
        Real and imaginary part of the index, n > 0, k >= 0.

    Returns
    -------
    tuple of ndarray
        r_s and r_p, real where k = 0 and n >= 1, complex otherwise.

    Notes
    -----
    Right-handed triads, so r_p = -r_s at normal incidence. The numerators are written as differences of
    squares, which keeps all digits at Brewster's angle and for an index near 1.

    References
    ----------
    Definition (Fresnel's equations).
    """
    c = np.sqrt(cos2_psi)
    # m^2 - 1. Above 1 a real index gives a real root; below it there is a critical angle and the root turns
    # imaginary. The imaginary part is then +0, and the root is the one that decays into the medium.
    real = (n - 1.0) * (n + 1.0) - k * k
    excess = real if k == 0.0 and n >= 1.0 else complex(real, 2.0 * n * k)
    w = np.sqrt(excess + cos2_psi)
    r_s = -excess / (c + w) ** 2
    r_p = excess * ((excess + 2.0) * cos2_psi - 1.0) / ((excess + 1.0) * c + w) ** 2
    return r_s, r_p


def mueller_elements(*, cos2_psi: FloatArray, n: float, k: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return M00 = M11, M01 = M10 and M22 of reflection in the axes of the plane of incidence.

    Parameters
    ----------
    cos2_psi
        Squared cosine of the angle of incidence, above 0.
    n, k
        Real and imaginary part of the index, n > 0, k >= 0.

    Returns
    -------
    tuple of ndarray
        (Rs + Rp) / 2, (Rs - Rp) / 2 and Re(r_s r_p*); the other elements of the 3 x 3 matrix are zero.

    Notes
    -----
    M22 is negative below Brewster's angle: a mirror turns +45 deg into -45 deg.
    """
    r_s, r_p = amplitudes(cos2_psi=cos2_psi, n=n, k=k)
    if np.iscomplexobj(r_s):
        power_s = r_s.real**2 + r_s.imag**2
        power_p = r_p.real**2 + r_p.imag**2
        cross = r_s.real * r_p.real + r_s.imag * r_p.imag
    else:
        power_s, power_p, cross = r_s.real**2, r_p.real**2, r_s.real * r_p.real
    return 0.5 * (power_s + power_p), 0.5 * (power_s - power_p), cross
