from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from model.accuracy.chain import Reading, evaluate, readings, signed_differences
from model.accuracy.errors import Alternatives, Texture, changes, grown, steps
from model.accuracy.plan import NUMERICAL_SETTINGS, settings_at
from model.prediction import pair_detection, predict
from tests.model.accuracy.random_scenes import random_scene

TOLERANCE = 1e-3
SMOOTH = Texture(rms=0.0, diagonal=(0.0, 0.0, 0.0), reflected=np.ones(3))


@cache
def evaluated():
    scene = random_scene(4)
    return scene, evaluate(scene, settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), TOLERANCE))


def changed(scene, result, name, lights):
    return changes([Alternatives(scene=scene, result=result, lights={name: lights})])[0][name]


def test_changes_are_those_of_a_prediction_with_the_other_light():
    scene, result = evaluated()
    region = result.scenario.regions[0]
    others = [replace(region, stokes_radiance=factor * region.stokes_radiance) for factor in (1.01, 0.98)]
    for other, found in zip(others, changed(scene, result, region.name, others), strict=True):
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
    lost, same = changed(scene, result, region.name, [impossible, region])
    assert set(lost.values()) == {np.inf}
    assert max(map(abs, same.values())) < 2.0 * result.settings.roc_tolerance


def test_a_region_without_light_has_no_steps():
    region = replace(evaluated()[1].scenario.regions[0], stokes_radiance=np.zeros(3))
    found = steps(region, SMOOTH, tolerance=TOLERANCE)
    assert found.lights == ()
    assert found.per_unit([]) == ({}, {}, {})


@pytest.mark.parametrize("dolp", [0.0, 1e-4, 0.3, 0.9999])
def test_steps_never_cross_light_without_polarization_nor_a_degree_of_one(dolp):
    region = replace(evaluated()[1].scenario.regions[0], stokes_radiance=np.array([5.0, -4.0 * dolp, 3.0 * dolp]))
    found = steps(region, SMOOTH, tolerance=TOLERANCE)
    for component in (1, 2):
        moved = found.lights[component].stokes_radiance
        assert np.hypot(*moved[1:]) < moved[0]
        assert moved[component] * region.stokes_radiance[component] >= 0.0
    assert found.lights[0].stokes_radiance[0] > region.stokes_radiance[0]


def test_what_unpolarized_light_gains_is_not_underestimated():
    # DoLP of 1e-4 beside a tolerance of 1e-2: a step across 0 would see no change.
    scene, result = evaluated()
    region = replace(result.scenario.regions[0], stokes_radiance=np.array([5.0, 5e-4, 0.0]), field_cov=None)
    base = replace(result, scenario=replace(result.scenario, regions=(region, *result.scenario.regions[1:])))
    base = replace(base, predictions=predict(base.scenario, tolerance=base.settings.dolp_tolerance))
    found = steps(region, SMOOTH, tolerance=1e-2)
    each = found.per_unit(changed(scene, base, region.name, found.lights))
    assert each[1][Reading(region.name, "dolp", "mean")] == pytest.approx(1.0 / 5.0, rel=1e-6)


def test_a_step_takes_its_texture_along():
    reflected, rms, diagonal = np.array([4.0, 0.3, -0.2]), 0.1, (0.02, 0.01, 0.03)

    def cov(light):
        return rms**2 * np.outer(light, light) + light[0] ** 2 * np.diag(np.square(diagonal))

    texture = Texture(rms=rms, diagonal=diagonal, reflected=reflected)
    for step in 0.05 * np.eye(3):
        np.testing.assert_allclose(texture.change(step), cov(reflected + step) - cov(reflected), atol=1e-15)


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
