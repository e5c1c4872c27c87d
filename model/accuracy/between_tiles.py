"""Light of a region along lines of sight between its tiles."""

import numpy as np

from model.accuracy.chain import ChainResult
from model.accuracy.field_error import PLACES
from model.adjacency import with_surroundings
from model.effects.acting import acting
from model.effects.names import Effect
from model.field_light import FieldLight
from model.field_of_view import off_axis
from model.lit_scene import LitRegion, LitScene
from model.scene import aperture_lights


def light_between_tiles(scene: LitScene, region: LitRegion, result: ChainResult) -> FieldLight:
    """Return the light of a region at `model.accuracy.field_error.PLACES` of its part of the field.

    Parameters
    ----------
    scene, result
        What was evaluated, and what was found.
    region
        Given by its material, over a part of the field.

    Raises
    ------
    ValueError
        The region is a point, or its radiance is given.

    References
    ----------
    Definition; rules of the hemisphere integral as for the tiles.
    """
    part, air, illumination = region.part, scene.air, result.illumination
    if part is None or air is None or illumination is None or scene.view is None:
        raise ValueError(f"region {region.name}: a point, or light that is given, has no tiles")
    if region.surface is None or region.tilt is None:
        raise ValueError(f"region {region.name}: its radiance is given, there is nothing to compute")
    right = np.tan(part.left_rad) + PLACES[:, 0] * (np.tan(part.right_rad) - np.tan(part.left_rad))
    up = np.tan(part.bottom_rad) + PLACES[:, 1] * (np.tan(part.top_rad) - np.tan(part.bottom_rad))
    views = tuple(off_axis(scene.view, right=x, up=y) for x, y in zip(right.tolist(), up.tolist(), strict=True))
    lights = aperture_lights(
        illumination,
        surface=region.surface,
        tilt=region.tilt,
        views=views,
        rules=result.lights[region.name].lights[0].rules,
        skylight=Effect.SKYLIGHT in result.effects,
        path=Effect.PATH_RADIANCE in result.effects,
    )
    found = FieldLight(lights=lights, weights=(1.0 / len(lights),) * len(lights), spread=np.nan)
    around = acting(scene, result.effects).imperfections.surround_albedo
    if around is None:
        return found
    return with_surroundings(found, illumination, surround_albedo=around, ground_albedo=air.ground_albedo)
