"""Intervals at the edges of the law of a count; `python -m benchmarks.trials coverage` is the whole of it."""

import numpy as np
import pytest

from benchmarks.trials.coverage import CASES, covered, judged

SEEDS = range(5000, 5020)
EDGES = (
    "clipped at 0",
    "near saturation",
    "8 bits, noise 0.4",
    "unpolarized",
    "hit",
    "hit, two cycles",
    "hit, one cycle",
    "drift 1 %",
)


@pytest.mark.parametrize("name", EDGES)
def test_intervals_hold_the_light_that_was_drawn(name):
    found = [covered(CASES[name], seed) for seed in SEEDS]
    for number in found[0]:
        z, narrow, wide = np.array([one[number] for one in found], dtype=float).T
        # Of twenty, 68 % are 14 +- 2 and 95 % are 19 +- 1: four errors below.
        assert narrow.sum() >= 6, number
        assert wide.sum() >= 15, number
        # The length of a vector is not normal: its score at no polarization is not either.
        assert number == "dolp" or abs(z.mean()) < 4.0 / np.sqrt(len(SEEDS)), number


@pytest.mark.parametrize("name", ["clipped at 0", "8 bits, noise 0.4", "8 bits, unpolarized", "hit"])
def test_sound_runs_at_the_edges_do_not_disagree(name):
    for seed in SEEDS[:4]:
        for kind, found in judged(CASES[name], seed).items():
            assert found.verdict != "disagrees", (kind, seed)
            assert found.z or (name, kind) == ("clipped at 0", "itself")
