"""Light of the regions of a scene by given numerical settings, and the scenario that it makes."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model.accuracy.evaluation.light_requests import LightRequest
from model.scene.adjacency import with_surroundings
from model.scene.falloff import cosine_fourth
from model.scene.scenario import RegionLight, Scenario

if TYPE_CHECKING:
    from model.accuracy.evaluation.light_store import LightStore
    from model.accuracy.evaluation.settings import Settings
    from model.scene.field_light import FieldLight
    from model.scene.hemisphere import Rules
    from model.scene.illumination import Illumination
    from model.scene.lit_scene import LitRegion, LitScene

_NO_RULES: Mapping[str, "Rules"] = {}


def light_requests(scene: "LitScene", settings: "Settings", rules: Mapping[str, "Rules"]) -> Iterator[LightRequest]:
    """Yield the lights of a scene that are to be computed, by known rules of the hemisphere integral if there are."""
    air, view = scene.air, scene.view
    if air is None or view is None:
        return
    for region in _materials(scene):
        yield LightRequest(
            region=region,
            settings=settings,
            air=air,
            view=view,
            sun_azimuth_rad=scene.sun_azimuth_rad,
            parts=scene.parts,
            rules=rules.get(region.name),
        )


def region_light(seen: "LitScene", region: "LitRegion", field: "FieldLight") -> RegionLight:
    """Return what a prediction takes of the light of a region over its part of the field.

    Parameters
    ----------
    seen
        The scene with the effects that act.
    region
        Of the scene, given by its material.
    field
        Its light.

    References
    ----------
    [MK14] eq. (7)-(10).
    """
    whole = field.moments(
        seen.source,
        texture_rms=region.texture_rms,
        texture_diagonal=region.texture_diagonal,
        texture_cov=region.texture_cov,
    )
    over_field = field.moments(seen.source, texture_cov=np.zeros((3, 3))).cov
    light = RegionLight(
        name=region.name,
        stokes_radiance=whole.mean,
        texture_rms=0.0,
        texture_cov=whole.cov - over_field,
        field_cov=over_field,
    )
    return _with_falloff(light, region, seen)


def sun_and_sky(scene: "LitScene", settings: "Settings", lights: "LightStore") -> "Illumination | None":
    """Return sun, sky and air of a scene; None where every radiance is given."""
    if scene.air is None or not _materials(scene):
        return None
    return lights.illumination(scene.air, settings, sun_azimuth_rad=scene.sun_azimuth_rad, parts=scene.parts)


def lit_fields(
    scene: "LitScene", settings: "Settings", lights: "LightStore", rules: Mapping[str, "Rules"] = _NO_RULES
) -> dict[str, "FieldLight"]:
    """Return the light of the regions that are given by a material."""
    air, view, azimuth = scene.air, scene.view, scene.sun_azimuth_rad
    if air is None or view is None:
        return {}
    found = {
        one.name: lights.region(
            one,
            settings,
            air=air,
            view=view,
            sun_azimuth_rad=azimuth,
            parts=scene.parts,
            rules=rules.get(one.name),
        )
        for one in _materials(scene)
    }
    around = scene.imperfections.surround_albedo
    if around is None or not found:
        return found
    illumination = lights.illumination(air, settings, sun_azimuth_rad=azimuth, parts=scene.parts)
    return {
        name: with_surroundings(light, illumination, surround_albedo=around, ground_albedo=air.ground_albedo)
        for name, light in found.items()
    }


def used_settings(settings: "Settings", scene: "LitScene") -> "Settings":
    """Return settings with one wavelength where the band does not act."""
    return settings if scene.parts.wavelengths else replace(settings, wavelengths=1)


def _materials(scene: "LitScene") -> tuple["LitRegion", ...]:
    return tuple(region for region in scene.regions if region.surface is not None)


def lit_scenario(scene: "LitScene", fields: dict[str, "FieldLight"]) -> Scenario:
    """Return the light of each region at the aperture, with sensor and readout."""
    regions = tuple(_region_light(region, fields, scene) for region in scene.regions)
    return Scenario(regions=regions, sensor=scene.sensor, readout=scene.readout, imperfections=scene.imperfections)


def _region_light(region: "LitRegion", fields: dict[str, "FieldLight"], scene: "LitScene") -> RegionLight:
    if region.radiance is None:
        return region_light(scene, region, fields[region.name])
    given = RegionLight(
        name=region.name,
        stokes_radiance=region.radiance,
        texture_rms=region.texture_rms,
        texture_cov=region.texture_cov,
    )
    return _with_falloff(given, region, scene)


def _with_falloff(light: RegionLight, region: "LitRegion", scene: "LitScene") -> RegionLight:
    if region.part is None or not scene.imperfections.off_axis_falloff:
        return light
    falloff = cosine_fourth(region.part)
    return replace(light, falloff_mean=falloff.mean, falloff_var=falloff.var)
