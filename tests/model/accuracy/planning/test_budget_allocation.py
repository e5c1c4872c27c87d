from itertools import product

import pytest

from model.accuracy.plan import NUMERICAL_SETTINGS, allocate, expected_s, forecast
from tests.model.accuracy.random_scenes import random_scene

EVEN = dict.fromkeys(NUMERICAL_SETTINGS, 1.0)
AHEAD = forecast(random_scene(0))


@pytest.mark.parametrize("allowed", [1e-1, 1e-2, 1e-3])
def test_the_plan_keeps_to_what_is_allowed(allowed):
    assert AHEAD.error(allocate(random_scene(0), AHEAD, EVEN, allowed), EVEN) <= allowed


def test_a_plan_is_within_a_third_of_the_cheapest_of_all():
    # All plans of three levels a knob; steepest descent is no search, a third is what it may lose here.
    scene, allowed = random_scene(0), 2e-3
    plans = [
        dict(zip(NUMERICAL_SETTINGS, levels, strict=True))
        for levels in product(range(4), repeat=len(NUMERICAL_SETTINGS))
    ]
    least = min(expected_s(scene, plan, AHEAD) for plan in plans if AHEAD.error(plan, EVEN) <= allowed)
    assert expected_s(scene, allocate(scene, AHEAD, EVEN, allowed), AHEAD) <= 1.34 * least


def test_a_knob_whose_errors_count_more_is_raised():
    scales = EVEN | {"streams": 100.0}
    assert (
        allocate(random_scene(0), AHEAD, scales, 1e-2)["streams"]
        > allocate(random_scene(0), AHEAD, EVEN, 1e-2)["streams"]
    )


def test_levels_never_fall_below_the_start():
    start = dict.fromkeys(NUMERICAL_SETTINGS, 2)
    assert all(level >= 2 for level in allocate(random_scene(0), AHEAD, EVEN, 1e-2, start=start).values())


def test_what_cannot_be_reached_ends_at_the_finest_of_all():
    finest = {name: len(knob.levels) - 1 for name, knob in NUMERICAL_SETTINGS.items()}
    assert allocate(random_scene(0), AHEAD, EVEN, 0.0) == finest
