"""Polarimetric bidirectional reflectance of a rough surface: F = B f_spec + f_d."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.surface.angle_checks import checked_azimuth, checked_zenith
from model.surface.diffuse import DIFFUSE, Diffuse, DiffuseKind, add_diffuse, reflectance_at
from model.surface.half_vector import half_vector_geometry
from model.surface.lobe import Lobe, write_specular
from model.surface.shadowing import Shadowing

FloatArray = NDArray[np.float64]

# One block of geometries at a time keeps the intermediate arrays in the processor's cache.
_BLOCK = 8192
# A DHR may miss the lobe's own share by this much and count as equal to it: the share's quadrature error.
_DHR_ROUNDING = 1e-7


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A rough surface: facets with Gaussian slopes over a diffusely scattering body.

    Parameters
    ----------
    n, k
        Real and imaginary part of the refractive index n + ik; 0 < n <= 1e9, 0 <= k <= 1e9.
    slope_rms
        Standard deviation of the facet slope along one axis, at least 1e-3.
    dhr
        Directional-hemispherical reflectance of unpolarised light, 0 to 1, specular part included. None: the surface
        has no diffuse term.
    dhr_angle_rad
        Zenith angle at which `dhr` was measured [rad], 0 to below pi/2.
    shadowing
        "none", "v-cavity", "smith" or "smith-correlated".
    diffuse
        "lambert", "balance", "coupled" or "polarised"; see `model.surface.diffuse.add_diffuse`.
    specular_weight
        B, share of the surface that shows the lobe (dust and pores hide the rest), 0 to 1.

    Raises
    ------
    ValueError
        If a value is outside its range, or `dhr` is below what the lobe alone reflects.
    """

    n: float
    k: float = 0.0
    slope_rms: float
    dhr: float | None = None
    dhr_angle_rad: float = math.radians(8.0)
    shadowing: Shadowing = "v-cavity"
    diffuse: DiffuseKind = "coupled"
    specular_weight: float = 1.0

    def __post_init__(self) -> None:
        lobe = self.lobe
        if self.diffuse not in DIFFUSE:
            raise ValueError(f"diffuse = {self.diffuse!r}; allowed are {', '.join(map(repr, DIFFUSE))}")
        if not 0.0 <= self.specular_weight <= 1.0:
            raise ValueError(f"specular_weight = {self.specular_weight}; allowed is 0 to 1")
        if not 0.0 <= self.dhr_angle_rad < 0.5 * math.pi:
            raise ValueError(f"dhr_angle_rad = {self.dhr_angle_rad} rad; allowed is 0 to below pi/2")
        if self.dhr is not None:
            _require_dhr(self.dhr, self.specular_weight, reflectance_at(lobe, self.dhr_angle_rad), self.dhr_angle_rad)

    @property
    def lobe(self) -> Lobe:
        """The specular lobe."""
        return Lobe(n=self.n, k=self.k, slope_rms=self.slope_rms, shadowing=self.shadowing)

    @property
    def diffuse_term(self) -> Diffuse | None:
        """The diffuse term; None without a DHR."""
        if self.dhr is None:
            return None
        lobe = self.lobe
        specular = self.specular_weight * reflectance_at(lobe, self.dhr_angle_rad)
        return Diffuse(
            kind=self.diffuse,
            lobe=lobe,
            specular_weight=self.specular_weight,
            excess=max(self.dhr - specular, 0.0),
            dhr_angle_rad=self.dhr_angle_rad,
        )


