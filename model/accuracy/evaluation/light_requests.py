"""Lights of regions that are asked for: what tells one from another, and many of them computed in one pass."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from model.scene.aperture_radiance import ApertureLight, aperture_lights
from model.scene.field_light import FieldLight, light_over_field, lights_by_rules, lights_over_tiles
from model.scene.field_of_view import FieldPart, middle, off_axis
from model.scene.lit_scene import ALL_LIGHT, Air, LightParts, LitRegion

if TYPE_CHECKING:
    from model.accuracy.evaluation.settings import Settings
    from model.scene.hemisphere import Rules
    from model.scene.illumination import Illumination
    from model.scene.view import View

# Views of one pass times the square of their order: some 4e5 nodes, of which a block at a time is looked at. Rules that
# are not known yet are taken to have this order in the end.
_TOGETHER = 4e4
_LIKELY_ORDER = 34


@dataclass(frozen=True, kw_only=True, eq=False)
class LightRequest:
    """Light of a region given by its material that is asked for.

    Attributes
    ----------
    region, settings, air, view, sun_azimuth_rad, parts, rules
        As `LightStore.region` takes them.
    """

    region: LitRegion
    settings: "Settings"
    air: Air
    view: "View"
    sun_azimuth_rad: float
    parts: LightParts = ALL_LIGHT
    rules: "Rules | None" = None

    @cached_property
    def seen(self) -> tuple["View", FieldPart | None]:
        """View and part of the field; of a field that is left out its middle."""
        part = self.region.part
        if part is None or self.parts.field_of_view:
            return self.view, part
        across, upward = middle(part)
        return off_axis(self.view, right=across, up=upward), None

    def key(self, parts: LightParts) -> object:
        """Return what tells this light from others, were some parts of it computed."""
        return self._shared(parts), self.seen

    @property
    def alike(self) -> object:
        """Equal for lights that differ in the view alone, from one height."""
        return self._shared(self.parts), self.view.height_m

    def _shared(self, parts: LightParts) -> object:
        settings, region = self.settings, self.region
        return (
            sky_key(self.air, settings, parts),
            (self.sun_azimuth_rad, region.surface, region.tilt, parts.skylight, parts.path_radiance),
            (settings.hemisphere_tolerance, settings.tiles_per_side, settings.tile_rule, settings.negligible_spread),
            self.rules,
        )


def lights_of(illumination: "Illumination", requests: Sequence[LightRequest]) -> tuple[FieldLight, ...]:
    """Return lights that differ in the view alone, in few passes; without known rules by some that suffice for all.

    Parameters
    ----------
    illumination
        Sun, sky and air.
    requests
        One or more.

    Raises
    ------
    ValueError
        The region's radiance is given, or a number is outside its range.
    """
    one = requests[0]
    surface, tilt, settings = one.region.surface, one.region.tilt, one.settings
    if surface is None or tilt is None:
        raise ValueError("its radiance is given, there is nothing to compute")

    def lights_at(views: tuple["View", ...], rules: "Rules | None") -> tuple[ApertureLight, ...]:
        return aperture_lights(
            illumination,
            surface=surface,
            tilt=tilt,
            views=views,
            tolerance=settings.hemisphere_tolerance,
            rules=rules,
            skylight=one.parts.skylight,
            path=one.parts.path_radiance,
        )

    per_side, rule, fields = settings.tiles_per_side, settings.tile_rule, [each.seen for each in requests]
    if one.rules is not None:
        return lights_by_rules(lights_at, one.rules, fields=fields, per_side=per_side, rule=rule)
    if settings.negligible_spread == 0.0:
        return lights_over_tiles(lights_at, fields=fields, per_side=per_side, rule=rule)
    return tuple(
        light_over_field(
            lights_at, view=view, part=part, per_side=per_side, rule=rule, negligible=settings.negligible_spread
        )
        for view, part in fields
    )


def passes(group: Mapping[object, LightRequest]) -> Iterator[tuple[object, ...]]:
    """Yield keys of requests that are computed together: their nodes need little memory."""
    some: list[object] = []
    nodes = 0
    for key, one in group.items():
        tiles = 1 if one.seen[1] is None else one.settings.tiles_per_side**2
        order = _LIKELY_ORDER if one.rules is None else max(one.rules.lobe, one.rules.diffuse)
        if some and nodes + tiles * order**2 > _TOGETHER:
            yield tuple(some)
            some, nodes = [], 0
        some.append(key)
        nodes += tiles * order**2
    yield tuple(some)


def sky_key(air: Air, settings: "Settings", parts: LightParts) -> object:
    """Return what tells a sky from others.

    Parameters
    ----------
    air, settings, parts
        As `model.accuracy.evaluation.light_store.LightStore.illumination` takes them.
    """
    numbers = (
        settings.wavelengths,
        settings.split_at_kinks,
        settings.solver,
        settings.sky_zeniths,
        settings.sky_azimuths,
    )
    return (air.key, numbers, parts.skylight, scatters(parts))


def scatters(parts: LightParts) -> bool:
    """Return whether light scattered by the air counts at all."""
    return parts.skylight or parts.path_radiance
