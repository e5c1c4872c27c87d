"""Light of the direct beam alone from a region to the camera: cheap, and the least that there is."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.atmosphere.lighting.compute_lighting import compute_lighting
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.unlit import unlit_solution
from model.effects.air_bounds import AirBounds, depth_below, path_bound
from model.scene.adjacency import BACKSCATTER
from model.scene.aperture_radiance import aperture_lights
from model.scene.field_of_view import FieldPart, off_axis
from model.scene.illumination import illuminate
from model.scene.lit_scene import Air, LitRegion, LitScene
from model.scene.scenario import RegionLight
from model.scene.view import View
from model.surface.pbrdf import Surface, mueller

FloatArray = NDArray[np.float64]

# Steps over the hemisphere in the search of the largest pBRDF, and what it is taken times for what they miss.
_ZENITHS, _AZIMUTHS, _MISSED = 46, 31, 1.5
# Over a field the beam's light is known at nine directions; between them it may go this much farther.
_BETWEEN = 2.0
_WITH_BEAM = ("total", "reflected", "reflected_sun")


@dataclass(frozen=True, kw_only=True, eq=False)
class SunLight:
    """Limits of a region's radiance [W m-2 sr-1].

    Attributes
    ----------
    beams
        Stokes radiance from the beam at directions of the field, shape (K, 3); of a given radiance that itself.
    s0_low, s0_high, polarised_low, polarised_high
        Of these.
    sky, path, adjacency
        Upper limits of what sky, path and surroundings add.
    spread
        Upper limit of the difference between a direction of the field and the axis, over S0.
    texture, field_cov
        Covariance of the texture and over the field, shape (3, 3), where they are known [(W m-2 sr-1)^2].
    """

    beams: FloatArray
    s0_low: float
    s0_high: float
    polarised_low: float
    polarised_high: float
    sky: float = 0.0
    path: float = 0.0
    adjacency: float = 0.0
    spread: float = 0.0
    texture: FloatArray | None = None
    field_cov: FloatArray | None = None

    @property
    def added(self) -> float:
        """Upper limit of all that comes beside the beam."""
        return self.sky + self.path + self.adjacency


def known_light(light: RegionLight, *, margin: float = 0.0) -> SunLight:
    """Return the limits of a region whose light is known.

    Parameters
    ----------
    light
        Of the region.
    margin
        By which its radiance may be off, as a share: what was left out of it, 0 or more.
    """
    stokes = np.asarray(light.stokes_radiance, dtype=np.float64)
    s0, polarised = float(stokes[0]), float(np.hypot(stokes[1], stokes[2]))
    apart = margin * s0
    off = np.array([2.0 * apart, 0.0, 0.0])
    texture = light.texture_rms**2 * np.outer(stokes, stokes) + light.texture_cov
    return SunLight(
        beams=np.stack([stokes - off, stokes + off]),
        s0_low=s0 - apart,
        s0_high=s0 + apart,
        polarised_low=max(polarised - apart, 0.0),
        polarised_high=polarised + apart,
        texture=(1.0 + margin) ** 2 * texture,
        field_cov=light.field_cov,
    )


def beam_lighting(air: Air) -> Lighting:
    """Return the light of the beam alone; nothing is solved.

    Raises
    ------
    ValueError
        There is neither an atmosphere nor a table.
    """
    if air.table is not None:
        return air.table
    if air.state is None:
        raise ValueError("atmosphere: visibility or optical depth of the aerosol is needed, or a table")
    return compute_lighting(
        air.state,
        fidelity=air.fidelity,
        band=air.band,
        mu0=float(np.cos(air.sun_zenith_rad)),
        albedo=air.ground_albedo,
        aerosol=air.aerosol,
        wavelengths=4,
        dolp_max=air.dolp_max,
        solver=unlit_solution,
    )


def sun_light(scene: LitScene, region: LitRegion, lighting: Lighting, limits: AirBounds) -> SunLight:
    """Return the limits of a region's radiance before sky and path are known.

    Parameters
    ----------
    scene, region
        A region that is given by its material.
    lighting
        From `beam_lighting`.
    limits
        Of the light that the air scatters.

    Raises
    ------
    ValueError
        The scene has no air or view, or the region no surface.

    Notes
    -----
    Sky: a surface reflects at most the largest of F00 cos(theta_i) times the sum of the radiance over the sky, and for
    polarised light twice that. The largest is sought on a grid with the mirror direction, and taken times 1.5.

    References
    ----------
    [MK14] eq. (2), (3).
    """
    air, view, surface, tilt = scene.air, scene.view, region.surface, region.tilt
    if air is None or view is None or surface is None or tilt is None:
        raise ValueError(f"region {region.name}: needs air, view, surface and tilt")
    illumination = illuminate(
        lighting,
        sun_zenith_rad=air.sun_zenith_rad,
        sun_azimuth_rad=scene.sun_azimuth_rad,
        ground_albedo=air.ground_albedo,
        sky=black_sky,
    )
    views = field_views(view, region.part)
    lights = aperture_lights(illumination, surface=surface, tilt=tilt, views=views, skylight=False, path=False)
    beams = np.stack([light.reflected_sun for light in lights])
    normal_rad = geometry.angle_between_rad(tilt.normal, _toward(views))
    ground = 2.0 * np.pi * limits.ground_radiance if tilt.tilt_rad > 0.0 else 0.0
    sky = 2.0 * largest_pbrdf(surface, normal_rad) * (limits.sky_actinic + ground)
    path = max(_path(air, one, scene.sun_azimuth_rad) for one in views)
    found = _beams_between(beams, is_counted=scene.source in _WITH_BEAM)
    spread = _spread(found, views, sky=sky, path=path, slope_rms=surface.slope_rms)
    return replace(found, sky=sky, path=path, adjacency=_adjacency(scene, air, views, limits), spread=spread)


def field_views(view: View, part: FieldPart | None) -> tuple[View, ...]:
    """Return the axis and, over a part of the field, its middle, the middles of its edges, and its corners."""
    if part is None:
        return (view,)
    across, upward = (
        (np.tan(low), 0.5 * (np.tan(low) + np.tan(high)), np.tan(high))
        for low, high in ((part.left_rad, part.right_rad), (part.bottom_rad, part.top_rad))
    )
    return (view, *(off_axis(view, right=float(x), up=float(y)) for x in across for y in upward))


def largest_pbrdf(surface: Surface, theta_r_rad: FloatArray) -> float:
    """Return the largest of F00 cos(theta_i) over the sky, for the worst of some views [sr-1].

    Parameters
    ----------
    theta_r_rad
        Angles of the views from its normal, shape (K,) [rad].
    """
    grid = np.linspace(0.0, 0.5 * np.pi - 1e-3, _ZENITHS)
    near = surface.slope_rms * np.linspace(-3.0, 3.0, 13)
    zenith = np.unique(np.clip(np.concatenate([grid, *(one + near for one in theta_r_rad)]), 0.0, 0.5 * np.pi - 1e-6))
    azimuth = np.unique(np.concatenate([np.linspace(0.0, np.pi, _AZIMUTHS), np.pi - np.abs(near)]))
    found = [
        mueller(zenith[:, np.newaxis], one, azimuth, surface=surface)[..., 0, 0] * np.cos(zenith)[:, np.newaxis]
        for one in sorted({round(float(angle), 3) for angle in theta_r_rad})
    ]
    return float(_MISSED * np.max(found))


def black_sky(*, zenith_rad: object, phi_rad: object) -> FloatArray:
    """Return no light from any direction."""
    shape = np.broadcast_shapes(np.shape(np.asarray(zenith_rad)), np.shape(np.asarray(phi_rad)))
    return np.zeros((*shape, 3))


def _beams_between(beams: FloatArray, *, is_counted: bool) -> SunLight:
    """Limits of the beam's light between directions at which it is known; none where it does not count."""
    if not is_counted:
        return SunLight(beams=np.zeros_like(beams), s0_low=0.0, s0_high=0.0, polarised_low=0.0, polarised_high=0.0)
    apart = (_BETWEEN - 1.0) * float(np.max(np.linalg.norm(beams - beams[0], axis=-1)))
    polarised = np.hypot(beams[:, 1], beams[:, 2])
    # A channel gets at most half of S0 and of the polarised light, 0.71 of the length of a change.
    reach = np.array([2.0 * apart, 0.0, 0.0])
    edges = np.concatenate([beams + reach, beams - reach])
    return SunLight(
        beams=edges,
        s0_low=max(float(beams[:, 0].min()) - apart, 0.0),
        s0_high=float(beams[:, 0].max()) + apart,
        polarised_low=max(float(polarised.min()) - apart, 0.0),
        polarised_high=float(polarised.max()) + apart,
    )


