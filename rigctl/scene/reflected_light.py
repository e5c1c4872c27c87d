"""Light reflected by a material: in the principal plane, over the hemisphere, and in total; with its sources."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.stokes import dolp
from model.surface.facets import lobe_reflectance
from model.surface.materials import Material, Property, properties
from model.surface.pbrdf import Surface, findings, hemispherical_reflectance, mueller
from rigctl.files.materials import NM_PER_M

FloatArray = NDArray[np.float64]

_CAMERA_ZENITHS_DEG = np.arange(-85.0, 86.0, 5.0)
_SUN_ZENITHS_DEG = np.append(np.arange(0.0, 81.0, 10.0), [85.0, 89.0])
# Resolution of the figures.
CURVE_DEG = np.linspace(-89.0, 89.0, 713)
RINGS_DEG = np.linspace(0.0, 89.0, 179)
ROUND_DEG = np.linspace(-180.0, 180.0, 361)
# Of a standard uncertainty: a difference quotient.
_STEP = 0.1


@dataclass(frozen=True, kw_only=True)
class ReflectedLight:
    """Unpolarized light after reflection into one direction of the principal plane."""

    #: Positive toward the mirror direction, negative on the sun's side.
    camera_zenith_deg: float
    f00_per_sr: float  #: Reflected radiance by irradiance.
    s1n: float | None  #: S1 / S0 and DoLP; None without reflected light.
    dolp: float | None


@dataclass(frozen=True, kw_only=True)
class Reflectance:
    """Directional-hemispherical reflectance at one angle of incidence."""

    zenith_deg: float  #: Angle of incidence.
    total: float  #: Of unpolarized light: of the surface, and the part of it that is the specular lobe's.
    specular: float
    horizontal: float  #: Of light that is fully polarized in this direction.
    vertical: float
    error: float  #: Estimated numerical error.


@dataclass(frozen=True, kw_only=True)
class SurfaceSheet:
    """Properties and reflection of a material at one wavelength and one angle of the sun."""

    material: str  #: Name.
    surface: Surface  #: The surface at the wavelength.
    wavelength_nm: float  #: At which.
    sun_zenith_deg: float
    properties: dict[str, Property]  #: Every property at the wavelength.
    principal_plane: tuple[ReflectedLight, ...]  #: In the plane of sun and normal.
    reflectance: tuple[Reflectance, ...]  #: Over angles of incidence.
    findings: tuple[str, ...]  #: Unphysical properties, in words.


def surface_sheet(material: Material, surface: Surface, *, wavelength_nm: float, sun_zenith_deg: float) -> SurfaceSheet:
    """Return properties and reflection of a material; of a measured one at the measured angles."""
    sun_rad, cameras_deg = float(np.deg2rad(sun_zenith_deg)), _CAMERA_ZENITHS_DEG
    if surface.table is not None:
        surface.table.require_covered(np.array([sun_rad]), np.zeros(1))
        covered = surface.table.covers(np.full(cameras_deg.shape, sun_rad), np.abs(np.deg2rad(cameras_deg)))
        cameras_deg = cameras_deg[covered]
    stokes = principal_plane(surface, np.deg2rad(cameras_deg), sun_zenith_rad=sun_rad)
    return SurfaceSheet(
        material=material.name,
        surface=surface,
        wavelength_nm=wavelength_nm,
        sun_zenith_deg=sun_zenith_deg,
        properties=properties(material.at(wavelength_nm / NM_PER_M)),
        principal_plane=tuple(_light(angle, row) for angle, row in zip(cameras_deg, stokes, strict=True)),
        reflectance=_reflectances(surface),
        findings=findings(surface),
    )


def reflected_maps(surface: Surface, *, sun_zenith_deg: float) -> tuple[FloatArray, FloatArray]:
    """Return Stokes radiance over irradiance of unpolarized light, at the resolution of the figures [sr^-1].

    In the principal plane, at `CURVE_DEG`; and over all directions of the camera, at zenith angles `RINGS_DEG` and
    azimuths `ROUND_DEG` from the sun's, clockwise from above. NaN outside a table's measurements.
    """
    sun_zenith_rad = float(np.deg2rad(sun_zenith_deg))
    azimuth_rad, zenith_rad = np.meshgrid(np.deg2rad(ROUND_DEG), np.deg2rad(RINGS_DEG))
    # Compass azimuths run clockwise from above; phi is the sun's less the camera's.
    matrix = mueller(sun_zenith_rad, zenith_rad, -azimuth_rad, surface=surface)
    curve = principal_plane(surface, np.deg2rad(CURVE_DEG), sun_zenith_rad=sun_zenith_rad)
    if surface.table is not None:
        matrix[~surface.table.covers(np.full(zenith_rad.shape, sun_zenith_rad), zenith_rad)] = np.nan
        seen = np.abs(np.deg2rad(CURVE_DEG))
        curve[~surface.table.covers(np.full(seen.shape, sun_zenith_rad), seen)] = np.nan
    return curve, matrix[..., 0]


def principal_plane(surface: Surface, camera_zenith_rad: FloatArray, *, sun_zenith_rad: float) -> FloatArray:
    """Return Stokes radiance over irradiance of unpolarized light, shape (N, 3) [sr^-1]; see `ReflectedLight`."""
    phi = np.where(camera_zenith_rad >= 0.0, np.pi, 0.0)
    return mueller(sun_zenith_rad, np.abs(camera_zenith_rad), phi, surface=surface)[..., 0]


def readings_at(
    material: Material,
    incidence_rad: FloatArray,
    reflection_rad: FloatArray,
    azimuth_rad: FloatArray,
    *,
    surface_of: Callable[[Material], Surface],
) -> tuple[FloatArray, FloatArray]:
    """Return f00, S1/S0, S2/S0 and DoLP of reflected unpolarized light, shape (N, 4), and their standard uncertainty.

    To first order from the properties' own, which count as independent. `surface_of` makes the surface of a material.
    """

    def readings(changed: Material) -> FloatArray:
        surface = surface_of(changed)
        if surface.table is not None:
            surface.table.require_covered(incidence_rad, reflection_rad)
        stokes = mueller(incidence_rad, reflection_rad, azimuth_rad, surface=surface)[..., 0]
        f00 = np.where(stokes[:, 0] > 0.0, stokes[:, 0], np.nan)
        ratios = stokes[:, 1:] / f00[:, None]
        return np.column_stack([stokes[:, 0], ratios, np.hypot(*ratios.T)])

    found = readings(material)
    variance = np.zeros_like(found)
    for name, given in properties(material).items():
        slopes = []
        for step in (_STEP, -_STEP):
            values = tuple(value + step * given.standard_uncertainty for value in given.values)
            change: dict[str, Any] = {name: replace(given, values=values)}
            try:
                slopes.append((readings(replace(material, **change)) - found) / step)
            except ValueError:  # outside the range of a surface: one-sided slope
                continue
        variance += np.mean(slopes, axis=0) ** 2 if slopes and given.standard_uncertainty else 0.0
    return found, np.sqrt(variance)


def _light(camera_zenith_deg: float, stokes: FloatArray) -> ReflectedLight:
    seen = stokes[0] > 0.0
    return ReflectedLight(
        camera_zenith_deg=float(camera_zenith_deg),
        f00_per_sr=float(stokes[0]),
        s1n=float(stokes[1] / stokes[0]) if seen else None,
        dolp=float(dolp(stokes)) if seen else None,
    )


def _reflectances(surface: Surface) -> tuple[Reflectance, ...]:
    zeniths_deg = _SUN_ZENITHS_DEG
    if surface.table is not None:
        zeniths_deg = zeniths_deg[np.deg2rad(zeniths_deg) <= surface.table.largest_rad[1]]
    zenith_rad = np.deg2rad(zeniths_deg)
    total = hemispherical_reflectance(zenith_rad, surface=surface)
    specular = surface.specular_weight * lobe_reflectance(zenith_rad, lobe=surface.lobe).s0
    return tuple(
        Reflectance(
            zenith_deg=float(angle),
            total=float(total.s0[i]),
            specular=float(specular[i]),
            horizontal=float(total.s0[i] + total.s1[i]),
            vertical=float(total.s0[i] - total.s1[i]),
            error=float(total.error[i]),
        )
        for i, angle in enumerate(zeniths_deg)
    )
