"""Light of the direct beam alone from a region to the camera: cheap, and the least that there is."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.atmosphere.lighting.compute_lighting import compute_lighting
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.unlit import unlit_solution
from model.effects.air_bounds import AirBounds
from model.effects.pbrdf_grid import PbrdfGrid
from model.scene.aperture_radiance import aperture_lights
from model.scene.field_of_view import FieldPart, middle, off_axis
from model.scene.illumination import illuminate
from model.scene.lit_scene import Air, LitRegion, LitScene
from model.scene.scenario import RegionLight
from model.scene.view import View

FloatArray = NDArray[np.float64]

# What the largest pBRDF on a grid is taken times for what its steps miss.
_MISSED = 1.5
# Under air as thick as this the sky sends so much that no sharper bound of it helps.
_THIN = 0.05
# Under air thinner than this a computed sky is bright at the horizon alone and has few digits there, if any: its grid
# may be off by more than all of it, and polarised by more than 1. Sharp bounds are of no use there, for all of it is
# next to nothing.
_NEXT_TO_NONE, _FEW_DIGITS = 1e-4, 10.0
# Over a field the beam's light is known at nine directions; between them it may go this much farther.
_BETWEEN = 2.0
# How the sky changes over a field is known less well than how much it is; and rules of an integral differ over it.
SKY_ROOM = 5.0
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
    sky_polarised
        Upper limit of the polarised light that the sky adds.
    sky_again, sky_again_polarised
        The same of light that was scattered more than once, and not only by the ground before; infinite where no
        useful limit is known.
    apart
        Largest difference of the beam's light from its middle, of directions at which it is known.
    spread
        Upper limit of the difference between a direction of the field and its middle, over S0.
    deviation
        Upper limit of the root of the mean square of that difference.
    depth, depth_below
        Largest optical depth in the band, of all air and of that below the camera.
    texture, field_cov
        Covariance of the texture and over the field, shape (3, 3), where they are known [(W m-2 sr-1)^2].
    """

    beams: FloatArray
    s0_low: float
    s0_high: float
    polarised_low: float
    polarised_high: float
    sky: float = 0.0
    sky_polarised: float = 0.0
    sky_again: float = np.inf
    sky_again_polarised: float = np.inf
    path: float = 0.0
    adjacency: float = 0.0
    apart: float = 0.0
    spread: float = 0.0
    deviation: float = 0.0
    depth: float = np.inf
    depth_below: float = np.inf
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


