"""Limits of the light against the light itself, in random scenes with materials."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.trials.effects import SETTINGS, random_materials
from model.accuracy.chain import evaluate
from model.effects.bounds import LIGHT_PARTS, Light, effect_bounds, light_limits
from model.effects.effect import LIGHT, Effect
from model.sensor import Imperfections
from tests.model.effects.scenes import THIN, panel_scene

# The limits take four wavelengths; what the polynomial through as many misses of a band is the same on both sides.
LIGHT_SETTINGS = replace(SETTINGS, wavelengths=4, sky_zeniths=16, sky_azimuths=14)
# Shares of the beam: another order of sums, and one rule or another over the band.
ROUNDING, BAND = 1e-12, 1e-5


def check_limits(seed):
    """Return the smallest ratio of limit to light of sky and path; limits of the beam are asserted."""
    # Of the light alone: what the surroundings take from it is not part of these limits.
    scene = random_materials(np.random.default_rng([seed, 11]))
    regions = tuple(replace(one, part=None) for one in scene.regions)
    scene = replace(scene, regions=regions, imperfections=Imperfections())
    limits, lights = light_limits(scene), evaluate(scene, LIGHT_SETTINGS).lights
    ratios = []
    for name, field in lights.items():
        for light in field.lights:
            beam = light.reflected_sun
            assert limits[name].beam[0] == pytest.approx(beam[0], rel=BAND)
            for part, limit in (
                (light.reflected_sky, limits[name].parts[Effect.SKYLIGHT].s0),
                (light.path, limits[name].parts[Effect.PATH_RADIANCE].s0),
            ):
                scattered = max(abs(float(part[0])), float(np.hypot(part[1], part[2])))
                if scattered > ROUNDING * float(beam[0]):
                    ratios.append(limit / scattered)
    return min(ratios, default=np.inf)


@pytest.mark.parametrize("seed", range(8))
def test_sky_and_path_stay_below_their_limits(seed):
    assert check_limits(seed) >= 1.0


def test_light_of_a_new_effect_is_in_the_bounds_of_all_others(monkeypatch):
    scene = panel_scene(**THIN, half_width_m=2e-9, surround_albedo=0.9)
    before = effect_bounds(scene, light_limits(scene))
    beam = light_limits(scene)["panel"].beam[0]
    # A glow in front of the lens, such as a new effect would add.
    monkeypatch.setitem(LIGHT_PARTS, "glow", lambda *_: Light(1e-2 * beam, 1e-3 * beam))
    after = effect_bounds(scene, light_limits(scene))
    assert set(after) == LIGHT - {Effect.FIELD_OF_VIEW}
    assert all(after[effect].largest > before[effect].largest > 0.0 for effect in after)
