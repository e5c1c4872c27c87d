from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.evaluation.chain import evaluate, scenario_of
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS, settings_at
from model.atmosphere.solver import solve
from model.effects.names import ALL, Effect
from tests.model.accuracy.random_scenes import random_scene

CHEAP = settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 0.1)


def scene_of_points(seed=4):
    scene = random_scene(seed)
    return replace(scene, regions=tuple(replace(region, part=None) for region in scene.regions))


class Counted:
    def __init__(self):
        self.calls = 0

    def __call__(self, *arguments, **settings):
        self.calls += 1
        return solve(*arguments, **settings)


def test_the_first_half_is_that_of_the_whole():
    scene, store = scene_of_points(), LightStore()
    whole, half = evaluate(scene, CHEAP, store=store), scenario_of(scene, CHEAP, store=store)
    for one, other in zip(whole.scenario.regions, half.regions, strict=True):
        np.testing.assert_array_equal(one.stokes_radiance, other.stokes_radiance)


def test_a_wavelength_is_solved_once_for_all_regions_and_calls():
    counted = Counted()
    store = LightStore(solver=counted)
    for _ in range(2):
        evaluate(scene_of_points(), CHEAP, store=store)
    assert counted.calls == CHEAP.wavelengths


def test_without_scattered_light_nothing_is_solved():
    counted = Counted()
    effects = ALL - {Effect.SKYLIGHT, Effect.PATH_RADIANCE}
    found = evaluate(scene_of_points(), CHEAP, effects=effects, store=LightStore(solver=counted))
    assert counted.calls == 0
    for light in found.lights.values():
        assert not np.any(light.mean("reflected_sky"))
        assert not np.any(light.mean("path"))


def test_each_part_of_the_light_can_be_left_out_alone():
    scene, store = scene_of_points(), LightStore()
    whole = evaluate(scene, CHEAP, store=store)
    dark = evaluate(scene, CHEAP, effects=ALL - {Effect.SKYLIGHT}, store=store)
    for name, light in whole.lights.items():
        rest = light.mean() - light.mean("reflected_sky")
        np.testing.assert_allclose(dark.lights[name].mean(), rest, rtol=1e-12, atol=1e-15)


def test_a_pair_that_no_region_forms_is_refused():
    with pytest.raises(ValueError, match="pairs name stranger; the regions are target, background"):
        replace(scene_of_points(), pairs=(("target", "stranger"),))
