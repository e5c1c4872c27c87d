from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import evaluate
from model.effects.effect import ALL, LIGHT, Bound, Effect
from model.effects.planner import EFFECTS, plan, plan_of_all
from model.scene.field import FieldPart
from tests.model.effects.scenes import COARSE, THIN, panel_scene, radiance_scene

DIM = panel_scene(**THIN, surround_albedo=0.9)


def test_sum_of_what_is_left_out_stays_within_the_tolerance():
    for tolerance in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2):
        found = plan(DIM, tolerance=tolerance)
        # Of light that is not computed one wavelength misses nothing: the band counts with less than its own bound.
        alone = [one for one in found.decisions if one.effect is not Effect.WAVELENGTHS]
        left_out = [one.bound for one in alone if not one.acts]
        assert sum((one.deviations for one in left_out), 0.0) <= tolerance
        assert found.spent.largest <= tolerance


def test_more_tolerance_leaves_more_out():
    counts = [len(plan(DIM, tolerance=tolerance).active) for tolerance in (0.0, 1e-4, 1e-2, 0.3)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]


def test_without_tolerance_only_what_is_not_stated_is_left_out():
    found = plan(radiance_scene(texture_rms=0.01), tolerance=0.0)
    assert all(one.bound.largest == 0.0 for one in found.decisions if not one.acts)
    assert Effect.TEXTURE in found.active
    assert Effect.DRIFT not in found.active


@pytest.mark.parametrize("effect", sorted(ALL - LIGHT))
def test_effect_of_sensor_or_session_acts_where_it_is_stated(effect):
    scene = radiance_scene(
        texture_rms=1e-6,
        drift=1e-9,
        polarizer_angle_std_rad=1e-9,
        misregistration_pixels=1e-6,
        off_axis_falloff=True,
        noise={"read_noise_e": 1e-6, "dark_current_e_per_s": 1e-6, "prnu": 1e-9},
        sensor={"tau_perpendicular": 1e-9},
    )
    part = FieldPart(left_rad=-0.01, right_rad=0.01, bottom_rad=-0.01, top_rad=0.01)
    scene = replace(scene, regions=(replace(scene.regions[0], part=part),))
    assert effect in plan(scene, tolerance=0.3).active
    removed = EFFECTS[effect].removed(scene)
    (found,) = [one for one in plan(removed, tolerance=0.0).decisions if one.effect is effect]
    assert not found.acts
    assert found.bound == Bound()
    assert found.answer == ("left out" if EFFECTS[effect].usual is None else "not stated")


def test_every_effect_is_decided_once_and_says_why():
    found = plan(panel_scene(), tolerance=0.01)
    assert sorted(one.effect for one in found.decisions) == sorted(Effect)
    assert all(one.reason for one in found.decisions)


def test_decisions_are_listed_by_their_bound():
    found = plan(radiance_scene(), tolerance=0.01)
    bounds = [one.bound.largest for one in found.decisions]
    assert bounds == sorted(bounds)


def test_effect_that_is_left_out_by_request_is_said_with_its_bound():
    found = plan(radiance_scene(), tolerance=0.01, forced={Effect.READ_NOISE: False})
    assert Effect.READ_NOISE not in found.active
    assert any("read noise is left out by request" in remark for remark in found.remarks)


def test_request_to_leave_out_what_is_not_there_needs_no_remark():
    assert plan(radiance_scene(), tolerance=0.01, forced={Effect.DRIFT: False}).remarks == ()


def test_effect_that_is_switched_on_acts_though_it_is_small():
    assert Effect.PATH_RADIANCE not in plan(DIM, tolerance=0.01).active
    assert Effect.PATH_RADIANCE in plan(DIM, tolerance=0.01, forced={Effect.PATH_RADIANCE: True}).active


def test_what_is_left_out_by_request_takes_nothing_of_the_tolerance():
    forced = plan(panel_scene(), tolerance=0.01, forced={Effect.SKYLIGHT: False})
    assert Effect.SKYLIGHT not in forced.active
    assert forced.spent.largest <= 0.01


@pytest.mark.parametrize("air", [{}, THIN])
def test_effects_of_the_light_act_in_thick_air_or_over_a_field_by_no_bound(air):
    found = plan(panel_scene(**air, surround_albedo=0.4, half_field_rad=0.01), tolerance=0.01)
    assert {one.effect for one in found.decisions if one.reason == "no useful bound"} == LIGHT
    assert found.active >= LIGHT


def test_what_no_scene_states_is_told_apart_from_what_is_left_out():
    found = {one.effect: one for one in plan(panel_scene(), tolerance=0.01).decisions}
    for effect in (Effect.DRIFT, Effect.POLARIZER_ANGLE, Effect.ADJACENCY, Effect.FIELD_OF_VIEW, Effect.TEXTURE):
        assert found[effect].answer == "not stated"
    assert found[Effect.NONUNIFORMITY].answer == "left out"
    assert found[Effect.MISREGISTRATION].reason == "no texture to shift"
    assert plan(radiance_scene(), tolerance=0.01).unstated_above(0.01) == ()


def test_every_effect_acts_by_the_rule_all_but_what_a_user_leaves_out():
    assert plan(DIM, tolerance=0.01, rule="all", forced={Effect.TEXTURE: False}).active == ALL - {Effect.TEXTURE}
    assert plan_of_all({Effect.TEXTURE: False}).active == ALL - {Effect.TEXTURE}


@pytest.mark.parametrize("tolerance", [-0.1, np.nan])
def test_tolerance_below_zero_is_refused(tolerance):
    with pytest.raises(ValueError, match="tolerance"):
        plan(radiance_scene(), tolerance=tolerance)


def test_every_effect_has_its_record():
    assert set(EFFECTS) == set(Effect)
    assert all(one.changes and one.place and one.cost for one in EFFECTS.values())


def test_bounds_add_and_compare():
    one, other = Bound(radiance=0.1, ratios=0.2), Bound(radiance=0.3, detection=0.4)
    assert one + other == Bound(radiance=0.4, ratios=0.2, detection=0.4)
    assert one.worse(other) == Bound(radiance=0.3, ratios=0.2, detection=0.4)
    assert other.holds(Bound(radiance=0.3))
    assert not other.holds(Bound(ratios=1e-6))


def test_scene_from_which_all_noise_is_left_out_is_still_predicted():
    quiet = ALL - {Effect.SHOT_NOISE, Effect.READ_NOISE, Effect.DARK_CURRENT, Effect.QUANTISATION}
    (found,) = evaluate(radiance_scene(), COARSE, effects=quiet).predictions.values()
    assert found.quantities["dolp"]["mean"] > 0.0
    assert "dolp_snr" not in found.quantities
