"""Light of regions over one more tile along each side: what the tiles of a field miss."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import islice
from math import isqrt
from typing import NamedTuple

from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.evaluation.lit_scenario import region_light
from model.effects.acting import acting
from model.scene.adjacency import with_surroundings
from model.scene.aperture_radiance import ApertureLight, aperture_lights
from model.scene.field_light import FieldLight
from model.scene.field_of_view import Tile, tiles
from model.scene.hemisphere import Rules
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.scenario import RegionLight


class Asked(NamedTuple):
    """A region of which the light is asked for.

    Attributes
    ----------
    scene, result
        What was evaluated, and what was found.
    name
        Of the region, which is given by its material.
    """

    scene: LitScene
    result: ChainResult
    name: str

    @property
    def region(self) -> LitRegion:
        """The region; ValueError where its radiance is given."""
        found = next(one for one in self.scene.regions if one.name == self.name)
        if found.surface is None or self.result.illumination is None:
            raise ValueError(f"region {self.name}: its radiance is given, there is nothing to compute")
        return found

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """Tiles, one more along each side than were used; none of a point."""
        part, view, used = self.region.part, self.scene.view, len(self.result.lights[self.name].lights)
        if part is None or view is None or used == 1:
            return ()
        return tiles(part, view, per_side=isqrt(used) + 1, rule=self.result.settings.tile_rule)

    @property
    def rules(self) -> Rules:
        """Of the hemisphere integral, by which its tiles were found."""
        return self.result.lights[self.name].lights[0].rules

    @property
    def panel(self) -> object:
        """Equal for lights that differ in the view alone."""
        scene, result = self.scene, self.result
        sky = (result.air_key, result.settings, result.effects, scene.sun_azimuth_rad, scene.sensor_height_m)
        return (sky, self.region.surface, self.region.tilt, self.rules)


def on_more_tiles(several: Sequence[Asked]) -> list[RegionLight | None]:
    """Return the light of each of several regions over one more tile along each side; None for a point.

    Parameters
    ----------
    several
        Those of one panel under one sky are computed in one pass.

    Raises
    ------
    ValueError
        The radiance of a region is given.

    References
    ----------
    Definition; rules of the hemisphere integral as for the tiles.
    """
    groups: dict[object, list[tuple[int, tuple[Tile, ...]]]] = defaultdict(list)
    for place, one in enumerate(several):
        if more := one.tiles:
            groups[one.panel].append((place, more))
    found: list[RegionLight | None] = [None for _ in several]
    for group in groups.values():
        lights = iter(_lights(several[group[0][0]], [tile for _, more in group for tile in more]))
        for place, more in group:
            found[place] = _over(several[place], more, tuple(islice(lights, len(more))))
    return found


def _lights(one: Asked, seen: Sequence[Tile]) -> tuple[ApertureLight, ...]:
    region, illumination = one.region, one.result.illumination
    if region.surface is None or region.tilt is None or illumination is None:
        raise ValueError(f"region {one.name}: its radiance is given, there is nothing to compute")
    parts = acting(one.scene, one.result.effects).parts
    return aperture_lights(
        illumination,
        surface=region.surface,
        tilt=region.tilt,
        views=tuple(tile.view for tile in seen),
        rules=one.rules,
        skylight=parts.skylight,
        path=parts.path_radiance,
    )


def _over(one: Asked, more: Sequence[Tile], lights: tuple[ApertureLight, ...]) -> RegionLight:
    """Return what a prediction takes of lights over a field."""
    seen, illumination, air = acting(one.scene, one.result.effects), one.result.illumination, one.scene.air
    spread = one.result.lights[one.name].spread
    field = FieldLight(lights=lights, weights=tuple(tile.weight for tile in more), spread=spread)
    around = seen.imperfections.surround_albedo
    if around is not None and air is not None and illumination is not None:
        field = with_surroundings(field, illumination, surround_albedo=around, ground_albedo=air.ground_albedo)
    return region_light(seen, one.region, field)
