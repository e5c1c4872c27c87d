"""Limits of the light of each region before anything is solved: that of the beam, and at most what air scatters."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model import geometry
from model.atmosphere.lighting.compute_lighting import compute_lighting
from model.atmosphere.lighting.fidelity import SolverSettings
from model.atmosphere.lighting.lighting import Lighting
from model.atmosphere.lighting.unlit import unlit_solution
from model.effects.air_bounds import AirBounds, bound_air, is_narrow
from model.effects.light_limits import LightLimits, known_light
from model.effects.pbrdf_grid import PbrdfGrid
from model.scene.aperture_radiance import aperture_lights
from model.scene.field_of_view import FieldPart, middle, off_axis
from model.scene.illumination import illuminate
from model.scene.lit_scene import Air, LitRegion, LitScene
from model.scene.scenario import RegionLight
from model.scene.view import View
from model.surface.pbrdf import Surface
from model.surface.tilt import Tilt

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
# The beam sees the depth of all layers and no more.
_FEWEST_LAYERS = SolverSettings(fine_layers=False, nodes=4, element_depth=0.1, tolerance=1e-3)
_WITH_BEAM = ("total", "reflected", "reflected_sun")


def light_limits(scene: LitScene) -> dict[str, LightLimits]:
    """Return the limits of each region's light, without solving anything.

    Parameters
    ----------
    scene
        All that the scene is.
    """
    found = {one.name: known_light(_as_given(one)) for one in scene.regions if one.radiance is not None}
    materials = [one for one in scene.regions if one.surface is not None]
    if not materials or scene.air is None:
        return found
    limits = bound_air(scene.air)
    lighting = beam_lighting(scene.air)
    return found | {one.name: sun_light(scene, one, lighting, limits) for one in materials}


def _as_given(region: LitRegion) -> RegionLight:
    radiance = np.zeros(3) if region.radiance is None else region.radiance
    return RegionLight(
        name=region.name,
        stokes_radiance=radiance,
        texture_rms=region.texture_rms,
        texture_cov=region.texture_cov,
    )


def beam_lighting(air: Air) -> Lighting:
    """Return the light of the beam alone; nothing is solved.

    Parameters
    ----------
    air
        The air.

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
        wavelengths=2 if is_narrow(air.band) else 4,
        dolp_max=air.dolp_max,
        solver=unlit_solution,
        settings=_FEWEST_LAYERS,
    )


