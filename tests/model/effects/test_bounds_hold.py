"""Bounds against what leaving an effect out truly changes, in a few of the random scenes of the long trial."""

import pytest

from benchmarks.trial_effects import Score, score_scene
from model.effects.names import Effect


@pytest.mark.parametrize("seed", range(20_000, 20_015))
def test_bounds_hold_in_a_random_scene(seed):
    score = Score()
    score_scene(score, seed)
    assert score.violations == []
    assert score.scenes + score.refused == 1


def test_random_scenes_try_many_effects():
    score = Score()
    for seed in range(20_000, 20_015):
        score_scene(score, seed)
    assert sum(score.checked[effect.value] > 0 for effect in Effect) >= 14
