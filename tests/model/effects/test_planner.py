import numpy as np
import pytest

from model.accuracy.chain import evaluate
from model.effects.bounds import EFFECT_MODELS
from model.effects.names import ALL, Bound, Effect
from model.effects.planner import plan
from tests.model.effects.scenes import COARSE, panel_scene, radiance_scene


def test_sum_of_what_is_left_out_stays_within_the_tolerance():
    scene = radiance_scene(texture_rms=1e-4, drift=1e-4, polarizer_angle_std_rad=1e-4, noise={"read_noise_e": 0.5})
    for tolerance in (1e-5, 1e-4, 1e-3, 1e-2, 0.1):
        found = plan(scene, tolerance=tolerance)
        left_out = [one.bound for one in found.decisions if not one.acts]
        assert sum((one.deviations for one in left_out), 0.0) <= tolerance
        assert found.spent.largest <= tolerance


def test_more_tolerance_leaves_more_out():
    scene = radiance_scene(texture_rms=1e-4, drift=1e-4, noise={"read_noise_e": 0.5})
    counts = [len(plan(scene, tolerance=tolerance).active) for tolerance in (0.0, 1e-4, 1e-2, 0.3)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]


def test_without_tolerance_only_what_is_not_there_is_left_out():
    found = plan(radiance_scene(texture_rms=0.01), tolerance=0.0)
    assert all(one.bound.largest == 0.0 for one in found.decisions if not one.acts)
    assert Effect.TEXTURE in found.active
    assert Effect.DRIFT not in found.active


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
    assert any("read noise is left out by request" in remark and "deviations" in remark for remark in found.remarks)


def test_request_to_leave_out_what_is_not_there_needs_no_remark():
    assert plan(radiance_scene(), tolerance=0.01, forced={Effect.DRIFT: False}).remarks == ()


def test_effect_that_is_switched_on_acts_though_it_is_small():
    scene = radiance_scene()
    assert Effect.DARK_CURRENT not in plan(scene, tolerance=0.01).active
    assert Effect.DARK_CURRENT in plan(scene, tolerance=0.01, forced={Effect.DARK_CURRENT: True}).active


def test_what_is_left_out_by_request_takes_nothing_of_the_tolerance():
    without = plan(radiance_scene(noise={"read_noise_e": 0.0}), tolerance=0.01)
    forced = plan(radiance_scene(), tolerance=0.01, forced={Effect.READ_NOISE: False})
    assert forced.spent == without.spent


def test_noise_that_is_left_out_by_request_hides_nothing_of_other_noise():
    # Of so bright a light, beside a rounding to whole counts, shot noise is nothing; alone it is all there is.
    noise = {"gain_dn_per_e": 1e-7, "read_noise_e": 0.0, "dark_current_e_per_s": 0.0}
    scene = radiance_scene(noise=noise, sensor={"exposure_s": 1e5 * radiance_scene().sensor.exposure_s})
    assert Effect.SHOT_NOISE not in plan(scene, tolerance=0.01).active
    assert Effect.SHOT_NOISE in plan(scene, tolerance=0.01, forced={Effect.QUANTISATION: False}).active


def test_effects_that_nobody_asks_about_act_in_the_order_of_their_names():
    found = plan(radiance_scene(), tolerance=0.01, asked=frozenset({Effect.TEXTURE}))
    unasked = [one.effect for one in found.decisions if "costs less" in one.reason]
    assert Effect.TEXTURE not in unasked
    assert unasked == [effect for effect in Effect if effect in unasked]
    assert len(unasked) > 5


def test_light_is_asked_for_with_what_acts_of_it():
    asked = []

    def known(effects):
        asked.append(effects)
        raise ValueError("enough")

    with pytest.raises(ValueError, match="enough"):
        plan(panel_scene(), tolerance=0.01, known=known)
    assert asked == [ALL - {Effect.FIELD_OF_VIEW, Effect.ADJACENCY}]


@pytest.mark.parametrize("tolerance", [-0.1, np.nan])
def test_tolerance_below_zero_is_refused(tolerance):
    with pytest.raises(ValueError, match="tolerance"):
        plan(radiance_scene(), tolerance=tolerance)


def test_every_effect_has_its_record():
    assert set(EFFECT_MODELS) == set(Effect)
    assert all(one.changes and one.place and one.cost for one in EFFECT_MODELS.values())


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
