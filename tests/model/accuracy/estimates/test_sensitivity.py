from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from model.accuracy.estimates.sensitivity import changes, grown, steps
from model.accuracy.evaluation.chain import evaluate
from model.accuracy.evaluation.quantities import readings, signed_differences
from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS, settings_at
from model.prediction.prediction import predict
from model.prediction.region_performance import pair_detection
from tests.model.accuracy.random_scenes import random_scene

TOLERANCE = 1e-3


@cache
def evaluated():
    scene = random_scene(4)
    return scene, evaluate(scene, settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), TOLERANCE))


def test_changes_are_those_of_a_prediction_with_the_other_light():
    scene, result = evaluated()
    region = result.scenario.regions[0]
    others = [replace(region, stokes_radiance=factor * region.stokes_radiance) for factor in (1.01, 0.98)]
    for other, found in zip(others, changes(scene, result, {region.name: others})[region.name], strict=True):
        scenario = replace(result.scenario, regions=(other, *result.scenario.regions[1:]))
        predictions = predict(scenario, tolerance=result.settings.dolp_tolerance)
        detections = tuple(
            pair_detection(*pair, predictions, scene.p_false_alarm, tolerance=result.settings.roc_tolerance)
            for pair in scene.pairs
        )
        base = readings(result.scenario, result.predictions, result.detections)
        whole = signed_differences(base, readings(scenario, predictions, detections))
        concerned = {key for key in base if region.name in key.place}
        assert set(found) == concerned
        # Several detections are integrated together, on a common contour.
        for key, change in found.items():
            assert change == pytest.approx(whole[key], abs=2.0 * result.settings.roc_tolerance), key


def test_light_that_nothing_sends_changes_everything_and_others_nothing():
    scene, result = evaluated()
    region = result.scenario.regions[0]
    s0 = region.stokes_radiance[0]
    impossible = replace(region, stokes_radiance=np.array([s0, 1.2 * s0, 0.0]))
    lost, same = changes(scene, result, {region.name: [impossible, region]})[region.name]
    assert set(lost.values()) == {np.inf}
    assert max(map(abs, same.values())) < 2.0 * result.settings.roc_tolerance


def test_a_region_without_light_has_no_steps():
    region = replace(evaluated()[1].scenario.regions[0], stokes_radiance=np.zeros(3))
    found = steps(region, tolerance=TOLERANCE)
    assert found.lights == ()
    assert found.per_unit([]) == ({}, {}, {})


def test_steps_go_toward_less_polarization():
    region = evaluated()[1].scenario.regions[0]
    found = steps(region, tolerance=TOLERANCE)
    for component in (1, 2):
        moved = abs(found.lights[component].stokes_radiance[component])
        assert moved < abs(region.stokes_radiance[component])
    assert found.lights[0].stokes_radiance[0] > region.stokes_radiance[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_covariance_grows_along_its_axes_for_every_error_within_the_sizes(seed):
    rng = np.random.default_rng(seed)
    field = rng.normal(size=(400, 3)) @ rng.normal(size=(3, 3))
    sizes = np.array([1.0, 0.5, 0.7]) * 1e-2
    cov = np.cov(field.T, bias=True)
    wider = grown(cov, sizes)
    axes = np.linalg.eigh(cov / np.outer(sizes, sizes))[1].T / sizes
    assert np.all(np.linalg.eigvalsh(wider - cov) > 0.0)
    for _ in range(50):
        # An error that goes with the field, of a deviation of 1 in units of the sizes.
        error = field @ rng.normal(size=(3, 3))
        error *= sizes / np.sqrt(3.0) / np.std(error, axis=0)
        found = np.cov((field + error).T, bias=True)
        for axis in axes:
            assert axis @ found @ axis <= axis @ wider @ axis


def test_where_there_was_no_field_the_error_is_all_of_it():
    assert np.diag(grown(np.zeros((3, 3)), np.array([2.0, 1.0, 1.5]))) == pytest.approx([4.0, 1.0, 2.25])
