"""Polarized reflectance (pBRDF) of rough surfaces: a specular lobe and a diffuse term, on level and tilted panels.

`mueller` gives the Mueller matrix F = B f_lobe + f_diffuse of a `Surface` between two directions. The lobe is made of
facets (`model.surface.facets`). The diffuse term is light that enters the body below them and leaves it again; it is
scaled such that the directional-hemispherical reflectance (DHR) is the one measured at an angle theta_m. A measured
table (`model.surface.table`) stands for both. `findings` says where a surface reflects more than it receives.

Diffuse terms, with E the reflectance of the lobe, B its weight and x = DHR - B E(theta_m):

- "lambert": f00 = x / pi. Reciprocal; a bright glossy surface reflects more than it receives near grazing.
- "balance": f00 = max(0, DHR - B E(theta_i)) / pi, so that the total is DHR at all angles of incidence up to the
  one where the lobe alone exceeds it. Conserves energy; not reciprocal.
- "coupled": f00 = rho (1 - B E(theta_i)) (1 - B E(theta_r)) / (pi mean(1 - B E)), rho = x / (1 - B E(theta_m)).
  Reciprocal, total B E + rho (1 - B E) <= 1. Without shadowing E passes 1 near grazing; there 1 - B E counts as 0.
- "polarised": f = rho t(theta_r) t(theta_i)^T / pi, t = ((T_s + T_p) / 2, (T_s - T_p) / 2, 0),
  T = 1 - B |r|^2 of the mean plane: light enters, loses its polarization and leaves. Reciprocal; conserves
  energy for every polarization of the light that comes in.
- "volume": f = T(theta_r) f_1 T(theta_i) + x c(theta_r) c(theta_i)^T / (pi mean(c0)). T is the Fresnel
  transmission of the mean plane, (1 - B |r|^2) as a Mueller matrix. f_1 = w P H(cos theta_i) H(cos theta_r) /
  (4 pi (cos theta_i + cos theta_r)) is light of a half-space that keeps the pattern of one scattering. P00 is the
  phase function of Henyey and Greenstein, P01 = single_dolp P00(90 deg) sin^2 that of a dipole,
  P11 = (1 - depolarization) P00, P22 = P11 2 cos / (1 + cos^2) of the scattering angle.
  H(mu) = (1 + 2 mu) / (1 + 2 mu sqrt(1 - w (1 - depolarization))) adds light that was scattered several times and
  is still polarized. c = (1, 0) - (what lobe and f_1 send up of S0 and S1) is scattered often, and loses its
  polarization except for the way in and out. x is the share of it that gives the DHR. Reciprocal; the total of
  every polarization is at most 1.

"balance": Hyde, Schmidt and Havrilla (2009), doi:10.1364/OE.17.022138, with the measured DHR in place of
a perfect reflector's. "coupled": Kelemen and Szirmay-Kalos (2001), Eurographics short presentations. "polarised":
Baek et al. (2018), doi:10.1145/3272127.3275018. "volume": Chandrasekhar, Radiative Transfer (1960); in his solution
for polarized light all terms that depend on the azimuth have the form of f_1. Approximate H, and the
split into f_1 and a remainder: Hapke (1981), doi:10.1029/JB086iB04p03039; under an interface: Germer (2003), Proc.
SPIE 5158, 193; remainder as in "coupled".
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from model import stokes as geometry
from model.numerics import gauss_legendre
from model.surface.facets import (
    HemisphericalReflectance,
    Lobe,
    Shadowing,
    chebyshev_nodes,
    chebyshev_series,
    checked_zenith,
    half_vector_geometry,
    lobe_reflectance,
    mueller_elements,
    reflectance_at,
    reflectance_table,
    write_rotated,
    write_specular,
)
from model.surface.table import TabulatedBrdf

FloatArray = NDArray[np.float64]
DiffuseKind = Literal["lambert", "balance", "coupled", "polarised", "volume"]
DIFFUSE: tuple[DiffuseKind, ...] = get_args(DiffuseKind)
ASYMMETRY_MOST = 0.8


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
        "lambert", "balance", "coupled", "polarised" or "volume"; see the head of this module.
    specular_weight
        B, share of the surface that shows the lobe (dust and pores hide the rest), 0 to 1.
    single_scattering
        Of "volume": weight w of the light that keeps the pattern of one scattering, 0 to 1.
    asymmetry
        Of "volume": mean cosine of the angle by which a particle scatters, -0.8 to 0.8.
    single_dolp
        Of "volume": degree of polarization of unpolarised light that one particle scatters by 90 deg, 0 to 1, and
        less the larger the asymmetry and the smaller the depolarization.
    depolarization
        Of "volume": share of polarized light that a particle depolarizes, 0 to 1.
    table
        A measured surface in place of lobe and diffuse term; `specular_weight` is 0 then, and `dhr` None.
    table_f00, table_s1, table_s2
        Errors of the table in its standard errors: of F00, and of S1/S0 and S2/S0 in the plane of scattering.

    Raises
    ------
    ValueError
        If a value is outside its range, or `dhr` is below what the lobe, or lobe and single scattering, reflect.
    """

    n: float
    k: float = 0.0
    slope_rms: float
    dhr: float | None = None
    dhr_angle_rad: float = math.radians(8.0)
    shadowing: Shadowing = "v-cavity"
    diffuse: DiffuseKind = "coupled"
    specular_weight: float = 1.0
    single_scattering: float = 0.0
    asymmetry: float = 0.0
    single_dolp: float = 0.0
    depolarization: float = 0.0
    table: TabulatedBrdf | None = None
    table_f00: float = 0.0
    table_s1: float = 0.0
    table_s2: float = 0.0

    def __post_init__(self) -> None:
        _require_ranges(self)
        if self.dhr is not None:
            _require_dhr(self, self.dhr)

    @cached_property
    def lobe(self) -> Lobe:
        """The specular lobe."""
        return Lobe(n=self.n, k=self.k, slope_rms=self.slope_rms, shadowing=self.shadowing)

    @property
    def has_diffuse(self) -> bool:
        """True if anything but the lobe reflects light."""
        return self.dhr is not None or self.table is not None

    @cached_property
    def excess(self) -> float:
        """Share of the light that the DHR leaves to the diffuse term, at the angle of the DHR."""
        specular = self.specular_weight * reflectance_at(self.lobe, self.dhr_angle_rad)
        return max((self.dhr or 0.0) - specular, 0.0)


