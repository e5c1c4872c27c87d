"""For each effect of the light but the field of view a scene that calls for it and one that does not."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from model.accuracy.chain import LightStore, evaluate
from model.accuracy.effect_check import change
from model.effects.effect import ALL, LIGHT, Effect
from model.effects.planner import plan
from model.scene.scene import LitScene
from tests.model.effects.scenes import COARSE, THIN, panel_scene, radiance_scene

TOLERANCE = 5e-3
THINNER = {"pressure_pa": 0.5, "aerosol": 1e-8}
# 1e5 electrons of light at 6 DN each: more than a 16-bit converter holds.
BRIGHT = {"radiance": (600.0, 60.0, 0.0), "noise": {"gain_dn_per_e": 6.0}, "sensor": {"bit_depth": 16}}


@dataclass(frozen=True)
class Case:
    effect: Effect
    on: LitScene
    off: LitScene


CASES = [
    Case(Effect.SKYLIGHT, panel_scene(), panel_scene(**THINNER)),
    Case(Effect.PATH_RADIANCE, panel_scene(), panel_scene(**THIN)),
    Case(Effect.WAVELENGTHS, panel_scene(half_width_m=1.5e-7), panel_scene(**THIN, half_width_m=2e-10)),
    Case(Effect.ADJACENCY, panel_scene(surround_albedo=0.9), panel_scene(**THIN, surround_albedo=0.9)),
]


def decision(case, scene):
    return next(one for one in plan(scene, tolerance=TOLERANCE).decisions if one.effect is case.effect)


# Under next to no air a sky rises at the horizon so steeply that the coarsest grid makes twenty times too much of it.
SEEN = replace(COARSE, sky_zeniths=24, sky_azimuths=20)


def actual_change(case, scene):
    store = LightStore()
    whole, without = (
        evaluate(scene, SEEN, effects=effects, store=store).readings for effects in (ALL, ALL - {case.effect})
    )
    return change(whole, without)


def test_every_effect_of_the_light_has_its_two_scenes():
    assert {case.effect for case in CASES} == LIGHT - {Effect.FIELD_OF_VIEW}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect.name.lower())
def test_effect_that_matters_acts(case):
    assert decision(case, case.on).acts


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect.name.lower())
def test_effect_that_does_not_matter_is_left_out_though_it_is_there(case):
    found = decision(case, case.off)
    assert not found.acts
    assert 0.0 < found.bound.largest <= TOLERANCE


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect.name.lower())
def test_what_is_left_out_changes_no_more_than_its_bound(case):
    assert decision(case, case.off).bound.holds(actual_change(case, case.off))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect.name.lower())
def test_effect_that_matters_truly_changes_more_than_its_share(case):
    assert actual_change(case, case.on).largest > TOLERANCE


def test_saturation_that_acts_gives_a_warning():
    scene = radiance_scene(**BRIGHT)
    warned, silent = (
        evaluate(scene, COARSE, effects=effects).predictions["panel"].warnings
        for effects in (ALL, ALL - {Effect.SATURATION})
    )
    assert any("saturation" in text for text in warned)
    assert not any("saturation" in text for text in silent)


def test_air_that_scatters_nothing_is_not_solved():
    scene = panel_scene(**THINNER)
    solved = []

    def solver(*arguments, **keywords):
        solved.append(arguments)
        raise AssertionError("nothing is to be solved")

    effects = plan(scene, tolerance=TOLERANCE).active
    assert effects.isdisjoint({Effect.SKYLIGHT, Effect.PATH_RADIANCE})
    evaluate(scene, COARSE, effects=effects, store=LightStore(solver=solver))
    assert not solved


def test_direction_of_the_beam_alone_is_what_the_bounds_rest_on():
    # Without any air but the beam's, the limits of the light are the light: 45 deg, mirror direction.
    scene = panel_scene(**THINNER)
    limits = plan(scene, tolerance=TOLERANCE)
    light = evaluate(scene, COARSE, effects=limits.active).lights["panel"]
    assert light.mean()[0] > 0.0
    np.testing.assert_array_equal(light.mean(), light.mean("reflected_sun"))
