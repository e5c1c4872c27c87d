"""Energy balance of a surface: reflected share of the light, and whether a description is possible."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.surface.angle_checks import checked_zenith
from model.surface.diffuse import diffuse_row
from model.surface.pbrdf import Surface
from model.surface.reflectance import HemisphericalReflectance, lobe_reflectance
from model.surface.reflectance_table import reflectance_table

FloatArray = NDArray[np.float64]

_SCAN_RAD = np.radians(np.append(np.arange(0.0, 89.0, 1.0), [89.0, 89.5, 89.9]))
# Far above the quadrature error, far below what a measurement of reflectance could tell.
_ENERGY_SLACK = 1e-6


def hemispherical_reflectance(theta_i_rad: ArrayLike, *, surface: Surface) -> HemisphericalReflectance:
    """Return the directional-hemispherical reflectance of a surface, specular and diffuse.

    Parameters
    ----------
    theta_i_rad
        Zenith angle of the incident light [rad], any shape, 0 to below pi/2.

    Returns
    -------
    HemisphericalReflectance
        Arrays of the shape of `theta_i_rad`. The light that is reflected best is polarised horizontally or
        vertically; s0 + |s1| of it is reflected.

    Raises
    ------
    ValueError
        If an angle is outside its range.

    References
    ----------
    Definition: integral of F00 cos theta_r (and F01 cos theta_r) over the hemisphere.
    """
    angles = checked_zenith("theta_i_rad", theta_i_rad)
    if np.any(angles >= 0.5 * np.pi):
        raise ValueError(f"theta_i_rad = {np.max(angles):.6g} rad; allowed is 0 to below pi/2")
    lobe = lobe_reflectance(angles, lobe=surface.lobe)
    weight, term = surface.specular_weight, surface.diffuse_term
    s0, s1, error = weight * lobe.s0, weight * lobe.s1, weight * lobe.error
    if term is not None:
        row = diffuse_row(angles.ravel(), diffuse=term).reshape(2, *angles.shape)
        s0, s1, error = s0 + row[0], s1 + row[1], error + weight * _diffuse_error(surface)
    return HemisphericalReflectance(s0=s0, s1=s1, error=error)


def findings(surface: Surface) -> tuple[str, ...]:
    """Return what is wrong with a surface as a description of matter, in words; empty if nothing is.

    Parameters
    ----------
    surface
        At one wavelength.

    Returns
    -------
    tuple of str
        One sentence each: reflecting more than is received (for unpolarised light, for the worst polarization),
        a diffuse term that has run out. Whether the DHR is below the lobe's own is asked when a `Surface` is made.

    Notes
    -----
    Angles of incidence are tried every degree up to 89 and at 89.5 and 89.9 degrees.
    """
    total = hemispherical_reflectance(_SCAN_RAD, surface=surface)
    limit = 1.0 + _ENERGY_SLACK + total.error
    remedy = (
        'shadowing="none" loses no light to neighbouring facets: choose "v-cavity" or a Smith form'
        if surface.shadowing == "none"
        else 'choose diffuse="polarised", which conserves energy for every polarization, or lower dhr'
    )
    reflected = {"polarised light": total.s0 + np.abs(total.s1), "unpolarised light": total.s0}
    excessive = {light: _first_angle_deg(share > limit) for light, share in reflected.items()}
    found = [
        f"reflects more than it receives of {light} from {angle:g} deg on; {remedy}"
        for light, angle in excessive.items()
        if angle is not None
    ]
    return (*found, *_spent_diffuse(surface))


def _spent_diffuse(surface: Surface) -> list[str]:
    term = surface.diffuse_term
    if term is None or term.kind != "balance":
        return []
    spent = _first_angle_deg(diffuse_row(_SCAN_RAD, diffuse=term)[0] == 0.0)
    if spent is None:
        return []
    angle = f"the specular lobe alone exceeds dhr = {surface.dhr:g} from {spent:g} deg on"
    return [f'{angle}: no diffuse term is left there; choose diffuse="coupled" or lower specular_weight']


def _diffuse_error(surface: Surface) -> float:
    """Return the error of the diffuse part: two of its kinds rest on the series for E."""
    return reflectance_table(surface.lobe).error if surface.diffuse in ("balance", "coupled") else 1e-8


def _first_angle_deg(condition: NDArray[np.bool_]) -> float | None:
    where = np.nonzero(condition)[0]
    return float(np.degrees(_SCAN_RAD[where[0]])) if where.size else None
