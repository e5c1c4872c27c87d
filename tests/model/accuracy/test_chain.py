from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import LightStore, differences, evaluate, evaluate_all, scenario_of
from model.accuracy.plan import NUMERICAL_SETTINGS, settings_at
from model.atmosphere.solver import solve
from model.effects.effect import ALL, Effect
from model.scene.field import whole_field
from model.scene.panel import Rules
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


def test_many_scenes_together_are_as_each_alone():
    scene = scene_of_points()
    wide = replace(scene.regions[1], part=whole_field(width_rad=0.2, height_rad=0.1))
    scene = replace(scene, regions=(scene.regions[0], wide))
    views = [
        replace(scene.view, zenith_rad=zenith, azimuth_rad=azimuth) for zenith, azimuth in ((0.2, 1.0), (0.6, 2.0))
    ]
    suns = [scene.sun_azimuth_rad, scene.sun_azimuth_rad + 1.0]
    scenes = [replace(scene, view=view, sun_azimuth_rad=sun) for sun in suns for view in views]
    rules = {region.name: Rules(lobe=9, diffuse=6, error=1e-3) for region in scene.regions}
    together = evaluate_all(scenes, CHEAP, rules=rules, store=LightStore())
    store = LightStore()
    for one, found in zip(scenes, together, strict=True):
        alone = evaluate(one, CHEAP, rules=rules, store=store)
        off = differences(*(each.readings for each in (alone, found)))
        assert max(off.values()) < 1e-9
        assert [light.view for light in found.lights["background"].lights] == [
            light.view for light in alone.lights["background"].lights
        ]


def test_a_scene_that_has_no_roc_does_not_take_that_of_others():
    scene = scene_of_points()
    dark = replace(scene, sensor=replace(scene.sensor, noise=replace(scene.sensor.noise, read_noise_e=0.0)))
    mirror = replace(dark, regions=tuple(replace(one, texture_rms=0.0) for one in dark.regions))
    still = replace(mirror.sensor.noise, shot_noise=False, dark_current_e_per_s=0.0, quantisation=False, prnu=0.0)
    singular = replace(mirror, sensor=replace(mirror.sensor, noise=replace(still, dsnu_e=0.0)))
    found = evaluate_all([scene, singular], CHEAP, store=LightStore())
    assert np.isfinite(found[0].detections[0].auc)
    assert np.isnan(found[1].detections[0].auc)
