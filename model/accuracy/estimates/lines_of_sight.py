"""Lines of sight at which two lightings are set beside each other: their difference as the camera would see it."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from model.atmosphere.lighting.lighting import Lighting
from model.scene.aperture_radiance import ApertureLight
from model.scene.diffuse_radiance import DiffuseRadiance
from model.scene.field_light import FieldLight
from model.scene.hemisphere import reflected_by_rules
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.panel_light import PanelLight
from model.scene.sky import Sky
from model.scene.view import View
from model.stokes import rotate_frame

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinesOfSight:
    """Lines of sight of a region given by its material.

    Attributes
    ----------
    lights
        What was found along them: of one tile, or of two corners of the field and its middle, the last.
    finer
        The same by finer rules of the hemisphere integral; of one tile itself.
    sun_azimuth_rad
        Clockwise from north [rad].
    """

    region: LitRegion
    lights: tuple[ApertureLight, ...]
    finer: tuple[ApertureLight, ...]
    sun_azimuth_rad: float

    def part(self, name: str) -> FloatArray:
        """Return a part of the light that was found, shape (V, 3)."""
        return np.stack([getattr(light, name) for light in self.lights])

    def missed_by_rules(self) -> FloatArray:
        """Return what finer rules of the hemisphere integral add to the reflected sky, shape (V, 3)."""
        return np.stack([finer.reflected_sky for finer in self.finer]) - self.part("reflected_sky")

    @property
    def views(self) -> tuple[View, ...]:
        """The camera along each of them."""
        return tuple(light.view for light in self.lights)


def reflected_by_all(several: Sequence[LinesOfSight], sky: Sky) -> list[FloatArray]:
    """Return what regions send of a sky to the camera, by the rules that were used, each (V, 3).

    Parameters
    ----------
    several
        Under this sky; of one panel, by the same rules, all in one pass.
    sky
        Light of each direction.
    """
    groups: dict[object, list[int]] = defaultdict(list)
    for place, lines in enumerate(several):
        region = lines.region
        groups[region.surface, region.tilt, lines.sun_azimuth_rad, lines.lights[0].rules].append(place)
    found: dict[int, FloatArray] = {}
    for places in groups.values():
        found |= dict(zip(places, _reflected([several[place] for place in places], sky), strict=True))
    return [found[place] for place in range(len(several))]


def _reflected(alike: Sequence[LinesOfSight], sky: Sky) -> list[FloatArray]:
    one = alike[0]
    if one.region.surface is None or one.region.tilt is None:
        raise ValueError(f"region {one.region.name}: its radiance is given, it reflects no sky")
    views, lights = (tuple(chain.from_iterable(getattr(each, name) for each in alike)) for name in ("views", "lights"))
    panel = PanelLight(surface=one.region.surface, tilt=one.region.tilt, views=views)
    radiance = DiffuseRadiance(sky=sky, sun_azimuth_rad=one.sun_azimuth_rad)
    stokes = reflected_by_rules(panel, radiance, one.lights[0].rules)
    through = np.array([light.transmittance for light in lights])
    seen = rotate_frame(through[:, np.newaxis] * stokes, np.array([view.roll_rad for view in views]))
    return np.split(seen, _ends(alike))


def _ends(several: Sequence[LinesOfSight]) -> NDArray[np.intp]:
    """Return where the lines of sight of each but the last end."""
    return np.cumsum([len(lines.lights) for lines in several])[:-1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """What the air does along lines of sight.

    Attributes
    ----------
    path
        Adds, shape (V, 3).
    transmittance
        Lets through, shape (V,).
    """

    path: FloatArray
    transmittance: FloatArray


def ways_to_camera(several: Sequence[LinesOfSight], lighting: Lighting) -> list[Way]:
    """Return what the air does along the lines of sight of several regions, all in one pass.

    Parameters
    ----------
    several
        From one height.
    lighting
        The air.
    """
    if not several:
        return []
    views = [view for lines in several for view in lines.views]
    height_m, zenith = views[0].height_m, np.array([view.zenith_rad for view in views])
    phi = np.array([lines.sun_azimuth_rad - view.azimuth_rad for lines in several for view in lines.views])
    path = lighting.path(height_m=height_m, zenith_rad=zenith, phi_rad=phi)
    path = rotate_frame(path, np.array([view.roll_rad for view in views]))
    through = lighting.transmittance(height_m=height_m, zenith_rad=zenith)
    parts = zip(np.split(path, _ends(several)), np.split(through, _ends(several)), strict=True)
    return [Way(path=added, transmittance=kept) for added, kept in parts]


def lines_of_sight(scene: LitScene, region: LitRegion, light: FieldLight) -> LinesOfSight:
    """Return where to look for a region.

    Parameters
    ----------
    scene
        For the sun's azimuth.
    region
        Given by its material.
    light
        What was found.
    """
    per_side, tiles = isqrt(len(light.lights)), dict(enumerate(light.lights))
    middle = (per_side // 2) * (per_side + 1)
    chosen = tuple(dict.fromkeys((0, len(tiles) - 1, middle)))
    return LinesOfSight(
        region=region,
        lights=tuple(tiles[k] for k in chosen),
        finer=tuple({**tiles, **light.finer}[k] for k in chosen),
        sun_azimuth_rad=scene.sun_azimuth_rad,
    )
