"""Light of a region over one more tile along each side: beside it stands what the tiles of a result miss."""

from math import isqrt

from model.accuracy.evaluation.chain import ChainResult, region_light
from model.effects.acting import acting
from model.scene.adjacency import with_surroundings
from model.scene.aperture_radiance import aperture_lights
from model.scene.field_light import FieldLight
from model.scene.field_of_view import tiles
from model.scene.lit_scene import LitScene
from model.scene.scenario import RegionLight


def on_more_tiles(scene: LitScene, result: ChainResult, name: str) -> RegionLight | None:
    """Return the light of a region over one more tile along each side; None for a point.

    Parameters
    ----------
    scene, result
        What was evaluated, and what was found.
    name
        Of a region that is given by its material.

    Raises
    ------
    ValueError
        The radiance of the region is given.

    References
    ----------
    Definition; rules of the hemisphere integral as for the tiles.
    """
    region = next(one for one in scene.regions if one.name == name)
    air, view, illumination = scene.air, scene.view, result.illumination
    if air is None or view is None or illumination is None or region.surface is None or region.tilt is None:
        raise ValueError(f"region {name}: its radiance is given, there is nothing to compute")
    own = result.lights[name].lights
    if region.part is None or len(own) == 1:
        return None
    seen = acting(scene, result.effects)
    more = tiles(region.part, view, per_side=isqrt(len(own)) + 1, rule=result.settings.tile_rule)
    lights = aperture_lights(
        illumination,
        surface=region.surface,
        tilt=region.tilt,
        views=tuple(tile.view for tile in more),
        rules=own[0].rules,
        skylight=seen.parts.skylight,
        path=seen.parts.path_radiance,
    )
    field = FieldLight(lights=lights, weights=tuple(tile.weight for tile in more), spread=result.lights[name].spread)
    around = seen.imperfections.surround_albedo
    if around is not None:
        field = with_surroundings(field, illumination, surround_albedo=around, ground_albedo=air.ground_albedo)
    return region_light(seen, region, field)
