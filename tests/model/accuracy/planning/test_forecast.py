from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import evaluate
from model.accuracy.plan import NUMERICAL_SETTINGS, STREAMS, TILES, WAVELENGTHS, forecast, seen, settings_at
from model.atmosphere.air import AtmosphereState
from tests.model.accuracy.random_scenes import random_scene

# A target before a background that fills 20 by 16 deg of the field.
WIDE = 14
CHEAP = dict.fromkeys(NUMERICAL_SETTINGS, 0) | {TILES: 2}


def test_the_errors_of_every_knob_fall_with_its_levels():
    found = forecast(random_scene(WIDE))
    for name in NUMERICAL_SETTINGS:
        assert len(found.errors[name]) == len(found.efforts[name]) == len(NUMERICAL_SETTINGS[name].levels)
        if name != WAVELENGTHS:
            assert np.all(np.diff(found.errors[name]) < 0.0)


def test_an_aerosol_with_a_stronger_forward_peak_asks_for_more_streams():
    scene = random_scene(WIDE)
    assert scene.air is not None
    clear, dusty = (
        forecast(
            replace(scene, air=replace(scene.air, state=AtmosphereState(visibility_m=10e3, boundary_aerosol=kind)))
        )
        for kind in ("tropospheric", "dust")
    )
    level = 3
    assert dusty.errors[STREAMS][level] > clear.errors[STREAMS][level]


def test_tiles_follow_the_law_of_the_field():
    scene = random_scene(WIDE)
    before = forecast(scene)
    result = evaluate(scene, settings_at(CHEAP, 0.1))
    after = seen(before, scene, result)
    ratios = np.array(after.errors[TILES][1:]) / np.array(after.errors[TILES][:-1])
    # From 2 to 6 tiles a side one more in each step, each step the same factor.
    assert ratios[:4] == pytest.approx(np.full(4, ratios[0]))
    assert 0.05 <= ratios[0] <= 0.7
    assert {name: after.errors[name] for name in NUMERICAL_SETTINGS if name != TILES} == {
        name: before.errors[name] for name in NUMERICAL_SETTINGS if name != TILES
    }


def test_points_say_nothing_of_tiles():
    scene = random_scene(4)
    before = forecast(scene)
    assert seen(before, scene, evaluate(scene, settings_at(CHEAP, 0.1))) == before
