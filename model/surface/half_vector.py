"""Geometry of one reflection by a facet, in forms that lose no digits anywhere on the hemisphere."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Below this squared sine of the angle between the rays the facet's plane of incidence is taken from h_i. The
# matrix then errs by less than this number, since r_s + r_p is of second order in that angle.
_COINCIDENT = 1e-28


@dataclass(frozen=True, kw_only=True)
class HalfVectorGeometry:
    """Angles between sun, sensor and the facet that mirrors one into the other; arrays of one shape.

    Parameters
    ----------
    cos_i, sin_i, cos_r, sin_r
        Of the zenith angles of sun and sensor.
    cos2_psi
        Squared cosine of the angle of incidence on the facet.
    mean_cosine
        (cos_i + cos_r) / 2, which is cos psi times the cosine of the facet's own zenith angle.
    tan2_beta
        Squared slope of the facet.
    cos_2eta_i, sin_2eta_i, cos_2eta_r, sin_2eta_r
        Of twice the angle from the horizontal axis h to the facet's s axis, incident and reflected ray.
    """

    cos_i: FloatArray
    sin_i: FloatArray
    cos_r: FloatArray
    sin_r: FloatArray
    cos2_psi: FloatArray
    mean_cosine: FloatArray
    tan2_beta: FloatArray
    cos_2eta_i: FloatArray
    sin_2eta_i: FloatArray
    cos_2eta_r: FloatArray
    sin_2eta_r: FloatArray


def half_vector_geometry(theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray) -> HalfVectorGeometry:
    """Return the facet geometry of the directions to sun and sensor.

    Parameters
    ----------
    theta_i_rad, theta_r_rad
        Zenith angles [rad], both in [0, pi/2).
    phi_rad
        Azimuth of the sensor minus that of the sun [rad], counter-clockwise from above; pi is forward.

    Returns
    -------
    HalfVectorGeometry
        Arrays of the common shape.

    Notes
    -----
    With p, m = (theta_i +- theta_r) / 2 the squared quantities are sums of terms that are not negative:
    cos^2 psi = cos^2 p + sin_i sin_r cos^2(phi/2), and likewise the facet's slope. The s axis comes from the half
    vector's components along (h, v) of each ray, made of the same differences in both, so that it is one axis to the
    last digit near retro-reflection. No angle is ever formed.

    References
    ----------
    Definition; the dyadic form of the microfacet Jones matrix of Priest and Germer (2000), whose rotation
    angles [MK14] takes over.
    """
    sin_i, cos_i = np.sin(theta_i_rad), np.cos(theta_i_rad)
    sin_r, cos_r = np.sin(theta_r_rad), np.cos(theta_r_rad)
    m = 0.5 * (theta_i_rad - theta_r_rad)
    sin_m, cos_m = np.sin(m), np.cos(m)
    mean_cosine = 0.5 * (cos_i + cos_r)
    # Not from the cosine of the mean angle, whose own rounding shows where both rays graze.
    cos_p = mean_cosine / cos_m
    sin_half, cos_half = np.sin(0.5 * phi_rad), np.cos(0.5 * phi_rad)
    sin2_half = sin_half * sin_half
    forward = sin_i * sin_r * cos_half * cos_half
    across = -2.0 * sin_half * cos_half
    difference = 2.0 * sin_m * cos_m
    eta_i = _double_angle(sin_r * across, difference + 2.0 * cos_i * sin_r * sin2_half)
    eta_r = _double_angle(sin_i * across, 2.0 * sin_i * cos_r * sin2_half - difference)
    _resolve_coincident_rays(eta_i, eta_r, phi_rad)
    return HalfVectorGeometry(
        cos_i=cos_i,
        sin_i=sin_i,
        cos_r=cos_r,
        sin_r=sin_r,
        cos2_psi=cos_p * cos_p + forward,
        mean_cosine=mean_cosine,
        tan2_beta=((cos_p * sin_m) ** 2 + forward) / (mean_cosine * mean_cosine),
        cos_2eta_i=eta_i[0],
        sin_2eta_i=eta_i[1],
        cos_2eta_r=eta_r[0],
        sin_2eta_r=eta_r[1],
    )


_DoubleAngle = tuple[FloatArray, FloatArray, NDArray[np.bool_]]


def _double_angle(along_h: FloatArray, along_v: FloatArray) -> _DoubleAngle:
    """Cosine and sine of twice the angle of the axis perpendicular to (along_h, along_v); where undefined."""
    h2, v2 = along_h * along_h, along_v * along_v
    norm2 = h2 + v2
    undefined = norm2 < _COINCIDENT
    norm2[undefined] = 1.0
    return (v2 - h2) / norm2, -2.0 * along_h * along_v / norm2, undefined


def _resolve_coincident_rays(eta_i: _DoubleAngle, eta_r: _DoubleAngle, phi_rad: FloatArray) -> None:
    """Let s = h_i in both frames where sun and sensor stand in one line."""
    lost = eta_i[2] | eta_r[2]
    if not np.any(lost):
        return
    eta_i[0][lost], eta_i[1][lost] = 1.0, 0.0
    eta_r[0][lost], eta_r[1][lost] = np.cos(2.0 * phi_rad[lost]), -np.sin(2.0 * phi_rad[lost])
