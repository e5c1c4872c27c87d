from dataclasses import replace

import pytest

from model.accuracy.chain import LightStore
from model.accuracy.plan import HEMISPHERE, NUMERICAL_SETTINGS
from model.accuracy.predict import plan_beside, predict
from tests.model.accuracy.random_scenes import random_scene

TOLERANCE = 0.03


@pytest.fixture(scope="module")
def neighbour():
    scene = random_scene(4)
    points = tuple(replace(region, part=None) for region in scene.regions)
    scene = replace(scene, regions=points)
    return scene, predict([scene], tolerance=TOLERANCE, store=LightStore()).cases[0]


def test_a_scene_like_one_that_is_known_takes_its_plan_or_a_coarser_one(neighbour):
    scene, known = neighbour
    plan = plan_beside(scene, known, tolerance=TOLERANCE, store=LightStore())
    assert all(plan[name] <= known.plan[name] for name in plan)


def test_a_number_that_no_rules_keep_makes_nothing_else_finer_than_it_was(neighbour):
    # As where a tilted glossy panel mirrors the horizon: the finest rules leave two thirds of the tolerance.
    scene, known = neighbour
    key, left = next(iter(known.budget.total)), 2.0 / 3.0 * TOLERANCE
    by_setting = {**known.budget.by_setting, HEMISPHERE: {key: left}}
    finest = {**known.plan, HEMISPHERE: len(NUMERICAL_SETTINGS[HEMISPHERE].levels) - 1}
    budget = replace(known.budget, by_setting=by_setting, total={**known.budget.total, key: left})
    stuck = replace(known, plan=finest, budget=budget)
    plan = plan_beside(scene, stuck, tolerance=0.5 * TOLERANCE, store=LightStore())
    assert all(plan[name] <= finest[name] for name in plan)
