import numpy as np
import pytest

from model.processing.reconstruction import design
from model.processing.redundancy import linear_response, pair_sum_excess

PLAN = design(np.deg2rad([0.0, 45.0, 90.0, 135.0]), np.inf)
RNG = np.random.default_rng(5)


def _lights(count=400, *, plan=PLAN):
    s0 = RNG.uniform(100.0, 1000.0, count)
    dolp, psi = RNG.uniform(0.0, 0.6, count), RNG.uniform(0.0, np.pi, count)
    return plan.system @ np.array([s0, s0 * dolp * np.cos(2 * psi), s0 * dolp * np.sin(2 * psi)])


def test_pair_sums_that_differ_by_16_percent_are_that_far_apart():
    channels = _lights(1)[:, 0]
    channels[[1, 3]] *= (1 - 0.08) / (1 + 0.08)
    upper, lower = channels[0] + channels[2], channels[1] + channels[3]
    expected = (upper - lower) / (0.5 * (upper + lower))
    assert pair_sum_excess(PLAN, channels, np.eye(4))[0] == pytest.approx(expected, rel=1e-12)
    assert expected == pytest.approx(0.16, rel=0.01)


def test_the_error_of_the_excess_is_that_of_the_pair_difference_over_its_mean():
    # Four channels of error 1 and mean 100: I0 + I90 - I45 - I135 has the error 2, the mean of the pairs is 200.
    assert pair_sum_excess(PLAN, [100.0] * 4, np.eye(4))[1] == pytest.approx(0.01)


def test_sound_channels_have_no_excess():
    assert pair_sum_excess(PLAN, _lights(1)[:, 0], np.eye(4))[0] < 1e-13


def test_three_angles_have_no_excess_to_speak_of():
    plan = design(np.deg2rad([0.0, 60.0, 120.0]), np.inf)
    assert pair_sum_excess(plan, [1.0, 2.0, 3.0], np.eye(3)) == (0.0, 0.0)


def test_no_light_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        pair_sum_excess(PLAN, [0.0, 0.0, 0.0, 0.0], np.eye(4))


@pytest.mark.parametrize("angles_deg", [(0, 45, 90, 135), (0, 30, 60, 90, 120, 150)])
def test_a_compressing_response_is_found_with_its_size(angles_deg):
    plan = design(np.deg2rad(angles_deg), np.inf)
    channels = _lights(plan=plan)
    mean = channels.mean()
    found = linear_response(plan, channels * (1.0 - 0.05 * channels / mean))
    # The fit to the compressed counts sees the light smaller by up to some 10 %.
    assert found.curvature == pytest.approx(-0.05, rel=0.35)
    assert found.curvature < -5 * found.std_error


def test_a_linear_response_with_noise_and_unequal_transmittance_is_not_flagged():
    channels = _lights() * np.array([[1.0], [0.98], [1.0], [0.98]])
    found = linear_response(PLAN, channels + RNG.normal(size=channels.shape))
    assert abs(found.curvature) < 4 * found.std_error


def test_unpolarised_light_cannot_tell():
    channels = PLAN.system @ np.array([RNG.uniform(100, 900, 200), np.zeros(200), np.zeros(200)])
    assert linear_response(PLAN, channels) is None


def test_without_redundancy_nothing_can_be_told():
    plan = design(np.deg2rad([0.0, 60.0, 120.0]), np.inf)
    assert linear_response(plan, _lights(plan=plan)) is None
