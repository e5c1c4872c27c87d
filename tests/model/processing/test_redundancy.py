import numpy as np
import pytest

from model.processing.reconstruction import design, pair_sum_excess

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
