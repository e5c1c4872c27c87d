"""Polarized reflectance of rough surfaces: F = B f_specular + f_diffuse, on level and tilted panels.

The specular lobe is made of Fresnel mirrors with Gaussian slopes that hide one another; what the
directional-hemispherical reflectance (DHR) leaves is scattered diffusely. `findings` says where a description reflects
more than it receives.

Integrals over the lobe run over the slopes (x, y), x along the sun's azimuth. What sees the sun and mirrors it above
the horizon, and where the V-cavity changes its branch, are bounded by curves y(x) known in closed form, so that the
plane is cut into panels in which the integrand is smooth and Gauss-Legendre rules converge at their full rate.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from model import stokes as geometry
from model.numerics import erfc, gauss_legendre
from model.stokes import rotation

FloatArray = NDArray[np.float64]
AmplitudeArray = NDArray[np.inexact]
_DoubleAngle = tuple[FloatArray, FloatArray, NDArray[np.bool_]]

Shadowing = Literal["none", "v-cavity", "smith", "smith-correlated"]
SHADOWING: tuple[Shadowing, ...] = get_args(Shadowing)

DiffuseKind = Literal["lambert", "balance", "coupled", "polarised"]
DIFFUSE: tuple[DiffuseKind, ...] = get_args(DiffuseKind)


@dataclass(frozen=True, kw_only=True)
class Lobe:
    """Parameters of the specular lobe of a surface.

    Parameters
    ----------
    n, k
        Real and imaginary part of the refractive index; 0 < n <= 1e9, 0 <= k <= 1e9.
    slope_rms
        Standard deviation of the facet slope along one axis, at least 1e-3. (Beckmann's alpha is sqrt(2) times it.)
    shadowing
        One of `SHADOWING`.

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    n: float
    k: float
    slope_rms: float
    shadowing: Shadowing

    def __post_init__(self) -> None:
        _require_index(n=self.n, k=self.k)
        _require_slope_rms(self.slope_rms)
        if self.shadowing not in SHADOWING:
            raise ValueError(f"shadowing = {self.shadowing!r}; allowed are {', '.join(map(repr, SHADOWING))}")


@dataclass(frozen=True, kw_only=True)
class Diffuse:
    """Parameters of the diffuse term of a surface."""

    kind: DiffuseKind
    lobe: Lobe
    specular_weight: float
    excess: float
    dhr_angle_rad: float


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
        "lambert", "balance", "coupled" or "polarised"; see `model.surface.pbrdf.add_diffuse`.
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


_SCAN_RAD = np.radians(np.append(np.arange(0.0, 89.0, 1.0), [89.0, 89.5, 89.9]))
# Far above the quadrature error, far below what a measurement of reflectance could tell.
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


@dataclass(frozen=True, kw_only=True)
class HemisphericalReflectance:
    """Share of the incident light that goes into the hemisphere."""

    s0: FloatArray
    s1: FloatArray
    error: FloatArray


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
        row = _diffuse_row(angles.ravel(), diffuse=term).reshape(2, *angles.shape)
        s0, s1, error = s0 + row[0], s1 + row[1], error + weight * _diffuse_error(surface)
    return HemisphericalReflectance(s0=s0, s1=s1, error=error)


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


def tilted_mueller(
    *,
    sun_zenith_rad: ArrayLike,
    sun_azimuth_rad: ArrayLike,
    camera_zenith_rad: ArrayLike,
    camera_azimuth_rad: ArrayLike,
    camera_roll_rad: ArrayLike = 0.0,
    tilt: Tilt,
    surface: Surface,
) -> FloatArray:
    """Return the pBRDF of a tilted panel between the world's horizontal axes and the camera's.

    Parameters
    ----------
    sun_zenith_rad, sun_azimuth_rad
        Direction from the target to the sun or to a point of the sky [rad].
    camera_zenith_rad, camera_azimuth_rad
        Direction from the target to the camera [rad].
    camera_roll_rad
        Angle by which the camera's horizontal is turned counter-clockwise from the true horizontal, as the camera
        sees the scene [rad].
    tilt
        How the panel stands.
    surface
        What it is made of.

    Returns
    -------
    ndarray
        Shape (..., 3, 3) [sr^-1]. The irradiance that goes with it is that on the panel: cosine of the local
        theta_i, not of the sun's zenith angle. Zero where the panel does not face sun and camera both.

    Raises
    ------
    ValueError
        If an angle is not finite.

    Notes
    -----
    A level panel gives `mueller` itself. At the zenith or nadir the horizontal is that of the azimuth given.

    References
    ----------
    Definition; [MK14] eq. (11) for the camera's frame.
    """
    local = local_geometry(
        sun_zenith_rad=sun_zenith_rad,
        sun_azimuth_rad=sun_azimuth_rad,
        camera_zenith_rad=camera_zenith_rad,
        camera_azimuth_rad=camera_azimuth_rad,
        tilt=tilt,
    )
    own = mueller(local.theta_i_rad, local.theta_r_rad, local.phi_rad, surface=surface)
    roll = np.asarray(camera_roll_rad, dtype=np.float64)
    if not np.all(np.isfinite(roll)):
        raise ValueError("camera_roll_rad is not finite; allowed are finite angles [rad]")
    turned: FloatArray = rotation(local.reflected_rotation_rad + roll) @ own @ rotation(local.incident_rotation_rad)
    return turned


# One block of geometries at a time keeps the intermediate arrays in the processor's cache.
_BLOCK = 8192


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
        _write_specular(out[block], half_vector_geometry(theta_i, theta_r, phi), lobe=lobe, weight=specular_weight)
        if diffuse is not None:
            _add_diffuse(out[block], theta_i, theta_r, diffuse=diffuse)
        out[block][hidden] = 0.0
    return out.reshape(*angles[0].shape, 3, 3)


def checked_azimuth(name: str, angle_rad: ArrayLike) -> FloatArray:
    """Return azimuths as a float64 array."""
    return _finite(name, angle_rad)


@lru_cache(maxsize=256)
def reflectance_at(lobe: Lobe, theta_rad: float) -> float:
    """Return the lobe's reflectance E of unpolarised light at one angle; kept for each lobe and angle."""
    return float(lobe_reflectance(theta_rad, lobe=lobe).s0)


# Nodes along x of each panel: a rule is trusted when it agrees with the one before it.
_ORDERS = (24, 36, 54, 82, 124)
_TOLERANCE = 1e-8
_ROWS_AT_ONCE = 64


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


def checked_zenith(name: str, angle_rad: ArrayLike) -> FloatArray:
    """Return zenith angles as a float64 array."""
    angle = _finite(name, angle_rad)
    outside = (angle < 0.0) | (angle > np.pi)
    if np.any(outside):
        raise ValueError(
            f"{name} = {angle[outside].flat[0]:.6g} rad; allowed is 0 to pi, counted from the surface normal. "
            "The other side of the normal is the azimuth's business: add pi to phi_rad"
        )
    return angle


# Slopes beyond this many standard deviations hold 2e-11 of the facets.
SLOPE_CUT = 7.0


@dataclass(frozen=True, kw_only=True)
class FacetNodes:
    """Facets and their weights."""

    row: NDArray[np.intp]
    x: FloatArray
    y: FloatArray
    weight: FloatArray


def facet_nodes(
    theta_i_rad: FloatArray, *, slope_rms: float, shadowing: Shadowing, order: int, cut: float = SLOPE_CUT
) -> FacetNodes:
    """Return nodes over the facets that mirror the sun into the upper hemisphere.

    Definition; reflected above the horizon is 1 + x^2 + y^2 < 2 (1 + x tan theta), and with the V-cavity the way
    out is the narrower one where 1 + x^2 + y^2 > 4 (1 + x tan theta) / (2 + min(1 + x tan theta, 2)).
    """
    steepest = cut * slope_rms
    x, x_weight = _x_nodes(_x_breaks(theta_i_rad, shadowing, steepest), order)
    breaks = _y_breaks(x, theta_i_rad, shadowing, steepest)
    widths = np.diff(breaks, axis=-1)
    strip_weight = x_weight[..., None] * widths
    kept = np.nonzero(strip_weight > 0.0)
    node, node_weight = gauss_legendre(max(order // 2, 2))
    strip_x = x[kept[:2]][:, None]
    y = breaks[..., :-1][kept][:, None] + widths[kept][:, None] * node
    density = np.exp((strip_x**2 + y**2) * (-0.5 / slope_rms**2)) / (np.pi * slope_rms**2)
    return FacetNodes(row=kept[0], x=strip_x, y=y, weight=strip_weight[kept][:, None] * node_weight * density)


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


# A DHR may miss the lobe's own share by this much and count as equal to it: the share's quadrature error.
_DHR_ROUNDING = 1e-7


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


# The lobe's solid angle is about 4 pi slope_rms^2; below this it is narrower than the sun's disc by far.
SLOPE_RMS_MIN = 1e-3
INDEX_MAX = 1e9


def _require_index(*, n: float, k: float) -> None:
    """Raise unless n + ik is a refractive index."""
    if not 0.0 < n <= INDEX_MAX:
        raise ValueError(f"n = {n}; allowed is 0 < n <= {INDEX_MAX:g} (real part of the refractive index)")
    if not 0.0 <= k <= INDEX_MAX:
        raise ValueError(f"k = {k}; allowed is 0 <= k <= {INDEX_MAX:g} (the index is n + ik, absorption is positive)")


def _require_slope_rms(slope_rms: float) -> None:
    """Raise unless the slope is one that a lobe of finite width can have."""
    if not (math.isfinite(slope_rms) and slope_rms >= SLOPE_RMS_MIN):
        raise ValueError(
            f"slope_rms = {slope_rms}; allowed is {SLOPE_RMS_MIN:g} and above (per axis). A smoother surface is "
            "a mirror: its lobe is narrower than the sun's disc, so a reflectance per solid angle says nothing; "
            "use a slope of the sun's half width (about 0.0023) or the mirror's Fresnel reflectance"
        )


def _finite(name: str, angle_rad: ArrayLike) -> FloatArray:
    angle = np.asarray(angle_rad, dtype=np.float64)
    if not np.all(np.isfinite(angle)):
        bad = angle[~np.isfinite(angle)].flat[0]
        raise ValueError(f"{name} = {bad} rad; allowed are finite angles")
    return angle


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
    prefactor = _shadowed_prefactor(
        cos_i=cos_i,
        sin_i=sin_i,
        cos_r=cos_r,
        sin_r=np.sqrt(np.maximum(1.0 - cos_r**2, 0.0)),
        mean_cosine=seen / secant2,
        cos2_psi=cos2_psi,
        slope_rms=lobe.slope_rms,
        shadowing=lobe.shadowing,
    )
    m00, m01, _ = mueller_elements(cos2_psi=cos2_psi, n=lobe.n, k=lobe.k)
    visible = 4.0 * prefactor * cos_r * seen * nodes.weight
    cos_2eta = np.divide(lean - across, lean + across, out=np.ones_like(m01), where=lean + across > 0.0)
    strips = (np.sum(visible * m00, axis=1), np.sum(visible * m01 * cos_2eta, axis=1))
    return np.stack([np.bincount(nodes.row, strip, minlength=theta_rad.size) for strip in strips])


def _x_nodes(breaks: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of shape (T, panels * order); sin^2 spacing undoes the square roots at panel ends."""
    node, weight = gauss_legendre(order)
    spaced = np.sin(0.5 * np.pi * node) ** 2
    stretch = 0.5 * np.pi * np.sin(np.pi * node) * weight
    width = np.diff(breaks, axis=-1)[..., None]
    shape = (breaks.shape[0], -1)
    return (breaks[..., :-1, None] + width * spaced).reshape(shape), (width * stretch).reshape(shape)


def _x_breaks(theta_rad: FloatArray, shadowing: Shadowing, cut: float) -> FloatArray:
    """Return ends of the panels along x, ascending; in-plane tilts of the facet make them simple."""
    left = 0.5 * np.pi - theta_rad
    angles = [-0.5 * left, np.zeros_like(left), 0.5 * np.pi - 0.5 * left]
    if shadowing == "v-cavity":
        last = np.maximum(theta_rad, (theta_rad + 0.5 * np.pi) / 3.0)
        angles[1:1] = [-left / 3.0]
        angles[3:3] = [np.minimum(left, last), last]
    return np.clip(np.tan(np.stack(angles, axis=-1)), -cut, cut)


def _y_breaks(x: FloatArray, theta_rad: FloatArray, shadowing: Shadowing, cut: float) -> FloatArray:
    """Return ends of the panels along y >= 0, shape (T, X, panels + 1)."""
    cos, sin = np.cos(theta_rad)[:, None], np.sin(theta_rad)[:, None]
    seen = cos + x * sin
    curves = [2.0 * seen / cos]
    if shadowing == "v-cavity":
        curves.insert(0, 4.0 * seen / (2.0 * cos + np.minimum(seen, 2.0 * cos)))
    tops = [np.sqrt(np.maximum(curve - 1.0 - x * x, 0.0)) for curve in curves]
    return np.asarray(np.minimum(np.stack([np.zeros_like(x), *tops], axis=-1), cut))


def _shadowed_prefactor(
    *,
    cos_i: FloatArray,
    sin_i: FloatArray,
    cos_r: FloatArray,
    sin_r: FloatArray,
    mean_cosine: FloatArray,
    cos2_psi: FloatArray,
    slope_rms: float,
    shadowing: Shadowing,
) -> FloatArray:
    """Return G / (4 cos theta_i cos theta_r), the visible share of facets over the projections.

    With G = 1 the surface reflects more than it receives near grazing. The other three conserve energy.

    "v-cavity": Torrance and Sparrow (1967), doi:10.1364/JOSA.57.001105. Smith: Smith (1967),
    doi:10.1109/TAP.1967.1138991, for Gaussian slopes; the correlated form: Heitz (2014), J. Computer Graphics
    Techniques 3(2).
    """
    if shadowing == "none":
        return 0.25 / (cos_i * cos_r)
    if shadowing == "v-cavity":
        cavity = 0.5 * mean_cosine / (cos2_psi * np.maximum(cos_i, cos_r))
        return np.minimum(0.25 / (cos_i * cos_r), cavity)
    masked_i = _masked_cosine(cos_i, sin_i, slope_rms)
    masked_r = _masked_cosine(cos_r, sin_r, slope_rms)
    if shadowing == "smith":
        return 0.25 / ((cos_i + masked_i) * (cos_r + masked_r))
    return 0.25 / (cos_i * cos_r + cos_r * masked_i + cos_i * masked_r)


def _masked_cosine(cos: FloatArray, sin: FloatArray, slope_rms: float) -> FloatArray:
    """Cosine times Smith's Lambda for Gaussian slopes: finite at grazing, zero at the normal."""
    spread = np.sqrt(2.0) * slope_rms * sin
    with np.errstate(over="ignore"):
        a = np.divide(cos, spread, out=np.full_like(cos, np.inf), where=spread > 0.0)
        return np.asarray(0.5 * (spread * np.exp(-a * a) / np.sqrt(np.pi) - cos * erfc(a)))


def mueller_elements(*, cos2_psi: FloatArray, n: float, k: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return M00 = M11, M01 = M10 and M22 of reflection in the axes of the plane of incidence.

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


def amplitudes(*, cos2_psi: FloatArray, n: float, k: float) -> tuple[AmplitudeArray, AmplitudeArray]:
    """Return the amplitude reflection coefficients r_s and r_p.

    Right-handed triads, so r_p = -r_s at normal incidence. The numerators are written as differences of
    squares, which keeps all digits at Brewster's angle and for an index near 1.

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


@dataclass(frozen=True, kw_only=True)
class HalfVectorGeometry:
    """Angles between sun, sensor and the facet that mirrors one into the other; arrays of one shape."""

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


def _write_specular(out: FloatArray, geometry: HalfVectorGeometry, *, lobe: Lobe, weight: float) -> None:
    """Write the Mueller matrices of the lobe into an array.

    [MK14] section II-A; Priest and Germer (2000). M = R(-eta_r) M_Fresnel R(eta_i) times D G / (4 cos cos).
    """
    g = geometry
    scale = weight * _facet_density(g.tan2_beta, slope_rms=lobe.slope_rms)
    scale *= _shadowed_prefactor(
        cos_i=g.cos_i,
        sin_i=g.sin_i,
        cos_r=g.cos_r,
        sin_r=g.sin_r,
        mean_cosine=g.mean_cosine,
        cos2_psi=g.cos2_psi,
        slope_rms=lobe.slope_rms,
        shadowing=lobe.shadowing,
    )
    m00, m01, m22 = mueller_elements(cos2_psi=g.cos2_psi, n=lobe.n, k=lobe.k)
    _write_rotated(out, g, m00 * scale, m01 * scale, m22 * scale)


def _facet_density(tan2_beta: FloatArray, *, slope_rms: float) -> FloatArray:
    """Return the density of facet normals over solid angle, with integral of D cos(beta) equal to 1.

    Priest and Germer (2000), Proc. Military Sensing Symposia; Beckmann's distribution with alpha = sqrt(2) slope_rms.
    """
    variance = slope_rms * slope_rms
    with np.errstate(under="ignore"):
        weight = np.exp(tan2_beta * (-0.5 / variance))
        return np.asarray(weight * (1.0 + tan2_beta) ** 2 / (2.0 * np.pi * variance))


def _write_rotated(out: FloatArray, g: HalfVectorGeometry, m00: FloatArray, m01: FloatArray, m22: FloatArray) -> None:
    """Turn the facet's matrix into the horizontal axes of both rays."""
    ci, si, cr, sr = g.cos_2eta_i, g.sin_2eta_i, g.cos_2eta_r, g.sin_2eta_r
    out[:, 0, 0] = m00
    out[:, 0, 1] = m01 * ci
    out[:, 0, 2] = m01 * si
    out[:, 1, 0] = m01 * cr
    out[:, 2, 0] = m01 * sr
    row_1, row_2 = m00 * cr, m22 * sr
    out[:, 1, 1] = row_1 * ci + row_2 * si
    out[:, 1, 2] = row_1 * si - row_2 * ci
    row_1, row_2 = m00 * sr, m22 * cr
    out[:, 2, 1] = row_1 * ci - row_2 * si
    out[:, 2, 2] = row_1 * si + row_2 * ci


def half_vector_geometry(theta_i_rad: FloatArray, theta_r_rad: FloatArray, phi_rad: FloatArray) -> HalfVectorGeometry:
    """Return the facet geometry of the directions to sun and sensor.

    With p, m = (theta_i +- theta_r) / 2 the squared quantities are sums of terms that are not negative:
    cos^2 psi = cos^2 p + sin_i sin_r cos^2(phi/2), and likewise the facet's slope. The s axis comes from the half
    vector's components along (h, v) of each ray, made of the same differences in both, so that it is one axis to the
    last digit near retro-reflection. No angle is ever formed.

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


# Below this squared sine of the angle between the rays the facet's plane of incidence is taken from h_i. The
# matrix then errs by less than this number, since r_s + r_p is of second order in that angle.
_COINCIDENT = 1e-28


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


def _add_diffuse(out: FloatArray, theta_i_rad: FloatArray, theta_r_rad: FloatArray, *, diffuse: Diffuse) -> None:
    """Add the diffuse term to Mueller matrices.

    With E the reflectance of the lobe, B its weight and x = DHR - B E(theta_m):

    - "lambert": f00 = x / pi. Reciprocal; a bright glossy surface reflects more than it receives near grazing.
    - "balance": f00 = max(0, DHR - B E(theta_i)) / pi, so that the total is DHR at all angles of incidence up to the
      one where the lobe alone exceeds it. Conserves energy; not reciprocal.
    - "coupled": f00 = rho (1 - B E(theta_i)) (1 - B E(theta_r)) / (pi mean(1 - B E)), rho = x / (1 - B E(theta_m)).
      Reciprocal, total B E + rho (1 - B E) <= 1. Without shadowing E passes 1 near grazing; there 1 - B E counts as 0.
    - "polarised": f = rho t(theta_r) t(theta_i)^T / pi, t = ((T_s + T_p) / 2, (T_s - T_p) / 2, 0),
      T = 1 - B |r|^2 of the mean plane: light enters, loses its polarization and leaves. Reciprocal; conserves
      energy for every polarization of the light that comes in.

    "balance": Hyde, Schmidt and Havrilla (2009), doi:10.1364/OE.17.022138, with the measured DHR in place of
    a perfect reflector's. "coupled": Kelemen and Szirmay-Kalos (2001), Eurographics short presentations. "polarised":
    Baek et al. (2018), doi:10.1145/3272127.3275018.
    """
    if diffuse.kind == "lambert":
        out[:, 0, 0] += diffuse.excess / np.pi
    elif diffuse.kind == "balance":
        out[:, 0, 0] += _balance(theta_i_rad, diffuse) / np.pi
    elif diffuse.kind == "coupled":
        escape = _unreflected(theta_i_rad, diffuse) * _unreflected(theta_r_rad, diffuse)
        out[:, 0, 0] += _scale(diffuse) / np.pi * escape
    else:
        entering = _scale(diffuse) / np.pi * _transmitted(theta_i_rad, diffuse)
        leaving = _transmitted(theta_r_rad, diffuse)
        out[:, :2, :2] += leaving.T[:, :, None] * entering.T[:, None, :]


def _balance(theta_i_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return what DHR leaves at the angle of incidence, not below zero; shape (N,)."""
    at_measurement = reflectance_at(diffuse.lobe, diffuse.dhr_angle_rad)
    dhr = diffuse.excess + diffuse.specular_weight * at_measurement
    lobe = diffuse.specular_weight * reflectance_table(diffuse.lobe).at(theta_i_rad)
    return np.asarray(np.maximum(dhr - lobe, 0.0))


_TOLERANCE_REFLECTANCE_TABLE = 1e-7
_DEGREES = (12, 24, 48, 96, 192)
_WORST_ERROR = 1e-4
_MEAN_NODES = 48


@dataclass(frozen=True, kw_only=True, eq=False)
class ReflectanceTable:
    """A piecewise series for E(theta), theta in [0, pi/2)."""

    edges: FloatArray
    coefficients: tuple[FloatArray, ...]
    stretch_rad: float
    rise: float
    error: float

    def at(self, theta_rad: FloatArray) -> FloatArray:
        """Return E of unpolarised light."""
        u = np.arcsinh((0.5 * np.pi - theta_rad) / self.stretch_rad)
        series = self._piece(0, u)
        for index in range(1, len(self.coefficients)):
            beyond = u > self.edges[index]
            series[beyond] = self._piece(index, u[beyond])
        if self.rise > 0.0:
            series *= 1.0 + self.rise / np.cos(theta_rad)
        return series

    def _piece(self, index: int, u: FloatArray) -> FloatArray:
        low, high = self.edges[index], self.edges[index + 1]
        position = (2.0 * u - (low + high)) / (high - low)
        return np.asarray(chebyshev.chebval(position, self.coefficients[index]))

    def mean_nodes(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and weights for the cosine-weighted mean over the hemisphere.

        Definition; Gauss-Legendre in the stretched angle, piece by piece.
        """
        node, weight = gauss_legendre(_MEAN_NODES)
        widths = np.diff(self.edges)[:, None]
        u = (self.edges[:-1, None] + widths * node).ravel()
        theta = 0.5 * np.pi - self.stretch_rad * np.sinh(u)
        return theta, (widths * weight).ravel() * self.stretch_rad * np.cosh(u) * np.sin(2.0 * theta)


@lru_cache(maxsize=64)
def reflectance_table(lobe: Lobe) -> ReflectanceTable:
    """Return the series of a lobe; made once for each lobe and kept.

    Parameters
    ----------
    lobe
        Index, slopes and shadowing.

    Returns
    -------
    ReflectanceTable
        Immutable, so that threads may share it.

    Raises
    ------
    ValueError
        If its error cannot be brought below 1e-4.
    """
    stretch = min(4.0 * lobe.slope_rms, 1.0)
    rise = lobe.slope_rms if lobe.shadowing == "none" else 0.0
    # The V-cavity's branches change their order at 45 deg, and E has a kink there in a higher derivative.
    angles = [0.5 * np.pi, 0.25 * np.pi, 0.0] if lobe.shadowing == "v-cavity" else [0.5 * np.pi, 0.0]
    edges = np.arcsinh((0.5 * np.pi - np.array(angles)) / stretch)
    sampled = _Sampling(lobe=lobe, stretch=stretch, rise=rise)
    pieces = [_series(sampled, low, high) for low, high in pairwise(edges)]
    error = max(piece_error for _, piece_error in pieces)
    _require_converged(error, lobe)
    return ReflectanceTable(
        edges=edges,
        coefficients=tuple(coefficients for coefficients, _ in pieces),
        stretch_rad=stretch,
        rise=rise,
        error=error,
    )


@dataclass(frozen=True, kw_only=True)
class _Sampling:
    lobe: Lobe
    stretch: float
    rise: float


def _series(sampling: _Sampling, low: float, high: float) -> tuple[FloatArray, float]:
    """Return coefficients between two stretched angles, and their error in E."""
    samples = _samples(sampling, low, high, _DEGREES[0])
    for degree in _DEGREES[1:]:
        coarse = chebyshev.chebval(_nodes(degree)[1::2], _coefficients(samples[0]))
        between = _samples(sampling, low, high, degree, odd_only=True)
        miss = float(np.max(np.abs(between[0] - coarse)))
        samples = _interleaved(samples, between)
        if miss < _TOLERANCE_REFLECTANCE_TABLE:
            break
    values, quadrature_error, factor = samples
    coefficients, dropped = _trimmed(_coefficients(values))
    coefficients.flags.writeable = False
    # An error of the series is larger in E; what counts is E up to 1 (and what rounding adds to 1).
    amplification = float(np.max(1.0 / factor, where=values <= 1.001 * factor, initial=1.0))
    return coefficients, (miss + float(np.max(quadrature_error)) + dropped) * amplification


def _samples(sampling: _Sampling, low: float, high: float, degree: int, *, odd_only: bool = False) -> FloatArray:
    """Return rows of the tabulated function, its quadrature error, and the factor from E to it, at nodes."""
    position = _nodes(degree)[1::2] if odd_only else _nodes(degree)
    u = low + 0.5 * (position + 1.0) * (high - low)
    theta = np.clip(0.5 * np.pi - sampling.stretch * np.sinh(u), 0.0, 0.5 * np.pi)
    factor = np.cos(theta) / (np.cos(theta) + sampling.rise)
    reflectance = lobe_reflectance(theta, lobe=sampling.lobe)
    return np.stack([reflectance.s0 * factor, reflectance.error * factor, factor])


def _nodes(degree: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * np.arange(degree + 1) / degree))


def _coefficients(values: FloatArray) -> FloatArray:
    """Series through values at cos(pi j / degree), by the discrete cosine sum."""
    degree = values.size - 1
    j = np.arange(degree + 1)
    halved = values.copy()
    halved[[0, -1]] *= 0.5
    coefficients = np.cos(np.pi * np.outer(j, j) / degree) @ halved * (2.0 / degree)
    coefficients[[0, -1]] *= 0.5
    return np.asarray(coefficients)


def _interleaved(even: FloatArray, odd: FloatArray) -> FloatArray:
    """Return samples at all nodes of a degree from those of half of it and those between."""
    together = np.empty((even.shape[0], even.shape[1] + odd.shape[1]))
    together[:, ::2], together[:, 1::2] = even, odd
    return together


def _trimmed(coefficients: FloatArray) -> tuple[FloatArray, float]:
    """Return the series without the tail that only costs time, and the sum of what was dropped."""
    tail = np.cumsum(np.abs(coefficients[::-1]))[::-1]
    count = max(int(np.sum(tail > 0.1 * _TOLERANCE_REFLECTANCE_TABLE)), 1)
    return coefficients[:count].copy(), float(np.sum(np.abs(coefficients[count:])))


def _require_converged(error: float, lobe: Lobe) -> None:
    if error > _WORST_ERROR:
        raise ValueError(
            f"the reflectance of the lobe n = {lobe.n:g}, k = {lobe.k:g}, slope_rms = {lobe.slope_rms:g} is known "
            f"to {error:.1g} only; allowed is {_WORST_ERROR:g}. A real index below 1 has a critical angle at which "
            "the quadrature is slow: give the absorption k, or leave out dhr"
        )


def _unreflected(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return 1 - B E(theta), the share of light that the lobe does not take; shape (N,)."""
    lobe = diffuse.specular_weight * reflectance_table(diffuse.lobe).at(theta_rad)
    return np.asarray(np.maximum(1.0 - lobe, 0.0))


# E is known to this; a perfect mirror leaves less than that, and 0 / 0 must not be asked.
_NOTHING = 1e-8
# A transmittance is known to 1e-16; below this too few of its digits are left to divide by.
_OPAQUE = 1e-12


@lru_cache(maxsize=64)
def _scale(diffuse: Diffuse) -> float:
    """Return the factor by which a product of two angles' functions has the total DHR that was measured."""
    if abs(diffuse.excess) < _NOTHING:
        return 0.0
    if diffuse.kind == "coupled":
        there = 1.0 - diffuse.specular_weight * reflectance_at(diffuse.lobe, diffuse.dhr_angle_rad)
        return diffuse.excess / (there * _mean_unreflected(diffuse))
    there = float(_transmitted(np.array([diffuse.dhr_angle_rad]), diffuse)[0, 0])
    if there < _OPAQUE:
        raise ValueError(
            f"diffuse = 'polarised': no light enters a surface of n = {diffuse.lobe.n:g}, k = {diffuse.lobe.k:g} "
            f"(a share of {there:.1g}), so that none can leave; choose 'coupled', or leave out dhr"
        )
    return diffuse.excess / (there * _mean_transmitted(diffuse))


def _mean_unreflected(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean of 1 - B E over the hemisphere."""
    theta, weight = reflectance_table(diffuse.lobe).mean_nodes()
    return float(weight @ _unreflected(theta, diffuse))


def _transmitted(theta_rad: FloatArray, diffuse: Diffuse) -> FloatArray:
    """Return transmittance for S0 and for S1 through the mean plane, 1 - B R and -B (Rs - Rp) / 2; shape (2, N)."""
    lobe = diffuse.lobe
    mean, difference, _ = mueller_elements(cos2_psi=np.cos(theta_rad) ** 2, n=lobe.n, k=lobe.k)
    return np.stack([1.0 - diffuse.specular_weight * mean, -diffuse.specular_weight * difference])


def _mean_transmitted(diffuse: Diffuse) -> float:
    """Return the cosine-weighted mean transmittance of unpolarised light over the hemisphere."""
    theta, weight = _mean_nodes(diffuse.lobe)
    return float(weight @ _transmitted(theta, diffuse)[0])


_MEAN_NODES_DIFFUSE = 96


def _mean_nodes(lobe: Lobe) -> tuple[FloatArray, FloatArray]:
    """Angles and weights for the cosine-weighted mean, with a panel end at the critical angle of n below 1."""
    node, weight = gauss_legendre(_MEAN_NODES_DIFFUSE)
    critical = float(np.arcsin(lobe.n)) if lobe.n < 1.0 else 0.5 * np.pi
    spans = [(0.0, critical), (critical, 0.5 * np.pi)]
    # Squeezed towards both ends of each panel: the root at the critical angle becomes smooth.
    spaced, stretch = np.sin(0.5 * np.pi * node) ** 2, 0.5 * np.pi * np.sin(np.pi * node) * weight
    theta = np.concatenate([low + (high - low) * spaced for low, high in spans])
    lengths = np.concatenate([(high - low) * stretch for low, high in spans])
    return theta, lengths * np.sin(2.0 * theta)


def _diffuse_row(theta_i_rad: FloatArray, *, diffuse: Diffuse) -> FloatArray:
    """Return what the diffuse term adds to the directional-hemispherical reflectance.

    Definition: pi times the cosine-weighted mean of the first row over the hemisphere.
    """
    row = np.zeros((2, theta_i_rad.size))
    if diffuse.kind == "lambert":
        row[0] = diffuse.excess
    elif diffuse.kind == "balance":
        row[0] = _balance(theta_i_rad, diffuse)
    elif diffuse.kind == "coupled":
        row[0] = _scale(diffuse) * _mean_unreflected(diffuse) * _unreflected(theta_i_rad, diffuse)
    else:
        row[:] = _scale(diffuse) * _mean_transmitted(diffuse) * _transmitted(theta_i_rad, diffuse)
    return row


def _diffuse_error(surface: Surface) -> float:
    """Return the error of the diffuse part: two of its kinds rest on the series for E."""
    return reflectance_table(surface.lobe).error if surface.diffuse in ("balance", "coupled") else 1e-8


def _first_angle_deg(condition: NDArray[np.bool_]) -> float | None:
    where = np.nonzero(condition)[0]
    return float(np.degrees(_SCAN_RAD[where[0]])) if where.size else None


def _spent_diffuse(surface: Surface) -> list[str]:
    term = surface.diffuse_term
    if term is None or term.kind != "balance":
        return []
    spent = _first_angle_deg(_diffuse_row(_SCAN_RAD, diffuse=term)[0] == 0.0)
    if spent is None:
        return []
    angle = f"the specular lobe alone exceeds dhr = {surface.dhr:g} from {spent:g} deg on"
    return [f'{angle}: no diffuse term is left there; choose diffuse="coupled" or lower specular_weight']


# A ray closer than this to the panel's normal has no plane of its own on the panel; any one serves.
_ALONG_NORMAL = 1e-14


def _panel_axis(normal: FloatArray, travel: FloatArray, *, fallback: FloatArray) -> FloatArray:
    """unit(normal x k), the panel's own horizontal axis of each ray; `fallback` for a ray along the normal."""
    axis = np.cross(normal, travel)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    lost = length < _ALONG_NORMAL
    return np.asarray(np.where(lost, fallback, axis / np.where(lost, 1.0, length)))