def sun_light(scene: LitScene, region: LitRegion, lighting: Lighting, limits: AirBounds) -> LightLimits:
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
    panel = _panel(scene, region)
    found = _beams_between(_beams(panel, lighting), is_counted=scene.source in _WITH_BEAM)
    found = _with_sky(found, panel, limits)
    path = _path(panel, limits)
    of_beam, of_rest = _spread(found, panel, path=path)
    return replace(
        found,
        path=path,
        adjacency=_adjacency(scene, panel, limits),
        spread=_BETWEEN * of_beam + of_rest,
        deviation=of_beam + of_rest,
        depth=limits.depth,
        depth_below=limits.depth_below(panel.views[0].height_m),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Panel:
    """A region of a material under its air, and views over its part of the field, the middle first."""

    surface: Surface
    tilt: Tilt
    views: tuple[View, ...]
    air: Air
    sun_azimuth_rad: float

    @property
    def toward(self) -> FloatArray:
        """Directions toward the camera, (K, 3)."""
        return np.stack(
            [geometry.direction(zenith_rad=one.zenith_rad, azimuth_rad=one.azimuth_rad) for one in self.views]
        )

    @property
    def slant(self) -> float:
        """Longest way through air over that upward."""
        return 1.0 / min(float(np.cos(view.zenith_rad)) for view in self.views)


def _panel(scene: LitScene, region: LitRegion) -> _Panel:
    air, view, surface, tilt = scene.air, scene.view, region.surface, region.tilt
    if air is None or view is None or surface is None or tilt is None:
        raise ValueError(f"region {region.name}: needs air, view, surface and tilt")
    views = _field_views(view, region.part)
    return _Panel(surface=surface, tilt=tilt, views=views, air=air, sun_azimuth_rad=scene.sun_azimuth_rad)


def _field_views(view: View, part: FieldPart | None) -> tuple[View, ...]:
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


def _beams(panel: _Panel, lighting: Lighting) -> FloatArray:
    """Stokes radiance that the beam sends to each view of a panel, (K, 3)."""
    illumination = illuminate(
        lighting,
        sun_zenith_rad=panel.air.sun_zenith_rad,
        sun_azimuth_rad=panel.sun_azimuth_rad,
        ground_albedo=panel.air.ground_albedo,
        sky=_black_sky,
    )
    lights = aperture_lights(
        illumination, surface=panel.surface, tilt=panel.tilt, views=panel.views, skylight=False, path=False
    )
    return np.stack([light.reflected_sun for light in lights])


def _black_sky(*, zenith_rad: object, phi_rad: object) -> FloatArray:
    """Return no light from any direction."""
    shape = np.broadcast_shapes(np.shape(np.asarray(zenith_rad)), np.shape(np.asarray(phi_rad)))
    return np.zeros((*shape, 3))


def _with_sky(found: LightLimits, panel: _Panel, limits: AirBounds) -> LightLimits:
    """Limits with those of what the sky adds."""
    is_level = panel.tilt.tilt_rad == 0.0
    ground = 0.0 if is_level else 2.0 * np.pi * limits.ground_radiance
    grid = PbrdfGrid.of(panel.surface, geometry.angle_between_rad(panel.tilt.normal, panel.toward))
    skies, again = _MISSED * grid.largest * (limits.sky_actinic + ground), np.full(2, np.inf)
    if is_level and limits.depth < _THIN:
        sun = {"sun_zenith_rad": panel.air.sun_zenith_rad, "sun_azimuth_rad": panel.sun_azimuth_rad}
        skies = np.minimum(skies, _MISSED * grid.reflected(limits.sky, panel.views, **sun))
        again = _MISSED * grid.reflected(limits.sky_again, panel.views, **sun)
    sky, polarised = skies.tolist()
    if limits.depth < _NEXT_TO_NONE:
        sky = polarised = _FEW_DIGITS * sky
    return replace(
        found,
        sky=sky,
        sky_polarised=min(polarised, sky),
        sky_again=float(again[0]) if limits.depth > _NEXT_TO_NONE else np.inf,
        sky_again_polarised=float(again[1]),
    )


def _beams_between(beams: FloatArray, *, is_counted: bool) -> LightLimits:
    """Limits of the beam's light between directions at which it is known; none where it does not count."""
    if not is_counted:
        return LightLimits(beams=np.zeros_like(beams), s0_low=0.0, s0_high=0.0, polarised_low=0.0, polarised_high=0.0)
    known = float(np.max(np.linalg.norm(beams - beams[0], axis=-1)))
    apart = (_BETWEEN - 1.0) * known
    polarised = np.hypot(beams[:, 1], beams[:, 2])
    # A channel gets at most half of S0 and of the polarised light, 0.71 of the length of a change.
    reach = np.array([2.0 * apart, 0.0, 0.0])
    edges = np.concatenate([beams + reach, beams - reach])
    return LightLimits(
        beams=edges,
        s0_low=max(float(beams[:, 0].min()) - apart, 0.0),
        s0_high=float(beams[:, 0].max()) + apart,
        polarised_low=max(float(polarised.min()) - apart, 0.0),
        polarised_high=float(polarised.max()) + apart,
        apart=known,
    )


def _spread(light: LightLimits, panel: _Panel, *, path: float) -> tuple[float, float]:
    """Largest difference over the field from its middle, over S0: of the beam where it is known, and of the rest.

    The reflected sky changes with the view as fast as the lobe is narrow; it is at most all of the light.
    """
    if len(panel.views) == 1:
        return 0.0, 0.0
    if light.s0_low <= 0.0:
        return np.inf, 0.0
    toward, slant = panel.toward, panel.slant
    angle = float(np.max(geometry.angle_between_rad(toward[0], toward[1:])))
    of_beam = light.apart / light.s0_low
    of_sky = angle * 2.0 * (1.0 / panel.surface.slope_rms + 4.0 * slant) * min(1.0, SKY_ROOM * light.sky / light.s0_low)
    of_path = angle * (2.0 * slant + 10.0) * min(1.0, path / light.s0_low)
    return of_beam, of_sky + of_path


def _path(panel: _Panel, limits: AirBounds) -> float:
    sun = geometry.direction(zenith_rad=panel.air.sun_zenith_rad, azimuth_rad=panel.sun_azimuth_rad)
    return limits.path(
        height_m=panel.views[0].height_m,
        view_zenith_rad=np.array([view.zenith_rad for view in panel.views]),
        scattering_rad=geometry.angle_between_rad(-sun, panel.toward),
    )


def _adjacency(scene: LitScene, panel: _Panel, limits: AirBounds) -> float:
    """Most that the surroundings add: T^b - T of their light beyond that of the mean ground (`AirBounds.mixed_in`)."""
    around, ground = scene.imperfections.surround_albedo, panel.air.ground_albedo
    if around is None or around == ground:
        return 0.0
    mixed = limits.mixed_in(height_m=panel.views[0].height_m, slant=panel.slant)
    return abs(around - ground) / np.pi * limits.received * mixed if mixed > 0.0 else 0.0
