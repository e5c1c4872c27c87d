"""Estimated errors: of the light setting by setting, and of what a user reads."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from model.accuracy.chain import LightStore, Reading, differences, evaluate, evaluate_all
from model.accuracy.errors import LightError, LitCase, error_budgets, light_errors
from model.accuracy.plan import (
    HEMISPHERE,
    LAYERS,
    NUMERICAL_SETTINGS,
    SKY_GRID,
    STREAMS,
    TILES,
    WAVELENGTHS,
    settings_at,
)
from model.atmosphere.sky import Fidelity
from model.prediction import predict
from tests.model.accuracy.random_scenes import random_scene

TOLERANCE = 1e-4  # so small that nothing is passed over


BASE = {STREAMS: 1, LAYERS: 1, WAVELENGTHS: 1, SKY_GRID: 0, HEMISPHERE: 2, TILES: 1}


FINER = {STREAMS: 4, LAYERS: 3, WAVELENGTHS: 4, SKY_GRID: 3, HEMISPHERE: 5, TILES: 4}


# Two points under a hazy sky; a target before a background that fills 20 by 16 deg of the field.
SEEDS = (4, 14)


@cache
def evaluated(seed):
    store, scene = LightStore(), random_scene(seed)
    return scene, store, evaluate(scene, settings_at(BASE, TOLERANCE), store=store)


def errors_of(scene, plan, result, store, tolerance=TOLERANCE):
    """Setting to region to the error of its light, of one scene."""
    (found,) = light_errors(((scene, result),), plan, store, tolerance=tolerance)
    return found


def budget_of(scene, result, errors, tolerance=TOLERANCE, **options):
    (found,) = error_budgets((LitCase(scene=scene, result=result, lights=errors),), tolerance=tolerance, **options)
    return found


@cache
def budget(seed):
    scene, store, result = evaluated(seed)
    errors = errors_of(scene, BASE, result, store)
    return budget_of(scene, result, errors)


# Streams and layers share one reference, in which their errors have their signs.
KNOBS = [(STREAMS, LAYERS), *((knob,) for knob in (WAVELENGTHS, SKY_GRID, HEMISPHERE, TILES))]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("knobs", KNOBS)
def test_the_largest_error_of_knobs_is_found(knobs, seed):
    scene, store, result = evaluated(seed)
    finer = evaluate(scene, settings_at(BASE | {knob: FINER[knob] for knob in knobs}, TOLERANCE), store=store)
    true = max(differences(result.readings, finer.readings).values())
    errors = [budget(seed).by_setting[knob] for knob in knobs]
    estimated = max((sum(of.get(key, 0.0) for of in errors) for key in result.readings), default=0.0)
    # The finer solution has a hundredth of the error; elements of depth come and go, 2e-6.
    assert true <= 1.01 * estimated + 2e-6
    assert true > 1e-6 or knobs == (TILES,)


@pytest.mark.parametrize("fidelity", [Fidelity.SINGLE, Fidelity.ANALYTIC])
def test_light_scattered_once_has_layers_too(fidelity):
    scene, store = random_scene(SEEDS[0]), LightStore()
    scene = replace(scene, air=replace(scene.air, fidelity=fidelity), view=replace(scene.view, height_m=2500.0))
    plan = {**BASE, LAYERS: 0}
    result, finer = (
        evaluate(scene, settings_at({**plan, LAYERS: level}, TOLERANCE, face_m=2500.0), store=store) for level in (0, 3)
    )
    errors = errors_of(scene, plan, result, store)
    estimated = budget_of(scene, result, errors).by_setting
    true = max(differences(result.readings, finer.readings).values())
    assert 1e-6 < true <= 1.01 * max(estimated[LAYERS].values()) + 2e-6
    assert not estimated[STREAMS]


def test_a_scene_of_given_radiance_has_no_error_of_the_light():
    scene, store, result = evaluated(SEEDS[0])
    found = errors_of(scene, BASE, replace(result, illumination=None), store)
    assert found == {knob: {} for knob in NUMERICAL_SETTINGS}


@pytest.mark.parametrize(("source", "without"), [("reflected_sun", SKY_GRID), ("path", HEMISPHERE)])
def test_a_part_of_the_light_has_the_errors_of_that_part_alone(source, without):
    scene, store, result = evaluated(SEEDS[0])
    found = errors_of(replace(scene, source=source), BASE, result, store)
    for error in found[without].values():
        assert not np.any(error.together)
        assert not np.any(error.apart)
    assert any(np.any(error.together) for error in found[WAVELENGTHS].values())


def test_errors_that_come_together_keep_their_signs():
    # Streams and layers change S0 up or down, and S1 with it or against it: one row.
    scene, store, result = evaluated(SEEDS[0])
    found = errors_of(scene, BASE, result, store)
    assert all(error.together.shape == (1, 3) for error in found[STREAMS].values())


def test_errors_of_several_scenes_under_one_sky_are_those_of_each():
    # A looser tolerance, of which some errors are harmless.
    scene, store, tolerance = random_scene(14), LightStore(), 1e-2
    views = [replace(scene.view, zenith_rad=scene.view.zenith_rad + turn) for turn in (0.0, 0.1, 0.2)]
    scenes = [replace(scene, view=view) for view in views]
    results = evaluate_all(scenes, settings_at(BASE, tolerance), store=store)
    cases = list(zip(scenes, results, strict=True))
    lights = light_errors(cases, BASE, store, tolerance=tolerance)
    lit = [LitCase(scene=one, result=found, lights=of) for (one, found), of in zip(cases, lights, strict=True)]
    for case, budget in zip(lit, error_budgets(lit, tolerance=tolerance), strict=True):
        alone = errors_of(case.scene, BASE, case.result, store, tolerance)
        for setting, regions in alone.items():
            for name, error in regions.items():
                np.testing.assert_allclose(case.lights[setting][name].together, error.together, atol=1e-12)
                np.testing.assert_allclose(case.lights[setting][name].apart, error.apart, atol=1e-12)
        expected = budget_of(case.scene, case.result, alone, tolerance)
        # Several detections are integrated together, on a common contour.
        assert budget.total == pytest.approx(expected.total, abs=0.02 * tolerance)


# Two points.
POINTS = 4


def test_what_exists_by_a_hair_is_not_promised_where_the_light_may_be_less():
    scene = random_scene(POINTS)
    result = evaluate(scene, settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-3))
    region = result.scenario.regions[0]

    def of(factor):
        sensor = replace(result.scenario.sensor, exposure_s=factor * result.scenario.sensor.exposure_s)
        scenario = replace(result.scenario, sensor=sensor)
        return replace(
            result, scenario=scenario, predictions=predict(scenario, tolerance=result.settings.dolp_tolerance)
        )

    def exists(factor):
        return "dolp_pixels" in of(factor).predictions[region.name].quantities

    long, short = 1.0, 1e-6
    assert exists(long)
    assert not exists(short)
    while long > 1.001 * short:
        middle = np.sqrt(long * short)
        long, short = (middle, short) if exists(middle) else (long, middle)

    mean = Reading(region.name, "dolp_pixels", "mean")
    for share, is_promised in ((1e-2, False), (1e-5, True)):
        off = share * region.stokes_radiance[0]
        error = LightError(together=np.zeros((0, 3)), apart=np.array([off, 0.0, 0.0]), field=np.zeros(3))
        budget = budget_of(scene, of(1.0005 * long), {STREAMS: {region.name: error}}, 1e-2, tiles=False)
        assert np.isfinite(budget.total[mean]) == is_promised
