"""Directional-hemispherical reflectance of the specular lobe."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.surface import fresnel
from model.surface.angle_checks import checked_zenith
from model.surface.facet_quadrature import facet_nodes
from model.surface.lobe import Lobe
from model.surface.shadowing import shadowed_prefactor

FloatArray = NDArray[np.float64]

# Nodes along x of each panel: a rule is trusted when it agrees with the one before it.
_ORDERS = (24, 36, 54, 82, 124)
_TOLERANCE = 1e-8
_ROWS_AT_ONCE = 64


@dataclass(frozen=True, kw_only=True)
class HemisphericalReflectance:
    """Share of the incident light that goes into the hemisphere.

    Parameters
    ----------
    s0
        For unpolarised light.
    s1
        What a unit of S1 adds to it: reflected power is s0 S0 + s1 S1. S2 adds nothing, by symmetry.
    error
        Estimated absolute error of both.
    """

    s0: FloatArray
    s1: FloatArray
    error: FloatArray


def lobe_reflectance(theta_i_rad: ArrayLike, *, lobe: Lobe, tolerance: float = _TOLERANCE) -> HemisphericalReflectance:
    """Return the directional-hemispherical reflectance of a specular lobe and its estimated error.

    Parameters
    ----------
    theta_i_rad
        Zenith angle of the incident light [rad], any shape, 0 to pi/2.
    tolerance
        Rules are refined until two agree to this, absolute (relative where the reflectance exceeds 1).

    Returns
    -------
    HemisphericalReflectance
        Arrays of the shape of `theta_i_rad`.

    Raises
    ------
    ValueError
        If an angle is outside its range.

    Notes
    -----
    The error is the difference between the last two rules. Where the finest does not reach the tolerance (real n
    below 1: a critical angle) it says so.
    Without shadowing the reflectance passes 1 near grazing and grows as 1 / cos theta.

    References
    ----------
    Definition: integral of f00 cos theta_r over the hemisphere, as an integral over facet slopes.
    """
    angles = checked_zenith("theta_i_rad", theta_i_rad)
    flat = np.minimum(angles.ravel(), 0.5 * np.pi)
    if np.any(angles > 0.5 * np.pi):
        raise ValueError(f"theta_i_rad = {np.max(angles):.6g} rad; allowed is 0 to pi/2")
    parts = [
        _refined(flat[start : start + _ROWS_AT_ONCE], lobe, tolerance) for start in range(0, flat.size, _ROWS_AT_ONCE)
    ]
    s0, s1, error = np.concatenate([np.empty((3, 0)), *parts], axis=1).reshape(3, *angles.shape)
    return HemisphericalReflectance(s0=s0, s1=s1, error=error)


def _refined(theta_rad: FloatArray, lobe: Lobe, tolerance: float) -> FloatArray:
    """Rows s0, s1, error; only angles that have not converged meet the next rule."""
    result = np.zeros((3, theta_rad.size))
    result[:2] = _integrals(theta_rad, lobe, _ORDERS[0])
    open_rows = np.arange(theta_rad.size)
    for order in _ORDERS[1:]:
        finer = _integrals(theta_rad[open_rows], lobe, order)
        result[2, open_rows] = np.max(np.abs(finer - result[:2, open_rows]), axis=0)
        result[:2, open_rows] = finer
        rough = result[2, open_rows] > tolerance * np.maximum(1.0, finer[0])
        open_rows = open_rows[rough]
        if open_rows.size == 0:
            break
    return result


def _integrals(theta_rad: FloatArray, lobe: Lobe, order: int) -> FloatArray:
    """Reflectance for S0 and for S1, shape (2, T), by one rule."""
    nodes = facet_nodes(theta_rad, slope_rms=lobe.slope_rms, shadowing=lobe.shadowing, order=order)
    cos_i, sin_i = np.cos(theta_rad)[nodes.row, None], np.sin(theta_rad)[nodes.row, None]
    seen = cos_i + nodes.x * sin_i
    secant2 = 1.0 + nodes.x**2 + nodes.y**2
    # Above the horizon by the choice of nodes; rounding at the rim may say otherwise.
    cos_r = np.maximum(2.0 * seen / secant2 - cos_i, 1e-40)
    across, lean = nodes.y**2, (sin_i - nodes.x * cos_i) ** 2
    cos2_psi = seen**2 / secant2
    prefactor = shadowed_prefactor(
        cos_i=cos_i,
        sin_i=sin_i,
        cos_r=cos_r,
        sin_r=np.sqrt(np.maximum(1.0 - cos_r**2, 0.0)),
        mean_cosine=seen / secant2,
        cos2_psi=cos2_psi,
        slope_rms=lobe.slope_rms,
        shadowing=lobe.shadowing,
    )
    m00, m01, _ = fresnel.mueller_elements(cos2_psi=cos2_psi, n=lobe.n, k=lobe.k)
    visible = 4.0 * prefactor * cos_r * seen * nodes.weight
    cos_2eta = np.divide(lean - across, lean + across, out=np.ones_like(m01), where=lean + across > 0.0)
    strips = (np.sum(visible * m00, axis=1), np.sum(visible * m01 * cos_2eta, axis=1))
    return np.stack([np.bincount(nodes.row, strip, minlength=theta_rad.size) for strip in strips])