def beam_lighting(air: Air, limits: AirBounds) -> Lighting:
    """Return the light of the beam alone; nothing is solved.

    Parameters
    ----------
    air
        The air.
    limits
        Of its light, which tell whether the band is narrow.

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
        wavelengths=2 if limits.is_narrow else 4,
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
    Sky: of light of any polarization a surface reflects at most f0 = F00 + |(F01, F02)|, and as polarised light at
    most fp = |(F10, F20)| + the norm of the rest of F, which a diffuse term has not. Either is at most the largest of
    it times cos(theta_i) times the sum of the radiance over the sky. The largest is sought on a grid with the mirror
    direction, and taken times 1.5. A level surface reflects no more than the sum over that grid times the bound of the
    sky's radiance in each direction, times 1.5 too: under thin air, bright at the horizon alone, that is far less.

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
    grid = PbrdfGrid.of(surface, normal_rad)
    skies, rest = _MISSED * grid.largest * (limits.sky_actinic + ground), np.full(2, np.inf)
    if tilt.tilt_rad == 0.0 and limits.depth < _THIN:
        reflected = partial(
            grid.reflected, views=views, sun_zenith_rad=air.sun_zenith_rad, sun_azimuth_rad=scene.sun_azimuth_rad
        )
        skies, rest = np.minimum(skies, _MISSED * reflected(limits.sky)), _MISSED * reflected(limits.sky_again)
    sky, polarised = skies.tolist()
    if limits.depth < _NEXT_TO_NONE:
        sky = polarised = _FEW_DIGITS * sky
    path = _path(limits, air, views, scene.sun_azimuth_rad)
    found = _beams_between(beams, is_counted=scene.source in _WITH_BEAM)
    of_beam, of_rest = _spread(found, views, sky=SKY_ROOM * sky, path=path, slope_rms=surface.slope_rms)
    return replace(
        found,
        sky=sky,
        sky_polarised=min(polarised, sky),
        sky_again=float(rest[0]) if limits.depth > _NEXT_TO_NONE else np.inf,
        sky_again_polarised=float(rest[1]),
        path=path,
        adjacency=_adjacency(scene, air, views, limits),
        spread=_BETWEEN * of_beam + of_rest,
        deviation=of_beam + of_rest,
        depth=limits.depth,
        depth_below=limits.depth_below(view.height_m),
    )


def field_views(view: View, part: FieldPart | None) -> tuple[View, ...]:
    """Return the axis or, over a part of the field, its middle, the middles of its edges, and its corners."""
    if part is None:
        return (view,)
    across, upward = middle(part)
    rights, ups = (
        (np.tan(low), between, np.tan(high))
        for low, between, high in ((part.left_rad, across, part.right_rad), (part.bottom_rad, upward, part.top_rad))
    )
    others = [(float(x), float(y)) for x in rights for y in ups if (x, y) != (across, upward)]
    return tuple(off_axis(view, right=x, up=y) for x, y in ((across, upward), *others))


def black_sky(*, zenith_rad: object, phi_rad: object) -> FloatArray:
    """Return no light from any direction."""
    shape = np.broadcast_shapes(np.shape(np.asarray(zenith_rad)), np.shape(np.asarray(phi_rad)))
    return np.zeros((*shape, 3))


def _beams_between(beams: FloatArray, *, is_counted: bool) -> SunLight:
    """Limits of the beam's light between directions at which it is known; none where it does not count."""
    if not is_counted:
        return SunLight(beams=np.zeros_like(beams), s0_low=0.0, s0_high=0.0, polarised_low=0.0, polarised_high=0.0)
    known = float(np.max(np.linalg.norm(beams - beams[0], axis=-1)))
    apart = (_BETWEEN - 1.0) * known
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
        apart=known,
    )


def _spread(
    light: SunLight, views: tuple[View, ...], *, sky: float, path: float, slope_rms: float
) -> tuple[float, float]:
    """Largest difference over the field from its middle, over S0: of the beam where it is known, and of the rest.

    The reflected sky changes with the view as fast as the lobe is narrow; it is at most all of the light.
    """
    if len(views) == 1:
        return 0.0, 0.0
    if light.s0_low <= 0.0:
        return np.inf, 0.0
    toward = _toward(views)
    angle = float(np.max(geometry.angle_between_rad(toward[0], toward[1:])))
    slant = 1.0 / min(float(np.cos(view.zenith_rad)) for view in views)
    of_beam = light.apart / light.s0_low
    of_sky = angle * 2.0 * (1.0 / slope_rms + 4.0 * slant) * min(1.0, sky / light.s0_low)
    of_path = angle * (2.0 * slant + 10.0) * min(1.0, path / light.s0_low)
    return of_beam, of_sky + of_path


def _path(limits: AirBounds, air: Air, views: tuple[View, ...], sun_azimuth_rad: float) -> float:
    sun = geometry.direction(zenith_rad=air.sun_zenith_rad, azimuth_rad=sun_azimuth_rad)
    return limits.path(
        height_m=views[0].height_m,
        view_zenith_rad=np.array([view.zenith_rad for view in views]),
        scattering_rad=geometry.angle_between_rad(-sun, _toward(views)),
    )


def _adjacency(scene: LitScene, air: Air, views: tuple[View, ...], limits: AirBounds) -> float:
    """Most that the surroundings add: T^b - T of their light beyond that of the mean ground (`AirBounds.mixed_in`)."""
    around = scene.imperfections.surround_albedo
    if around is None or around == air.ground_albedo:
        return 0.0
    slant = 1.0 / min(float(np.cos(view.zenith_rad)) for view in views)
    mixed = limits.mixed_in(height_m=views[0].height_m, slant=slant)
    return abs(around - air.ground_albedo) / np.pi * limits.received * mixed if mixed > 0.0 else 0.0


def _toward(views: tuple[View, ...]) -> FloatArray:
    return np.stack([geometry.direction(zenith_rad=one.zenith_rad, azimuth_rad=one.azimuth_rad) for one in views])