# Quadrature error of the lobe's share: a DHR that is lower by no more than this counts as equal to it.
_DHR_ROUNDING = 1e-7
# One block of geometries at a time keeps the intermediate arrays in the processor's cache.
_BLOCK = 8192


def mueller(
    theta_i_rad: ArrayLike,
    theta_r_rad: ArrayLike,
    phi_rad: ArrayLike,
    *,
    surface: Surface,
    lobe: bool = True,
    diffuse: bool = True,
) -> FloatArray:
    """Return the linear Mueller matrix of reflection per solid angle, the pBRDF F.

    Parameters
    ----------
    theta_i_rad
        Zenith angle of the sun, or of a point of the sky, from the surface normal [rad], 0 to pi.
    theta_r_rad
        Zenith angle of the sensor [rad], 0 to pi.
    phi_rad
        Azimuth(sun) - azimuth(sensor), azimuths clockwise from north [rad]; any finite value. pi is forward.
    lobe, diffuse
        False leaves out the specular lobe or the diffuse term.

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
    angles = np.broadcast_arrays(
        checked_zenith("theta_i_rad", theta_i_rad),
        checked_zenith("theta_r_rad", theta_r_rad),
        geometry.finite_angle("phi_rad", phi_rad),
    )
    flat = [np.ravel(angle) for angle in angles]
    out = np.zeros((flat[0].size, 3, 3))
    for start in range(0, flat[0].size, _BLOCK):
        block = slice(start, start + _BLOCK)
        theta_i, theta_r, phi = (angle[block] for angle in flat)
        hidden = (theta_i >= 0.5 * np.pi) | (theta_r >= 0.5 * np.pi)
        # At or below the horizon: computed as for the normal, then set to zero.
        theta_i, theta_r = np.where(hidden, 0.0, theta_i), np.where(hidden, 0.0, theta_r)
        if lobe and surface.specular_weight > 0.0:
            facets = half_vector_geometry(theta_i, theta_r, phi)
            write_specular(out[block], facets, lobe=surface.lobe, weight=surface.specular_weight)
        if diffuse and surface.has_diffuse:
            _add_diffuse(out[block], theta_i, theta_r, phi, surface)
        out[block][hidden] = 0.0
    return out.reshape(*angles[0].shape, 3, 3)


_SCAN_RAD = np.radians(np.append(np.arange(0.0, 89.0, 1.0), [89.0, 89.5, 89.9]))
# Far above the quadrature error, and far below the error of any measured reflectance.
_ENERGY_SLACK = 1e-6


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
        "the table's scale is off, or its angles are too few"
        if surface.table is not None
        else 'shadowing="none" loses no light to neighbouring facets: choose "v-cavity" or a Smith form'
        if surface.shadowing == "none"
        else 'choose diffuse="volume" or "polarised", which conserve energy for every polarization, or lower dhr'
    )
    reflected = {"polarised light": total.s0 + np.abs(total.s1), "unpolarised light": total.s0}
    excessive = {light: _first_angle_deg(share > limit) for light, share in reflected.items()}
    found = [
        f"reflects more than it receives of {light} from {angle:g} deg on; {remedy}"
        for light, angle in excessive.items()
        if angle is not None
    ]
    if surface.diffuse == "balance" and surface.dhr is not None:
        spent = _first_angle_deg(_diffuse_row(_SCAN_RAD, surface)[0] == 0.0)
        if spent is not None:
            found.append(
                f"the specular lobe alone exceeds dhr = {surface.dhr:g} from {spent:g} deg on: no diffuse term is left "
                'there; choose diffuse="coupled" or lower specular_weight'
            )
    return tuple(found)


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
    weight = surface.specular_weight
    s0, s1, error = weight * lobe.s0, weight * lobe.s1, weight * lobe.error
    if surface.has_diffuse:
        row = _diffuse_row(angles.ravel(), surface).reshape(2, *angles.shape)
        s0, s1, error = s0 + row[0], s1 + row[1], error + _diffuse_error(surface)
    return HemisphericalReflectance(s0=s0, s1=s1, error=error)


def _first_angle_deg(condition: NDArray[np.bool_]) -> float | None:
    where = np.nonzero(condition)[0]
    return float(np.degrees(_SCAN_RAD[where[0]])) if where.size else None


def _require_ranges(surface: Surface) -> None:
    surface.lobe  # noqa: B018  its record has ranges of its own
    if surface.diffuse not in DIFFUSE:
        raise ValueError(f"diffuse = {surface.diffuse!r}; allowed are {', '.join(map(repr, DIFFUSE))}")
    for name in ("specular_weight", "single_scattering", "depolarization"):
        if not 0.0 <= getattr(surface, name) <= 1.0:
            raise ValueError(f"{name} = {getattr(surface, name)}; allowed is 0 to 1")
    if not abs(surface.asymmetry) <= ASYMMETRY_MOST:
        raise ValueError(f"asymmetry = {surface.asymmetry}; allowed is -{ASYMMETRY_MOST:g} to {ASYMMETRY_MOST:g}")
    most = _largest_single_dolp(surface.asymmetry, surface.depolarization)
    if not 0.0 <= surface.single_dolp <= most:
        raise ValueError(
            f"single_dolp = {surface.single_dolp}; allowed is 0 to {most:.4g} with asymmetry = {surface.asymmetry:g} "
            f"and depolarization = {surface.depolarization:g}; a larger one gives scattered light a DoLP above 1"
        )
    if not 0.0 <= surface.dhr_angle_rad < 0.5 * math.pi:
        raise ValueError(f"dhr_angle_rad = {surface.dhr_angle_rad} rad; allowed is 0 to below pi/2")
    if surface.table is not None and (surface.dhr is not None or surface.specular_weight != 0.0):
        raise ValueError("a table is the whole surface: leave out dhr, and give specular_weight = 0")


def _largest_single_dolp(asymmetry: float, depolarization: float) -> float:
    """Return the largest single_dolp for which a sum of Jones matrices makes the Mueller matrix P (Cloude, 1986)."""
    cosine = np.linspace(-0.999, 0.999, 181)
    square, g2 = cosine * cosine, asymmetry**2
    kept = 2.0 * (1.0 - depolarization) * 2.0 * np.abs(cosine) / (1.0 + square)
    ratio = 0.5 * np.sqrt((2.0 - depolarization) ** 2 - np.maximum(kept - depolarization, 0.0) ** 2)
    pattern = ((1.0 + g2) / (1.0 + g2 - 2.0 * asymmetry * cosine)) ** 1.5
    return float(np.min(ratio * pattern / (1.0 - square)))


def _require_dhr(surface: Surface, dhr: float) -> None:
    if not 0.0 <= dhr <= 1.0:
        raise ValueError(f"dhr = {dhr}; allowed is 0 to 1, or None for no diffuse term")
    share = reflectance_at(surface.lobe, surface.dhr_angle_rad)
    specular = surface.specular_weight * share
    if specular > dhr + _DHR_ROUNDING:
        raise ValueError(
            f"dhr = {dhr:g} is inconsistent: at {math.degrees(surface.dhr_angle_rad):.3g} deg the specular lobe "
            f"alone reflects {specular:.4f}. Lower specular_weight to at most {dhr / share:.3f} (dust or "
            "pores hide part of the facets), take a smaller index, or raise dhr"
        )
    if surface.diffuse == "volume":
        over = float(_sent_up_once(np.array([surface.dhr_angle_rad]), surface)[0, 0]) - surface.excess
        if over > _DHR_ROUNDING:
            raise ValueError(
                f"dhr = {dhr:g} is inconsistent: lobe and single scattering reflect {over:.3g} more. Lower "
                "single_scattering or raise dhr"
            )


# The diffuse term


def _add_diffuse(
    out: FloatArray, theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray, surface: Surface
) -> None:
    """Add the diffuse term to Mueller matrices."""
    if surface.table is not None:
        errors = (surface.table_f00, surface.table_s1, surface.table_s2)
        out += surface.table.matrix(theta_i_rad, theta_r_rad, phi_rad, errors=errors)
        return
    if surface.diffuse == "volume":
        out += _scattered_once(theta_i_rad, theta_r_rad, phi_rad, surface)
    entering, leaving = _entering(theta_i_rad, surface), _way(theta_r_rad, surface)
    out[:, :2, :2] += _scale(surface) / np.pi * (leaving.T[:, :, None] * entering.T[:, None, :])


def _diffuse_row(theta_i_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return what the diffuse term adds to the directional-hemispherical reflectance of S0 and S1, shape (2, N)."""
    if surface.table is not None:
        return surface.table.hemispherical_row(theta_i_rad)
    row = _scale(surface) * _mean_way(surface) * _entering(theta_i_rad, surface)
    return row + _sent_up_once(theta_i_rad, surface) if surface.diffuse == "volume" else row


