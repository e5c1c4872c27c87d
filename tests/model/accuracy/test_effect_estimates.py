"""Estimates of effects beside what leaving them out changes in a finer evaluation."""

from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import LightStore, evaluate
from model.accuracy.effect_estimates import change, coarse_settings, estimate_effects, readings_of
from model.accuracy.predict import predict
from model.effects.names import ALL, EVERYTHING, Effect
from model.effects.planner import plan, plan_of_all
from tests.model.effects.scenes import COARSE, panel_scene, radiance_scene

FINE = replace(
    COARSE,
    wavelengths=4,
    solver=replace(COARSE.solver, nodes=8),
    sky_zeniths=24,
    sky_azimuths=20,
    hemisphere_tolerance=1e-3,
    tiles_per_side=3,
)
SCENE = panel_scene(half_field_rad=0.05, surround_albedo=0.4, off_axis_falloff=True, drift=0.01)


@pytest.fixture(scope="module")
def found():
    store = LightStore()
    whole = readings_of(evaluate(SCENE, FINE, store=store))
    actual = {
        effect: change(whole, readings_of(evaluate(SCENE, FINE, effects=ALL - {effect}, store=store)))
        for effect in Effect
    }
    return estimate_effects(SCENE, dict.fromkeys(Effect, EVERYTHING)), actual


@pytest.mark.parametrize("effect", list(Effect), ids=lambda effect: effect.name.lower())
def test_what_an_effect_changes_lies_within_the_error_of_its_estimate(found, effect):
    estimates, actual = found
    assert estimates[effect].most.holds(actual[effect])


def test_an_effect_whose_other_changes_are_too_large_is_not_asked_for_its_detection():
    scene = replace(
        SCENE, regions=(SCENE.regions[0], replace(SCENE.regions[0], name="other")), pairs=(("panel", "other"),)
    )
    estimates = estimate_effects(scene, {Effect.SKYLIGHT: EVERYTHING}, limit=1e-6)
    assert np.isinf(estimates[Effect.SKYLIGHT].value.detection)
    assert np.isfinite(estimate_effects(scene, {Effect.SKYLIGHT: EVERYTHING})[Effect.SKYLIGHT].value.detection)


def test_what_bounds_leave_out_estimates_leave_out_too():
    scene = panel_scene(aerosol=1e-4, pressure_pa=50.0)
    found = plan(scene, tolerance=5e-3, rule="estimated", estimates=lambda bounds: estimate_effects(scene, bounds))
    assert Effect.SKYLIGHT not in found.active
    for one in found.decisions:
        assert one.acts == one.acts_by_estimate
        assert one.acts_by_bound or not one.acts_by_estimate
    assert found.spent.largest <= 5e-3


def test_every_effect_acts_where_all_do_but_what_a_user_leaves_out():
    assert plan_of_all({Effect.TEXTURE: False}).active == ALL - {Effect.TEXTURE}


def test_what_is_left_out_has_no_numerical_error():
    light = frozenset({Effect.SKYLIGHT, Effect.PATH_RADIANCE, Effect.WAVELENGTHS, Effect.FIELD_OF_VIEW})
    found = predict(SCENE, tolerance=1e-4, effects=ALL - light)
    assert found.rounds == 1
    assert not found.not_guaranteed
    for setting in ("streams", "layers", "wavelengths", "sky grid", "hemisphere", "tiles"):
        assert found.budget.worst(setting) == 0.0


def test_pattern_and_texture_common_to_a_pixel_leave_its_dolp_alone():
    scene = radiance_scene(texture_rms=0.02, noise={"prnu": 0.005, "dsnu_e": 0.0})
    store = LightStore()
    whole = readings_of(evaluate(scene, COARSE, store=store))
    bounds = {one.effect: one.bound for one in plan(scene, tolerance=0.0).decisions}
    for effect in (Effect.TEXTURE, Effect.NONUNIFORMITY):
        actual = change(whole, readings_of(evaluate(scene, COARSE, effects=ALL - {effect}, store=store)))
        assert bounds[effect].ratios < 5e-3
        assert bounds[effect].holds(actual)


def test_the_coarse_chain_ends_a_layer_at_the_camera():
    assert coarse_settings(SCENE, wavelengths=1).solver.face_m == SCENE.sensor_height_m
