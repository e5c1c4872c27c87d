from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import evaluate
from model.effects.names import ALL, Effect
from model.scene.field import BACKSCATTER, forward_scattered
from tests.model.effects.scenes import COARSE, panel_scene


@pytest.mark.parametrize("transmittance", [0.0, 1e-6, 0.3, 0.9, 1.0])
def test_forward_scattered_light_is_no_more_than_what_is_taken_out(transmittance):
    found = forward_scattered(transmittance)
    assert 0.0 <= found <= 1.0 - transmittance


def test_thin_air_scatters_in_proportion_to_its_depth():
    depth = 1e-7
    assert forward_scattered(np.exp(-depth)) == pytest.approx((1.0 - BACKSCATTER) * depth, rel=1e-6)


def test_forward_scattered_light_is_below_the_depth_it_is_bounded_by():
    for transmittance in np.linspace(0.01, 0.999, 50):
        assert forward_scattered(transmittance) <= -(1.0 - BACKSCATTER) * np.log(transmittance)


def test_bright_surroundings_add_unpolarised_light_and_dark_ones_take_some_away():
    def light(albedo):
        return evaluate(panel_scene(surround_albedo=albedo), COARSE).lights["panel"].mean()

    like, bright, dark = light(0.1), light(0.9), light(0.0)
    np.testing.assert_array_equal(like, light(None))
    assert bright[0] > like[0] > dark[0]
    np.testing.assert_array_equal(bright[1:], like[1:])


def test_camera_on_the_ground_sees_no_surroundings():
    one, other = (
        evaluate(panel_scene(surround_albedo=albedo, height_m=0.0), COARSE).lights["panel"].mean()
        for albedo in (None, 0.9)
    )
    np.testing.assert_array_equal(one, other)


def test_surroundings_that_are_left_out_are_not_there():
    scene = panel_scene(surround_albedo=0.9)
    without = evaluate(scene, COARSE, effects=ALL - {Effect.ADJACENCY}).lights["panel"].mean()
    plain = replace(scene, imperfections=replace(scene.imperfections, surround_albedo=None))
    np.testing.assert_array_equal(without, evaluate(plain, COARSE).lights["panel"].mean())
