"""Companions of an evaluation: what it tells for nothing of how hard its scene is, beside a neighbouring one."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from model.accuracy.estimates.light_error import LightError
from model.accuracy.evaluation.chain import ChainResult
from model.accuracy.planning.forecast import last_degree
from model.geometry import angle_between_rad, direction
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.view import View

FloatArray = NDArray[np.float64]

# Companions by their name: "sky grid", and the regions with a field.
Companions = Mapping[str, float]
_SKY_GRID = "sky grid"
# Setting to region to the error of its light.
LightErrors = Mapping[str, Mapping[str, LightError]]
_DARK = 1e-300
# Farther than this from the sun's mirror direction neither glint nor aureole is in a lobe of such slopes, in rms slopes
# beside it.
_NEAR_RAD, _SLOPES = float(np.radians(15.0)), 4.0


def companions(scene: LitScene, result: ChainResult) -> dict[str, float]:
    """Return numbers that grow with the error of a setting: of the sky's grid, and of the tiles of each field.

    Parameters
    ----------
    scene, result
        What was evaluated, and what was found.

    Notes
    -----
    They are no errors. Where one is larger than in a neighbouring scene of which errors are known, the scene is harder
    than that.
    """
    found = {}
    if result.illumination is not None:
        found[_SKY_GRID] = result.illumination.diffuse_radiance.relative_error
    for name, light in result.lights.items():
        if len(light.lights) > 1:
            found[name] = last_degree(np.stack([getattr(one, scene.source) for one in light.lights]))
    return found


def is_harder(own: Companions, others: Sequence[Companions], *, margin: float, negligible: float) -> bool:
    """Return whether a scene is harder than all neighbours of which the errors are known.

    Parameters
    ----------
    own, others
        Companions of the scene and of its neighbours.
    margin
        By which it may be above them.
    negligible
        Below which a companion says nothing.
    """
    return any(
        number > max(negligible, margin * max(one.get(name, 0.0) for one in others)) for name, number in own.items()
    )


def carried_errors(
    neighbours: Sequence[tuple[ChainResult, LightErrors]], result: ChainResult, *, margin: float
) -> dict[str, dict[str, LightError]]:
    """Return the errors of the light of a scene by those of its neighbours, in proportion to S0.

    Parameters
    ----------
    neighbours
        What was found, with setting to region to the error of its light, one or more.
    result
        What was found of the scene; of the same regions.
    margin
        By which the largest of them is multiplied.
    """
    settings = neighbours[0][1]
    found: dict[str, dict[str, LightError]] = {setting: {} for setting in settings}
    for name, light in result.lights.items():
        s0 = abs(float(light.mean()[0]))
        others = [(s0 / max(abs(float(one.lights[name].mean()[0])), _DARK), errors) for one, errors in neighbours]
        for setting in settings:
            there = [
                errors[setting][name].scaled(margin * factor) for factor, errors in others if name in errors[setting]
            ]
            if there:
                found[setting][name] = max(there, key=lambda one: one.largest)
    return found


def from_glint_rad(scene: LitScene) -> float:
    """Return how far the sun is from being mirrored to the camera by a region, the least of all; pi where it is far.

    Parameters
    ----------
    scene
        Its regions, sun and camera.

    Notes
    -----
    At the mirror direction the lobe has the beam over the field and the aureole before it: what was found on either
    side does not tell of it.
    """
    if scene.air is None or scene.view is None:
        return float(np.pi)
    sun = direction(zenith_rad=scene.air.sun_zenith_rad, azimuth_rad=scene.sun_azimuth_rad)
    found = [_from_glint_rad(region, scene.view, sun) for region in scene.regions if region.surface is not None]
    return min(found, default=float(np.pi))


def _from_glint_rad(region: LitRegion, view: View, sun: FloatArray) -> float:
    if region.surface is None or region.tilt is None:
        return float(np.pi)
    camera = direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)
    mirrored = 2.0 * float(region.tilt.normal @ camera) * region.tilt.normal - camera
    part = region.part
    edge = 0.0
    if part is not None:
        edge = max(abs(one) for one in (part.left_rad, part.right_rad, part.bottom_rad, part.top_rad))
    apart = max(float(angle_between_rad(mirrored, sun)) - edge, 0.0)
    return apart if apart < _NEAR_RAD + _SLOPES * region.surface.slope_rms else float(np.pi)