def _diffuse_error(surface: Surface) -> float:
    """Return the error of the diffuse part of the reflectance: three of its kinds rest on the series for E."""
    if surface.table is not None:
        return surface.table.reflectance_error
    series = surface.diffuse in ("balance", "coupled", "volume")
    error = surface.specular_weight * (reflectance_table(surface.lobe).error if series else 1e-8)
    return error + _once_series(_without_dhr(surface))[1] if surface.diffuse == "volume" else error


def _entering(theta_i_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return the share of S0, and of S1, that enters the body, shape (2, N)."""
    if surface.diffuse != "balance":
        return _way(theta_i_rad, surface)
    dhr = surface.excess + surface.specular_weight * reflectance_at(surface.lobe, surface.dhr_angle_rad)
    lobe = surface.specular_weight * reflectance_table(surface.lobe).at(theta_i_rad)
    return np.stack([np.maximum(dhr - lobe, 0.0), np.zeros_like(theta_i_rad)])


def _way(theta_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return the share of S0, and of S1, that is neither reflected nor scattered once, shape (2, N)."""
    if surface.diffuse == "polarised":
        return _transmitted(theta_rad, surface)
    if surface.diffuse == "volume":
        return _left_over(theta_rad, surface)
    share = np.ones_like(theta_rad)
    if surface.diffuse == "coupled":
        lobe = surface.specular_weight * reflectance_table(surface.lobe).at(theta_rad)
        share = np.maximum(1.0 - lobe, 0.0)
    return np.stack([share, np.zeros_like(theta_rad)])


# Error of E. A perfect mirror leaves less than this to the diffuse term, which would then be 0 / 0.
_NOTHING = 1e-8
# A transmittance has an absolute error of 1e-16; below this limit too few digits are left to divide by it.
_OPAQUE = 1e-12


@lru_cache(maxsize=64)
def _scale(surface: Surface) -> float:
    """Return the factor by which way in times way out has the DHR that was measured."""
    if surface.diffuse == "balance":
        return 1.0
    if surface.excess < _NOTHING:
        return 0.0
    angle, excess = np.array([surface.dhr_angle_rad]), surface.excess
    if surface.diffuse == "volume":
        excess -= float(_sent_up_once(angle, surface)[0, 0])
    there = float(_way(angle, surface)[0, 0])
    if surface.diffuse == "coupled":
        there = 1.0 - surface.specular_weight * reflectance_at(surface.lobe, surface.dhr_angle_rad)
    if surface.diffuse == "polarised" and there < _OPAQUE:
        raise ValueError(
            f"diffuse = 'polarised': no light enters a surface of n = {surface.n:g}, k = {surface.k:g} "
            f"(a share of {there:.1g}), so that none can leave; choose 'coupled', or leave out dhr"
        )
    return excess / (there * _mean_way(surface))


def _mean_way(surface: Surface) -> float:
    """Return the cosine-weighted mean over the hemisphere of the way of unpolarised light."""
    if surface.diffuse in ("lambert", "balance"):
        return 1.0
    is_smooth = surface.diffuse == "polarised"
    theta, weight = _mean_nodes(surface.n) if is_smooth else reflectance_table(surface.lobe).mean_nodes()
    return float(weight @ _way(theta, surface)[0])


_MEAN_NODES = 96


def _mean_nodes(n: float) -> tuple[FloatArray, FloatArray]:
    """Angles and weights for the cosine-weighted mean, with a panel end at the critical angle of n below 1."""
    node, weight = gauss_legendre(_MEAN_NODES)
    critical = float(np.arcsin(n)) if n < 1.0 else 0.5 * np.pi
    spans = [(0.0, critical), (critical, 0.5 * np.pi)]
    # Squeezed towards both ends of each panel: the root at the critical angle becomes smooth.
    spaced, stretch = np.sin(0.5 * np.pi * node) ** 2, 0.5 * np.pi * np.sin(np.pi * node) * weight
    theta = np.concatenate([low + (high - low) * spaced for low, high in spans])
    lengths = np.concatenate([(high - low) * stretch for low, high in spans])
    return theta, lengths * np.sin(2.0 * theta)


def _transmitted(theta_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return transmittance for S0 and for S1 through the mean plane, 1 - B R and -B (Rs - Rp) / 2; shape (2, N)."""
    mean, difference, _ = mueller_elements(cos2_psi=np.cos(theta_rad) ** 2, n=surface.n, k=surface.k)
    return np.stack([1.0 - surface.specular_weight * mean, -surface.specular_weight * difference])


def _left_over(theta_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return the share of S0, and of S1, that neither the lobe nor one particle sends up, shape (2, N)."""
    lobe = [surface.specular_weight * reflectance_table(surface.lobe, part).at(theta_rad) for part in ("s0", "s1")]
    s0, s1 = np.array([[1.0], [0.0]]) - np.stack(lobe) - _sent_up_once(theta_rad, surface)
    s0 = np.maximum(s0, 0.0)
    return np.stack([s0, np.clip(s1, -s0, s0)])


def _scattered_once(
    theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray, surface: Surface
) -> FloatArray:
    """Return T f_1 T of "volume", shape (N, 3, 3)."""
    g = half_vector_geometry(theta_i_rad, theta_r_rad, phi_rad)
    g2, cosine = surface.asymmetry**2, 1.0 - 2.0 * g.cos2_psi
    at_right_angle = (1.0 - g2) / (1.0 + g2) ** 1.5
    lost = math.sqrt(1.0 - surface.single_scattering * (1.0 - surface.depolarization))
    h_i, h_r = ((1.0 + 2.0 * mu) / (1.0 + 2.0 * lost * mu) for mu in (g.cos_i, g.cos_r))
    scale = surface.single_scattering * h_i * h_r / (4.0 * np.pi * (g.cos_i + g.cos_r))
    m00 = scale * (1.0 - g2) / (1.0 + g2 - 2.0 * surface.asymmetry * cosine) ** 1.5
    square = cosine * cosine
    m11 = (1.0 - surface.depolarization) * m00
    out = np.empty((theta_i_rad.size, 3, 3))
    write_rotated(
        out,
        g,
        m00=m00,
        m01=scale * surface.single_dolp * at_right_angle * (1.0 - square),
        m11=m11,
        m22=m11 * 2.0 * cosine / (1.0 + square),
    )
    return np.asarray(_interface(theta_r_rad, surface) @ out @ _interface(theta_i_rad, surface))


def _interface(theta_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return the Mueller matrices of the way through the mean plane, shape (N, 3, 3)."""
    mean, difference = _transmitted(theta_rad, surface)
    matrix = np.zeros((theta_rad.size, 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = mean
    matrix[:, 0, 1] = matrix[:, 1, 0] = difference
    matrix[:, 2, 2] = np.sqrt((mean - difference) * (mean + difference))
    return matrix


# Of the series for what one particle sends up, in the root of the height over the horizon; and of its quadrature.
_ONCE_DEGREE, _ONCE_ORDERS = 20, (24, 36)


def _sent_up_once(theta_rad: FloatArray, surface: Surface) -> FloatArray:
    """Return the share of S0, and of S1, that leaves after one particle, shape (2, N)."""
    root = np.sqrt(np.maximum(1.0 - theta_rad * (2.0 / np.pi), 0.0))
    return np.asarray(chebyshev.chebval(2.0 * root - 1.0, _once_series(_without_dhr(surface))[0].T))


def _without_dhr(surface: Surface) -> Surface:
    """Return the surface without the numbers that do not change single scattering, as a key of the cache."""
    return replace(surface, dhr=None, dhr_angle_rad=0.0)


@lru_cache(maxsize=64)
def _once_series(surface: Surface) -> tuple[FloatArray, float]:
    """Return the series of the S0 and S1 that one particle sends into the hemisphere, and its error."""
    root = 0.5 * (chebyshev_nodes(_ONCE_DEGREE) + 1.0)
    theta = 0.5 * np.pi * (1.0 - root * root)
    coarse, fine = (_hemisphere_once(theta, surface, order) for order in _ONCE_ORDERS)
    coefficients = np.stack([chebyshev_series(row) for row in fine])
    coefficients.flags.writeable = False
    left = float(np.sum(np.abs(coefficients[:, -2:])))
    return coefficients, float(np.max(np.abs(fine - coarse))) + left


def _hemisphere_once(theta_i_rad: FloatArray, surface: Surface, order: int) -> FloatArray:
    """Return the first row of T f_1 T, times cosine, over the hemisphere, shape (2, T)."""
    node, weight = gauss_legendre(order)
    theta_r, phi = 0.5 * np.pi * (1.0 - node * node), np.pi * (np.arange(order) + 0.5) / order
    solid = np.pi * np.pi * node * weight * np.sin(2.0 * theta_r)
    i, r, around = (angle.ravel() for angle in np.meshgrid(theta_i_rad, theta_r, phi, indexing="ij"))
    rows = _scattered_once(i, r, around, surface)[:, 0, :2].reshape(theta_i_rad.size, order, order, 2).mean(axis=2)
    return np.asarray(np.einsum("trk,r->kt", rows, solid))


# Tilted panels


@dataclass(frozen=True, kw_only=True)
class Tilt:
    """Tilt of a plane panel.

    Parameters
    ----------
    tilt_rad
        Angle of its normal from up [rad], 0 (level) to pi/2 (a wall) and on to pi (a ceiling).
    azimuth_rad
        Azimuth to which its normal leans, clockwise from north [rad].

    Raises
    ------
    ValueError
        If an angle is outside its range.
    """

    tilt_rad: float
    azimuth_rad: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.tilt_rad <= np.pi:
            raise ValueError(f"tilt_rad = {self.tilt_rad} rad; allowed is 0 (level) to pi")
        if not np.isfinite(self.azimuth_rad):
            raise ValueError(f"azimuth_rad = {self.azimuth_rad} rad; allowed are finite angles")

    @property
    def normal(self) -> FloatArray:
        """Unit vector of the normal: east, north, up."""
        return geometry.direction(zenith_rad=self.tilt_rad, azimuth_rad=self.azimuth_rad)


@dataclass(frozen=True, kw_only=True)
class LocalGeometry:
    """Sun and camera as a tilted panel sees them."""

    theta_i_rad: FloatArray
    theta_r_rad: FloatArray
    phi_rad: FloatArray
    incident_rotation_rad: FloatArray
    reflected_rotation_rad: FloatArray


def local_geometry(
    *,
    sun_zenith_rad: ArrayLike,
    sun_azimuth_rad: ArrayLike,
    camera_zenith_rad: ArrayLike,
    camera_azimuth_rad: ArrayLike,
    tilt: Tilt,
) -> LocalGeometry:
    """Return the angles of sun and camera about a panel's normal and the turns of the Stokes axes.

    Parameters
    ----------
    sun_zenith_rad, sun_azimuth_rad
        Direction from the target to the sun or to a point of the sky [rad].
    camera_zenith_rad, camera_azimuth_rad
        Direction from the target to the camera [rad].
    tilt
        How the panel stands.

    Returns
    -------
    LocalGeometry
        The directions broadcast.

    Raises
    ------
    ValueError
        If an angle is not finite.
    """
    sun = geometry.direction(zenith_rad=sun_zenith_rad, azimuth_rad=sun_azimuth_rad)
    camera = geometry.direction(zenith_rad=camera_zenith_rad, azimuth_rad=camera_azimuth_rad)
    sun, camera = np.broadcast_arrays(sun, camera)
    world_i = np.broadcast_to(geometry.horizontal_axis(sun_azimuth_rad, travels_to_target=True), sun.shape)
    world_r = np.broadcast_to(geometry.horizontal_axis(camera_azimuth_rad, travels_to_target=False), sun.shape)
    panel_i = _panel_axis(tilt.normal, -sun, fallback=world_i)
    panel_r = _panel_axis(tilt.normal, camera, fallback=world_r)
    # The panel's azimuth directions of sun and camera, from their axes: defined even along the normal.
    toward_sun, toward_camera = np.cross(tilt.normal, panel_i), np.cross(panel_r, tilt.normal)
    turn = np.sum(tilt.normal * np.cross(toward_sun, toward_camera), axis=-1)
    return LocalGeometry(
        theta_i_rad=geometry.angle_between_rad(tilt.normal, sun),
        theta_r_rad=geometry.angle_between_rad(tilt.normal, camera),
        phi_rad=np.asarray(np.arctan2(turn, np.sum(toward_sun * toward_camera, axis=-1))),
        incident_rotation_rad=geometry.axis_rotation_rad(world_i, panel_i, travel=-sun),
        reflected_rotation_rad=geometry.axis_rotation_rad(panel_r, world_r, travel=camera),
    )


# A ray closer than this to the panel's normal defines no plane of incidence; any plane serves.
_ALONG_NORMAL = 1e-14


def _panel_axis(normal: FloatArray, travel: FloatArray, *, fallback: FloatArray) -> FloatArray:
    """unit(normal x k), the panel's own horizontal axis of each ray; `fallback` for a ray along the normal."""
    axis = np.cross(normal, travel)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    lost = length < _ALONG_NORMAL
    return np.asarray(np.where(lost, fallback, axis / np.where(lost, 1.0, length)))
