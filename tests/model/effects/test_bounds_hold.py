"""Bounds against what leaving an effect out truly changes, in a few of the random scenes of the long trial."""

import pytest

from benchmarks.trials.effects import Score, score_scene
from model.effects.bounds import Disturbance
from model.effects.names import LIGHT

SEEDS = range(20_000, 20_030)


@pytest.fixture(scope="module")
def score():
    found = Score()
    for seed in SEEDS:
        score_scene(found, seed)
        score_scene(found, seed, kind="thin")
    return found


@pytest.mark.slow
def test_bounds_hold_in_random_scenes(score):
    assert score.violations == []
    assert score.scenes + score.refused == 2 * len(SEEDS)


def test_random_scenes_try_most_effects_of_the_light(score):
    assert sum(score.checked[effect.value] > 0 for effect in LIGHT) >= 4


def test_bound_that_is_too_small_is_found(monkeypatch):
    monkeypatch.setattr("model.effects.bounds._moved", lambda *_, **__: Disturbance(s0=1e-12))
    found = Score()
    for seed in SEEDS:
        if not found.violations:
            score_scene(found, seed)
    assert found.violations


def test_an_snr_of_nothing_but_rounding_is_no_violation():
    # Level panels, sun and camera straight above: S1 and S2 are rounding, and change with the order of sums.
    found = Score()
    for seed in (38, 422):
        score_scene(found, seed, kind="hostile")
    assert found.scenes == 2
    assert found.violations == []
