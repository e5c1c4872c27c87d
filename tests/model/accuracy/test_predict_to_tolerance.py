from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import STAGES, LightStore, differences, evaluate, readings
from model.accuracy.plan import NUMERICAL_SETTINGS, settings_at
from model.accuracy.predict import ESTIMATES, predict
from model.atmosphere.layers import AerosolKind
from model.effects.names import ALL, LIGHT, Effect
from model.scene.scene import LitRegion
from tests.model.accuracy.random_scenes import random_scene
from tests.model.effects.scenes import panel_scene

FINER = dict.fromkeys(NUMERICAL_SETTINGS, 2) | {"wavelengths": 3}


def ticking(step_s=1.0):
    """A clock that goes on by so much whenever it is read."""
    now = -step_s

    def clock():
        nonlocal now
        now += step_s
        return now

    return clock


def alone(scene, **options):
    """Prediction of a single scene."""
    (found,) = predict([scene], **options).cases
    return found


def given(**changes):
    """Two regions whose radiance is given, before the sensor of a random scene."""
    scene = random_scene(1)
    regions = tuple(
        LitRegion(name=name, radiance=np.array(radiance), texture_rms=0.02, texture_cov=np.zeros((3, 3)))
        for name, radiance in (("target", [40.0, 10.0, 2.0]), ("background", [30.0, 3.0, 0.0]))
    )
    return replace(scene, air=None, view=None, regions=regions, **changes)


@pytest.fixture(scope="module")
def lit():
    """A scene of points under a sky, predicted to 3 %, and the same with finer settings of every knob."""
    scene = random_scene(4)
    points = tuple(replace(region, part=None) for region in scene.regions)
    scene = replace(scene, regions=points)
    store = LightStore()
    found = alone(scene, tolerance=0.03, store=store)
    finer = evaluate(scene, settings_at(FINER, 1e-4), store=store)
    return scene, found, readings(finer.scenario, finer.predictions, finer.detections)


def test_what_is_promised_keeps_the_tolerance(lit):
    _, found, finer = lit
    own = readings(found.result.scenario, found.result.predictions, found.result.detections)
    errors = differences(own, finer)
    assert len(found.not_guaranteed) < len(errors)
    assert max(error for key, error in errors.items() if key not in found.not_guaranteed) <= found.tolerance


def test_the_largest_estimate_is_above_the_largest_true_error(lit):
    _, found, finer = lit
    own = readings(found.result.scenario, found.result.predictions, found.result.detections)
    errors = differences(own, finer)
    promised = [key for key in errors if key not in found.not_guaranteed]
    assert max(found.budget.total[key] for key in promised) > max(errors[key] for key in promised)


def test_several_under_one_sky_keep_the_tolerance_as_each_alone_does(lit):
    scene, single, finer = lit
    other = replace(scene, view=replace(scene.view, zenith_rad=scene.view.zenith_rad + 0.1))
    found = predict((scene, other), tolerance=0.03).cases
    assert all(one.is_judged for one in found)
    errors = differences(
        readings(found[0].result.scenario, found[0].result.predictions, found[0].result.detections), finer
    )
    assert max(error for key, error in errors.items() if key not in found[0].not_guaranteed) <= 0.03
    assert set(found[0].errors) == set(single.errors)


def test_errors_of_the_knobs_sum_to_the_total(lit):
    _, found, _ = lit
    for key, total in found.budget.total.items():
        assert total == pytest.approx(sum(errors.get(key, 0.0) for errors in found.budget.by_setting.values()))


def test_spheres_are_not_promised():
    scene = given()
    air = replace(random_scene(1).air, aerosol=AerosolKind.SPHERES)
    found = alone(replace(scene, air=air), tolerance=0.01)
    assert set(found.not_guaranteed) == set(found.budget.total)
    assert "spheres" in next(iter(found.not_guaranteed.values()))


def test_given_radiance_has_no_error_but_that_of_the_statistics():
    found = alone(given(), tolerance=1e-5)
    assert found.rounds == 1
    assert not found.not_guaranteed
    assert all(found.budget.worst(knob) == 0.0 for knob in NUMERICAL_SETTINGS)


def test_given_radiance_keeps_the_tolerance_in_every_reading():
    found = alone(given(), tolerance=1e-3)
    finest = alone(given(), tolerance=1e-6)
    own, finer = (
        readings(one.result.scenario, one.result.predictions, one.result.detections) for one in (found, finest)
    )
    assert max(differences(own, finer).values()) <= 1e-3


def test_stages_are_timed_by_the_clock_that_is_given():
    found = alone(given(), tolerance=0.01, clock=ticking())
    assert found.stage_s == dict.fromkeys((*STAGES, ESTIMATES), 1.0)


def test_a_line_of_sight_without_transmittance_has_the_errors_of_its_path():
    # At 89.999 deg from a height of 3 km nothing of the panels is let through.
    scene = random_scene(4)
    grazing = replace(scene.view, zenith_rad=np.radians(89.999), height_m=3000.0)
    points = tuple(replace(region, part=None) for region in scene.regions)
    found = alone(replace(scene, view=grazing, regions=points), tolerance=0.03)
    assert found.not_guaranteed == {}
    assert max(found.budget.total.values()) <= 0.03


@pytest.mark.parametrize("tolerance", [0.0, 1e-7, 0.2, float("nan")])
def test_a_tolerance_outside_its_range_is_refused(tolerance):
    with pytest.raises(ValueError, match=r"allowed is 1e-06 to 0\.1"):
        alone(given(), tolerance=tolerance)


def test_what_is_left_out_has_no_numerical_error():
    light = LIGHT - {Effect.ADJACENCY}
    scene = panel_scene(half_field_rad=0.05, surround_albedo=0.4, off_axis_falloff=True, drift=0.01)
    found = alone(scene, tolerance=1e-4, effects=ALL - light)
    assert found.rounds == 1
    assert not found.not_guaranteed
    for setting in ("streams", "layers", "wavelengths", "sky grid", "hemisphere", "tiles"):
        assert found.budget.worst(setting) == 0.0
