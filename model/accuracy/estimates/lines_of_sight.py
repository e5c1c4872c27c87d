"""Lines of sight at which two lightings are set beside each other: their difference as the camera would see it."""

from collections.abc import Sequence
from dataclasses import dataclass
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

    def reflected(self, sky: Sky) -> FloatArray:
        """Return what the region sends of a sky to the camera, by the rules that were used, shape (V, 3)."""
        if self.region.surface is None or self.region.tilt is None:
            raise ValueError(f"region {self.region.name}: its radiance is given, it reflects no sky")
        panel = PanelLight(surface=self.region.surface, tilt=self.region.tilt, views=self.views)
        radiance = DiffuseRadiance(sky=sky, sun_azimuth_rad=self.sun_azimuth_rad)
        stokes = reflected_by_rules(panel, radiance, self.lights[0].rules)
        through = np.array([light.transmittance for light in self.lights])
        return rotate_frame(through[:, np.newaxis] * stokes, np.array([view.roll_rad for view in self.views]))

    @property
    def views(self) -> tuple[View, ...]:
        """The camera along each of them."""
        return tuple(light.view for light in self.lights)


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
        From one height, under one sun.
    lighting
        The air.
    """
    if not several:
        return []
    views = [view for lines in several for view in lines.views]
    height_m, zenith = views[0].height_m, np.array([view.zenith_rad for view in views])
    phi = several[0].sun_azimuth_rad - np.array([view.azimuth_rad for view in views])
    path = lighting.path(height_m=height_m, zenith_rad=zenith, phi_rad=phi)
    path = rotate_frame(path, np.array([view.roll_rad for view in views]))
    through = lighting.transmittance(height_m=height_m, zenith_rad=zenith)
    ends = np.cumsum([len(lines.lights) for lines in several])[:-1]
    parts = zip(np.split(path, ends), np.split(through, ends), strict=True)
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