def mueller(theta_i_rad: ArrayLike, theta_r_rad: ArrayLike, phi_rad: ArrayLike, *, surface: Surface) -> FloatArray:
    """Return the linear Mueller matrix of reflection per solid angle, the pBRDF F.

    Parameters
    ----------
    theta_i_rad
        Zenith angle of the sun, or of a point of the sky, from the surface normal [rad], 0 to pi.
    theta_r_rad
        Zenith angle of the sensor [rad], 0 to pi.
    phi_rad
        Azimuth(sun) - azimuth(sensor), azimuths clockwise from north [rad]; any finite value. pi is forward.

    Returns
    -------
    ndarray
        Shape (..., 3, 3) [sr^-1], the angles broadcast. Rows are outgoing, columns incoming S0, S1, S2, both in
        axes h (horizontal, to the right of who looks along the ray back to its source) and v = k x h.

    Raises
    ------
    ValueError
        If an angle is not finite or a zenith angle is outside 0 to pi.

    Notes
    -----
    At and beyond the horizon (zenith angle pi/2 and more) F is zero; just above it F grows as 1 / cos^2. At
    theta_r = 0 the axes h, v are those of the azimuth given, so that F turns with phi while S0 and DoLP do not.
    phi and -phi differ in the sign of F02, F12, F20, F21.

    References
    ----------
    [MK14] section II-A, eq. (2); Priest and Meier (2002), Optical Engineering 41(5), 988-993.
    Differs from [MK14]: half-vector form instead of the rotation angles' arccosines, shadowing, choice of the diffuse
    term, weight of the lobe; sign and frame of S1 and S2, which the paper leaves open, as said here.
    """
    return evaluate(
        theta_i_rad,
        theta_r_rad,
        phi_rad,
        lobe=surface.lobe,
        specular_weight=surface.specular_weight,
        diffuse=surface.diffuse_term,
    )


def evaluate(
    theta_i_rad: ArrayLike,
    theta_r_rad: ArrayLike,
    phi_rad: ArrayLike,
    *,
    lobe: Lobe,
    specular_weight: float,
    diffuse: Diffuse | None,
) -> FloatArray:
    """Return the pBRDF of a lobe and a diffuse term that need not form a possible surface.

    Parameters
    ----------
    theta_i_rad, theta_r_rad, phi_rad
        As in `mueller`.
    lobe, specular_weight, diffuse
        The parts. A fit passes through combinations, such as a DHR below the lobe's, that `Surface` refuses.

    Returns
    -------
    ndarray
        Shape (..., 3, 3) [sr^-1].

    Raises
    ------
    ValueError
        As `mueller`.

    References
    ----------
    As `mueller`.
    """
    angles = np.broadcast_arrays(
        checked_zenith("theta_i_rad", theta_i_rad),
        checked_zenith("theta_r_rad", theta_r_rad),
        checked_azimuth("phi_rad", phi_rad),
    )
    flat = [np.ravel(angle) for angle in angles]
    out = np.empty((flat[0].size, 3, 3))
    for start in range(0, flat[0].size, _BLOCK):
        block = slice(start, start + _BLOCK)
        theta_i, theta_r, phi = (angle[block] for angle in flat)
        hidden = (theta_i >= 0.5 * np.pi) | (theta_r >= 0.5 * np.pi)
        # At or below the horizon: computed as for the normal, then set to zero.
        theta_i, theta_r = np.where(hidden, 0.0, theta_i), np.where(hidden, 0.0, theta_r)
        write_specular(out[block], half_vector_geometry(theta_i, theta_r, phi), lobe=lobe, weight=specular_weight)
        if diffuse is not None:
            add_diffuse(out[block], theta_i, theta_r, diffuse=diffuse)
        out[block][hidden] = 0.0
    return out.reshape(*angles[0].shape, 3, 3)


def _require_dhr(dhr: float, weight: float, lobe_reflectance: float, angle_rad: float) -> None:
    if not 0.0 <= dhr <= 1.0:
        raise ValueError(f"dhr = {dhr}; allowed is 0 to 1, or None for no diffuse term")
    specular = weight * lobe_reflectance
    if specular > dhr + _DHR_ROUNDING:
        raise ValueError(
            f"dhr = {dhr:g} is inconsistent: at {math.degrees(angle_rad):.3g} deg the specular lobe alone reflects "
            f"{specular:.4f}. Lower specular_weight to at most {dhr / lobe_reflectance:.3f} (dust or pores hide "
            "part of the facets), take a smaller index, or raise dhr"
        )
