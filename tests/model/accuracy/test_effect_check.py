"""Bound of skylight under thin air."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.trials.effects import SETTINGS
from model.accuracy.chain import LightStore, evaluate
from model.accuracy.effect_check import change, skylight_bound
from model.effects.bounds import effect_bounds, light_limits
from model.effects.effect import ALL, Bound, Effect
from model.scene.scene import LitScene
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor
from tests.rigctl.example_files import EXAMPLES


def of_example(name: str) -> LitScene:
    return ScenePredictor(load_scene(EXAMPLES / "effects" / f"{name}.toml"), None).lit_scene()


def truth(scene: LitScene) -> Bound:
    store = LightStore()
    whole, dark = (
        evaluate(scene, SETTINGS, effects=effects, store=store).readings for effects in (ALL, ALL - {Effect.SKYLIGHT})
    )
    return replace(change(whole, dark), detection=0.0)


@pytest.mark.parametrize("sun_deg", [10.0, 20.0, 60.0])
def test_bound_is_above_what_the_sky_changes_and_far_below_the_general_one(sun_deg):
    lamp = of_example("lamp")
    scene = replace(lamp, air=replace(lamp.air, sun_zenith_rad=np.radians(sun_deg)))
    limits = light_limits(scene)
    found, actual = skylight_bound(scene, limits), truth(scene)
    assert found.holds(actual)
    assert found.largest < 6.0 * actual.largest
    assert found.largest < 0.2 * effect_bounds(scene, limits)[Effect.SKYLIGHT].largest


def test_no_bound_is_known_of_thick_air_or_over_a_field():
    for name in ("twilight", "roof-3m"):
        scene = of_example(name)
        assert skylight_bound(scene, light_limits(scene)) is None
