"""The whole chain from sun and materials to detection, evaluated in one place for given numerical settings."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.settings import Settings
from model.effects.acting import acting
from model.effects.names import ALL, Effect
from model.prediction.prediction import RegionPrediction, predict
from model.prediction.region_performance import PairDetection, pair_detection
from model.scene.adjacency import with_surroundings
from model.scene.falloff import cosine_fourth
from model.scene.field_light import FieldLight
from model.scene.hemisphere import Rules
from model.scene.illumination import Illumination
from model.scene.lit_scene import LitRegion, LitScene
from model.scene.scenario import RegionLight, Scenario

Clock = Callable[[], float]

# Stages of which the time is taken.
SKY, LIGHT, STATISTICS, DETECTION = "sky", "light", "statistics", "detection"
STAGES = (SKY, LIGHT, STATISTICS, DETECTION)

_NO_RULES: Mapping[str, Rules] = {}


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainResult:
    """Result of one evaluation of the chain.

    Attributes
    ----------
    scenario
        Light of each region at the aperture, sensor and readout.
    illumination
        Sun, sky and air; None where every radiance is given.
    lights
        Region to its light, for those that are given by a material.
    predictions
        Region to prediction, in the order of the scene.
    detections
        One for each pair of the scene.
    stage_s
        Stage to the time that it took [s]; a store that had the answer makes it short.
    settings, effects
        That were in use.
    """

    scenario: Scenario
    illumination: Illumination | None
    lights: dict[str, FieldLight]
    predictions: dict[str, RegionPrediction]
    detections: tuple[PairDetection, ...]
    stage_s: dict[str, float]
    settings: Settings
    effects: frozenset[Effect]


def evaluate(
    scene: LitScene,
    settings: Settings,
    *,
    effects: frozenset[Effect] = ALL,
    rules: Mapping[str, Rules] = _NO_RULES,
    store: LightStore | None = None,
    clock: Clock = time.perf_counter,
) -> ChainResult:
    """Return what the model predicts of a scene, computed with given numerical settings and effects.

    Parameters
    ----------
    scene
        All that the scene is.
    settings
        Numerical settings: what costs time and buys accuracy.
    effects
        That act; the others are left out and not computed.
    rules
        Region to the rules of its hemisphere integral, where they are known from a neighbouring scene.
    store
        Keeps skies and lights between calls; None for a new one.
    clock
        Seconds, rising.

    Raises
    ------
    ValueError
        A number of the scene is outside its range.

    References
    ----------
    [MK14] eq. (1)-(30).
    """
    lights = LightStore() if store is None else store
    seen = acting(scene, effects)
    used = _acting_settings(settings, seen)
    taken = dict.fromkeys(STAGES, 0.0)
    with _timed(taken, SKY, clock):
        illumination = _illumination(seen, used, lights)
    with _timed(taken, LIGHT, clock):
        fields = _fields(seen, used, lights, rules)
    with _timed(taken, STATISTICS, clock):
        scenario = _scenario(seen, fields)
        predictions = predict(scenario, tolerance=used.dolp_tolerance)
    with _timed(taken, DETECTION, clock):
        detections = tuple(
            pair_detection(target, background, predictions, scene.p_false_alarm, tolerance=used.roc_tolerance)
            for target, background in scene.pairs
        )
    return ChainResult(
        scenario=scenario,
        illumination=illumination,
        lights=fields,
        predictions=predictions,
        detections=detections,
        stage_s=taken,
        settings=used,
        effects=effects,
    )


def scenario_of(
    scene: LitScene, settings: Settings, *, effects: frozenset[Effect] = ALL, store: LightStore | None = None
) -> Scenario:
    """Return the first half of `evaluate`: the light of each region at the aperture, sensor and readout.

    Parameters
    ----------
    scene, settings, effects, store
        As `evaluate` takes them.

    Raises
    ------
    ValueError
        A number of the scene is outside its range.

    References
    ----------
    [MK14] eq. (1)-(10).
    """
    lights = LightStore() if store is None else store
    seen = acting(scene, effects)
    used = _acting_settings(settings, seen)
    return _scenario(seen, _fields(seen, used, lights))


def region_light(seen: LitScene, region: LitRegion, field: FieldLight) -> RegionLight:
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


def _illumination(scene: LitScene, settings: Settings, lights: LightStore) -> Illumination | None:
    if scene.air is None or not _materials(scene):
        return None
    return lights.illumination(scene.air, settings, sun_azimuth_rad=scene.sun_azimuth_rad, parts=scene.parts)


def _fields(
    scene: LitScene, settings: Settings, lights: LightStore, rules: Mapping[str, Rules] = _NO_RULES
) -> dict[str, FieldLight]:
    """Light of the regions that are given by a material; they have air and view, or the record was refused."""
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


def _acting_settings(settings: Settings, scene: LitScene) -> Settings:
    return settings if scene.parts.wavelengths else replace(settings, wavelengths=1)


def _materials(scene: LitScene) -> tuple[LitRegion, ...]:
    return tuple(region for region in scene.regions if region.surface is not None)


def _scenario(scene: LitScene, fields: dict[str, FieldLight]) -> Scenario:
    regions = tuple(_region_light(region, fields, scene) for region in scene.regions)
    return Scenario(regions=regions, sensor=scene.sensor, readout=scene.readout, imperfections=scene.imperfections)


def _region_light(region: LitRegion, fields: dict[str, FieldLight], scene: LitScene) -> RegionLight:
    if region.radiance is None:
        return region_light(scene, region, fields[region.name])
    given = RegionLight(
        name=region.name,
        stokes_radiance=region.radiance,
        texture_rms=region.texture_rms,
        texture_cov=region.texture_cov,
    )
    return _with_falloff(given, region, scene)


def _with_falloff(light: RegionLight, region: LitRegion, scene: LitScene) -> RegionLight:
    if region.part is None or not scene.imperfections.off_axis_falloff:
        return light
    falloff = cosine_fourth(region.part)
    return replace(light, falloff_mean=falloff.mean, falloff_var=falloff.var)


@contextmanager
def _timed(taken: dict[str, float], stage: str, clock: Clock) -> Iterator[None]:
    start = clock()
    yield
    taken[stage] += clock() - start
