"""Polarized reflectance of rough surfaces: F = B f_specular + f_diffuse, on level and tilted panels.

The specular lobe is made of facets (`model.surface.facets`); what the directional-hemispherical reflectance (DHR)
leaves is scattered diffusely (`model.surface.diffuse`). `findings` says where a description reflects more than it
receives.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import stokes as geometry
from model.stokes import rotation
from model.surface.diffuse import (
    DIFFUSE,
    Diffuse,
    DiffuseKind,
    SingleScattering,
    add_diffuse,
    diffuse_error,
    diffuse_row,
    single_excess,
)
from model.surface.facets import (
    HemisphericalReflectance,
    Lobe,
    Shadowing,
    checked_azimuth,
    checked_zenith,
    half_vector_geometry,
    lobe_reflectance,
    reflectance_at,
    write_specular,
)
from model.surface.table import TabulatedBrdf

FloatArray = NDArray[np.float64]


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
        "lambert", "balance", "coupled", "polarised" or "volume"; see `model.surface.diffuse.add_diffuse`.
    specular_weight
        B, share of the surface that shows the lobe (dust and pores hide the rest), 0 to 1.
    single_scattering
        Of "volume": weight w of the light that one particle of the body scatters, 0 to 1. 1 is a deep body that does
        not absorb.
    asymmetry
        Of "volume": mean cosine of the angle by which a particle scatters, -0.8 to 0.8.
    single_dolp
        Of "volume": degree of polarization of unpolarised light that one particle scatters by 90 deg, 0 to 1, and
        less the larger the asymmetry.
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
        lobe = self.lobe
        if self.diffuse not in DIFFUSE:
            raise ValueError(f"diffuse = {self.diffuse!r}; allowed are {', '.join(map(repr, DIFFUSE))}")
        if not 0.0 <= self.specular_weight <= 1.0:
            raise ValueError(f"specular_weight = {self.specular_weight}; allowed is 0 to 1")
        if not 0.0 <= self.dhr_angle_rad < 0.5 * math.pi:
            raise ValueError(f"dhr_angle_rad = {self.dhr_angle_rad} rad; allowed is 0 to below pi/2")
        if self.table is not None and (self.dhr is not None or self.specular_weight != 0.0):
            raise ValueError("a table is the whole surface: leave out dhr, and give specular_weight = 0")
        if self.dhr is not None:
            _require_dhr(self.dhr, self.specular_weight, reflectance_at(lobe, self.dhr_angle_rad), self.dhr_angle_rad)
        term = self.diffuse_term
        if term is not None and term.kind == "volume" and (over := single_excess(term)) > _DHR_ROUNDING:
            raise ValueError(
                f"dhr = {self.dhr:g} is inconsistent: lobe and single scattering reflect {over:.3g} more. Lower "
                "single_scattering or raise dhr"
            )

    @property
    def lobe(self) -> Lobe:
        """The specular lobe."""
        return Lobe(n=self.n, k=self.k, slope_rms=self.slope_rms, shadowing=self.shadowing)

    @property
    def diffuse_term(self) -> Diffuse | None:
        """The diffuse term; None without a DHR or a table."""
        lobe = self.lobe
        if self.table is not None:
            return Diffuse(
                kind="table",
                lobe=lobe,
                specular_weight=0.0,
                excess=0.0,
                dhr_angle_rad=self.dhr_angle_rad,
                table=self.table,
                table_errors=(self.table_f00, self.table_s1, self.table_s2),
            )
        if self.dhr is None:
            return None
        specular = self.specular_weight * reflectance_at(lobe, self.dhr_angle_rad)
        return Diffuse(
            kind=self.diffuse,
            lobe=lobe,
            specular_weight=self.specular_weight,
            excess=max(self.dhr - specular, 0.0),
            dhr_angle_rad=self.dhr_angle_rad,
            single=self.single,
        )

    @property
    def single(self) -> SingleScattering:
        """Light that one particle of the body scatters, where the diffuse term counts it."""
        return SingleScattering(
            weight=self.single_scattering,
            asymmetry=self.asymmetry,
            dolp=self.single_dolp,
            depolarization=self.depolarization,
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
    return (*found, *_spent_diffuse(surface))


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
        s0, s1, error = s0 + row[0], s1 + row[1], error + diffuse_error(term)
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
        write_specular(out[block], half_vector_geometry(theta_i, theta_r, phi), lobe=lobe, weight=specular_weight)
        if diffuse is not None:
            add_diffuse(out[block], theta_i, theta_r, phi, diffuse=diffuse)
        out[block][hidden] = 0.0
    return out.reshape(*angles[0].shape, 3, 3)


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


def _first_angle_deg(condition: NDArray[np.bool_]) -> float | None:
    where = np.nonzero(condition)[0]
    return float(np.degrees(_SCAN_RAD[where[0]])) if where.size else None


def _spent_diffuse(surface: Surface) -> list[str]:
    term = surface.diffuse_term
    if term is None or term.kind != "balance":
        return []
    spent = _first_angle_deg(diffuse_row(_SCAN_RAD, diffuse=term)[0] == 0.0)
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
