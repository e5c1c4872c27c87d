"""Table of all effects: what each changes, what computing it costs, how it is bounded and how it is removed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from model.effects import light_bounds, noise_bounds, session_bounds
from model.effects.bound import Bound, Disturbance
from model.effects.bound_of_change import bound_of, detection_bound
from model.effects.light_limits import LightLimits
from model.effects.names import ALL, Effect
from model.effects.radiance_bounds import RegionBounds, radiance_bounds
from model.scene.lit_scene import LightParts, LitRegion, LitScene
from model.sensor.imperfections import Imperfections
from model.sensor.sensor import Sensor, SensorNoise
from model.special_functions import chdtri

_RECORD = "model.effects.acting"
_STORE = "model.accuracy.evaluation.light_store"
_CHAIN = "model.accuracy.evaluation.chain"
_LITTLE = "microseconds"


@dataclass(frozen=True, kw_only=True)
class EffectModel:
    """An effect: a new one is an entry here, its bound, and the place that computes it.

    Attributes
    ----------
    changes
        What it changes, in words.
    place
        The module in which it acts.
    cost
        Effort of computing it, in words.
    of_light
        True for light before the lens, which costs time: decided before the others.
    bound
        Largest change of a region's mean and covariance where it is left out, of the scene, the region's limits in
        counts [DN] and the limits of its light [W m-2 sr-1]; `NOTHING` where the effect is not there, `UNKNOWN` where
        no bound is known.
    removed
        The scene without it; what is gone from the record is computed by nobody.
    """

    changes: str
    place: str = _RECORD
    cost: str = _LITTLE
    of_light: bool = False
    bound: Callable[[LitScene, RegionBounds, LightLimits], Disturbance]
    removed: Callable[[LitScene], LitScene]


def _with_parts(scene: LitScene, parts: LightParts) -> LitScene:
    return replace(scene, parts=parts)


def _with_noise(scene: LitScene, noise: SensorNoise) -> LitScene:
    return _with_sensor(scene, replace(scene.sensor, noise=noise))


def _with_sensor(scene: LitScene, sensor: Sensor) -> LitScene:
    return replace(scene, sensor=sensor)


def _with_session(scene: LitScene, imperfections: Imperfections) -> LitScene:
    return replace(scene, imperfections=imperfections)


def _without_leakage(scene: LitScene) -> LitScene:
    ideal = replace(scene.readout, extinction_ratio=np.inf)
    return replace(scene, sensor=replace(scene.sensor, tau_perpendicular=0.0), readout=ideal)


def _smooth(region: LitRegion) -> LitRegion:
    return replace(region, texture_rms=0.0, texture_diagonal=(0.0, 0.0, 0.0), texture_cov=np.zeros((3, 3)))


EFFECT_MODELS: Mapping[Effect, EffectModel] = MappingProxyType(
    {
        Effect.FIELD_OF_VIEW: EffectModel(
            changes="mean light and its spread over a region",
            place=_STORE,
            cost="a light for each tile",
            of_light=True,
            bound=light_bounds.field_of_view,
            removed=lambda scene: _with_parts(scene, replace(scene.parts, field_of_view=False)),
        ),
        Effect.TEXTURE: EffectModel(
            changes="covariance over pixels",
            bound=noise_bounds.texture,
            removed=lambda scene: replace(scene, regions=tuple(_smooth(region) for region in scene.regions)),
        ),
        Effect.SKYLIGHT: EffectModel(
            changes="mean light",
            place=_STORE,
            cost="sky, and an integral over it a view",
            of_light=True,
            bound=light_bounds.skylight,
            removed=lambda scene: _with_parts(scene, replace(scene.parts, skylight=False)),
        ),
        Effect.PATH_RADIANCE: EffectModel(
            changes="mean light",
            place=_STORE,
            cost="one ray a view",
            of_light=True,
            bound=light_bounds.path_radiance,
            removed=lambda scene: _with_parts(scene, replace(scene.parts, path_radiance=False)),
        ),
        Effect.LEAKAGE: EffectModel(
            changes="counts, noise of S1 and S2", bound=session_bounds.leakage, removed=_without_leakage
        ),
        Effect.DARK_CURRENT: EffectModel(
            changes="temporal noise",
            bound=noise_bounds.dark_current,
            removed=lambda scene: _with_noise(scene, replace(scene.sensor.noise, dark_current_e_per_s=0.0)),
        ),
        Effect.SHOT_NOISE: EffectModel(
            changes="temporal noise",
            bound=noise_bounds.shot_noise,
            removed=lambda scene: _with_noise(scene, replace(scene.sensor.noise, shot_noise=False)),
        ),
        Effect.READ_NOISE: EffectModel(
            changes="temporal noise",
            bound=noise_bounds.read_noise,
            removed=lambda scene: _with_noise(scene, replace(scene.sensor.noise, read_noise_e=0.0)),
        ),
        Effect.QUANTISATION: EffectModel(
            changes="temporal noise",
            bound=noise_bounds.quantisation,
            removed=lambda scene: _with_noise(scene, replace(scene.sensor.noise, quantisation=False)),
        ),
        Effect.WAVELENGTHS: EffectModel(
            changes="light of sky and path",
            place=_CHAIN,
            cost="a solution for each",
            of_light=True,
            bound=light_bounds.wavelengths,
            removed=lambda scene: _with_parts(scene, replace(scene.parts, wavelengths=False)),
        ),
        Effect.POLARIZER_ANGLE: EffectModel(
            changes="degree of polarization, temporal noise",
            bound=session_bounds.polarizer_angle,
            removed=lambda scene: _with_session(scene, replace(scene.imperfections, polarizer_angle_std_rad=0.0)),
        ),
        Effect.MISREGISTRATION: EffectModel(
            changes="correlation of texture between frames",
            bound=session_bounds.misregistration,
            removed=lambda scene: _with_session(scene, replace(scene.imperfections, misregistration_pixels=0.0)),
        ),
        Effect.DRIFT: EffectModel(
            changes="mean Stokes parameters",
            bound=session_bounds.drift,
            removed=lambda scene: _with_session(scene, replace(scene.imperfections, drift=0.0)),
        ),
        Effect.NONUNIFORMITY: EffectModel(
            changes="covariance over pixels",
            bound=noise_bounds.nonuniformity,
            removed=lambda scene: _with_noise(scene, replace(scene.sensor.noise, prnu=0.0, dsnu_e=0.0)),
        ),
        Effect.SATURATION: EffectModel(
            changes="warnings; the share of pixels for which the model is void",
            bound=noise_bounds.saturation,
            removed=lambda scene: _with_sensor(scene, replace(scene.sensor, saturates=False)),
        ),
        Effect.FALLOFF: EffectModel(
            changes="counts and their spread over a region",
            place=_CHAIN,
            bound=light_bounds.falloff,
            removed=lambda scene: _with_session(scene, replace(scene.imperfections, off_axis_falloff=False)),
        ),
        Effect.ADJACENCY: EffectModel(
            changes="mean light",
            place=_CHAIN,
            of_light=True,
            bound=light_bounds.adjacency,
            removed=lambda scene: _with_session(scene, replace(scene.imperfections, surround_albedo=None)),
        ),
    }
)


def effect_bounds(
    scene: LitScene, limits: Mapping[str, LightLimits], effects: frozenset[Effect] = ALL
) -> dict[Effect, Bound]:
    """Return for each effect how much leaving it out can change.

    Parameters
    ----------
    scene
        All that the scene is.
    limits
        Region to the limits of its light, as `model.effects.sun_light.light_limits` gives them.
    effects
        Which.
    """
    regions = {one.name: radiance_bounds(scene, one, limits[one.name]) for one in scene.regions}
    found: dict[Effect, Bound] = {}
    for effect in (one for one in Effect if one in effects):
        bound = EFFECT_MODELS[effect].bound
        changes = {name: bound(scene, region, limits[name]) for name, region in regions.items()}
        found[effect] = _worst(scene, regions, changes)
    return found


def _worst(scene: LitScene, regions: Mapping[str, RegionBounds], found: Mapping[str, Disturbance]) -> Bound:
    """Worst bound of all regions, and of detection between them."""
    worst = Bound()
    for name, region in regions.items():
        worst = worst.worse(bound_of(region, found[name]))
    # The area under the curve is a mean over thresholds: that of its mean distance is covered too.
    eta = max(3.0, float(chdtri(3, min(scene.p_false_alarm)))) if scene.p_false_alarm else 3.0
    for target, background in scene.pairs:
        detection = detection_bound(regions[target], found[target], regions[background], found[background], eta=eta)
        worst = worst.worse(Bound(detection=detection))
    return worst