def _spread(light: SunLight, views: tuple[View, ...], *, sky: float, path: float, slope_rms: float) -> float:
    """Largest difference over the field from the axis, over S0.

    The reflected sky changes with the view as fast as the lobe is narrow; it is at most all of the light.
    """
    if len(views) == 1:
        return 0.0
    if light.s0_low <= 0.0:
        return np.inf
    toward = _toward(views)
    angle = float(np.max(geometry.angle_between_rad(toward[0], toward[1:])))
    slant = 1.0 / min(float(np.cos(view.zenith_rad)) for view in views)
    of_beam = _BETWEEN * float(np.max(np.linalg.norm(light.beams - light.beams[0], axis=-1))) / light.s0_low
    of_sky = angle * 2.0 * (1.0 / slope_rms + 4.0 * slant) * min(1.0, sky / light.s0_low)
    of_path = angle * (2.0 * slant + 10.0) * min(1.0, path / light.s0_low)
    return of_beam + of_sky + of_path


def _path(air: Air, view: View, sun_azimuth_rad: float) -> float:
    sun = geometry.direction(zenith_rad=air.sun_zenith_rad, azimuth_rad=sun_azimuth_rad)
    camera = geometry.direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
    return path_bound(
        air,
        height_m=view.height_m,
        view_zenith_rad=view.zenith_rad,
        scattering_rad=float(geometry.angle_between_rad(-sun, camera)),
    )


def _adjacency(scene: LitScene, air: Air, views: tuple[View, ...], limits: AirBounds) -> float:
    """Since T^b - T is the integral of -ln(T) T^x over x from b to 1, it is at most (1 - b) (-ln T), and at most 1."""
    around = scene.imperfections.surround_albedo
    if around is None or around == air.ground_albedo:
        return 0.0
    (height_m,) = {view.height_m for view in views}
    slant = 1.0 / min(float(np.cos(view.zenith_rad)) for view in views)
    mixed = min((1.0 - BACKSCATTER) * depth_below(air, height_m=height_m) * slant, 1.0) if height_m > 0.0 else 0.0
    return abs(around - air.ground_albedo) / np.pi * limits.received * mixed if mixed > 0.0 else 0.0


def _toward(views: tuple[View, ...]) -> FloatArray:
    return np.stack([geometry.direction(zenith_rad=one.zenith_rad, azimuth_rad=one.azimuth_rad) for one in views])
