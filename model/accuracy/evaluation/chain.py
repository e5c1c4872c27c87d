"""The whole chain from sun and materials to detection, evaluated in one place for given numerical settings."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from model.accuracy.evaluation.lit_scenario import light_requests, lit_fields, lit_scenario, sun_and_sky, used_settings
from model.accuracy.evaluation.settings import Settings
from model.effects.acting import acting
from model.effects.names import ALL, Effect
from model.prediction.pair_detection import PairDetection, detections_of_pairs
from model.prediction.prediction import RegionPrediction, predict_all
from model.scene.field_light import FieldLight
from model.scene.hemisphere import Rules
from model.scene.illumination import Illumination
from model.scene.lit_scene import LitScene
from model.scene.scenario import Scenario

if TYPE_CHECKING:
    from model.accuracy.evaluation.light_store import LightStore

Clock = Callable[[], float]

# Stages of which the time is taken.
SKY, LIGHT, STATISTICS, DETECTION = "sky", "light", "statistics", "detection"
STAGES = (SKY, LIGHT, STATISTICS, DETECTION)

_NO_RULES: Mapping[str, Rules] = {}
# That a store keeps at the least, of the scenes that are evaluated together.
_MOST_SKIES, _MOST_LIGHTS = 12, 256


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
    air_key
        Equal for results under one sky; None where no light of the air was asked for.
    """

    scenario: Scenario
    illumination: Illumination | None
    lights: dict[str, FieldLight]
    predictions: dict[str, RegionPrediction]
    detections: tuple[PairDetection, ...]
    stage_s: dict[str, float]
    settings: Settings
    effects: frozenset[Effect]
    air_key: object = None


def evaluate(
    scene: LitScene,
    settings: Settings,
    *,
    effects: frozenset[Effect] = ALL,
    rules: Mapping[str, Rules] = _NO_RULES,
    store: "LightStore | None" = None,
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
    lights = _store() if store is None else store
    return evaluate_all((scene,), settings, effects=effects, rules=rules, store=lights, clock=clock)[0]


def evaluate_all(
    scenes: Sequence[LitScene],
    settings: Settings,
    *,
    effects: frozenset[Effect] = ALL,
    rules: Mapping[str, Rules] = _NO_RULES,
    store: "LightStore",
    clock: Clock = time.perf_counter,
) -> tuple[ChainResult, ...]:
    """Return what `evaluate` does for each of several scenes, each stage of all of them in few array passes.

    Parameters
    ----------
    scenes
        With the same regions and pairs; those under one sky one after another. Each has its share of the time.
    settings, effects, rules, store, clock
        As in `evaluate`; a region without rules has some that suffice in several scenes that differ in the view alone.

    Raises
    ------
    ValueError
        As `evaluate`.

    References
    ----------
    [MK14] eq. (1)-(30).
    """
    found: list[ChainResult] = []
    for some in _together(scenes):
        found += _evaluated(some, settings, effects, rules, store, clock)
    return tuple(found)


def _together(scenes: Sequence[LitScene]) -> Iterator[list[LitScene]]:
    """Yield scenes whose skies and lights a store keeps together."""
    some: list[LitScene] = []
    skies: set[object] = set()
    for scene in scenes:
        sky = None if scene.air is None else scene.air.key
        if some and (len(skies | {sky}) > _MOST_SKIES or len(some) * len(scene.regions) >= _MOST_LIGHTS):
            yield some
            some, skies = [], set()
        some.append(scene)
        skies.add(sky)
    if some:
        yield some


def _evaluated(
    scenes: Sequence[LitScene],
    settings: Settings,
    effects: frozenset[Effect],
    rules: Mapping[str, Rules],
    store: "LightStore",
    clock: Clock,
) -> list[ChainResult]:
    seen = [acting(scene, effects) for scene in scenes]
    used, rates = used_settings(settings, seen[0]), scenes[0].p_false_alarm
    taken = dict.fromkeys(STAGES, 0.0)
    with _timed(taken, SKY, clock):
        illuminations = [sun_and_sky(one, used, store) for one in seen]
    with _timed(taken, LIGHT, clock):
        store.keep_together(request for one in seen for request in light_requests(one, used, rules))
        fields = [lit_fields(one, used, store, rules) for one in seen]
    with _timed(taken, STATISTICS, clock):
        scenarios = [lit_scenario(one, field) for one, field in zip(seen, fields, strict=True)]
        predictions = predict_all(scenarios, tolerance=used.dolp_tolerance)
    with _timed(taken, DETECTION, clock):
        detections = detections_of_pairs(scenes[0].pairs, predictions, rates, tolerance=used.roc_tolerance)
    return [
        ChainResult(
            scenario=scenarios[k],
            illumination=illuminations[k],
            lights=fields[k],
            predictions=predictions[k],
            detections=detections[k],
            stage_s={stage: seconds / len(scenes) for stage, seconds in taken.items()},
            settings=used,
            effects=effects,
            air_key=None if (air := scenes[k].air) is None else air.key,
        )
        for k in range(len(scenes))
    ]


def scenario_of(
    scene: LitScene, settings: Settings, *, effects: frozenset[Effect] = ALL, store: "LightStore | None" = None
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
    seen = acting(scene, effects)
    used = used_settings(settings, seen)
    if seen.air is None:
        return lit_scenario(seen, {})
    return lit_scenario(seen, lit_fields(seen, used, _store() if store is None else store))


def _store() -> "LightStore":
    from model.accuracy.evaluation.light_store import LightStore  # solvers of the sky, wanted for materials only

    return LightStore()


@contextmanager
def _timed(taken: dict[str, float], stage: str, clock: Clock) -> Iterator[None]:
    start = clock()
    yield
    taken[stage] += clock() - start
