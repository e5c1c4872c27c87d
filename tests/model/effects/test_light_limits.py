"""Limits of the light against the light itself, in random scenes with materials."""

import numpy as np
import pytest

from benchmarks.effect_scenes import SETTINGS, random_materials
from model.accuracy.chain import evaluate
from model.effects.planner import light_limits


def check_limits(seed):
    """Return the smallest ratio of limit to light of sky and path; limits of the beam are asserted."""
    scene = random_materials(np.random.default_rng([seed, 11]))
    limits, lights = light_limits(scene), evaluate(scene, SETTINGS).lights
    ratios = []
    for name, field in lights.items():
        for light in field.lights:
            beam = light.reflected_sun
            assert limits[name].s0_low <= beam[0] * (1.0 + 1e-9)
            assert limits[name].s0_high >= beam[0] * (1.0 - 1e-9)
            for part, limit in ((light.reflected_sky, limits[name].sky), (light.path, limits[name].path)):
                scattered = float(np.max(np.abs(part[:1]))), float(np.hypot(part[1], part[2]))
                if limit + max(scattered) > 0.0:
                    ratios.append(limit / max(scattered) if max(scattered) > 0.0 else np.inf)
    return min(ratios, default=np.inf)


@pytest.mark.parametrize("seed", range(8))
def test_sky_and_path_stay_below_their_limits(seed):
    assert check_limits(seed) >= 1.0
