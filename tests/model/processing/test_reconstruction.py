"""Designs of angles, inversion, ratios and redundancy."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from model.moments import Moments
from model.processing.dolp import first_order
from model.processing.reconstruction import (
    MODIFIED_PICKERING_RAD,
    aolp_is_defined,
    channel_ratios,
    design,
    equispaced_rad,
    pair_sum_excess,
    reconstruct,
    stokes_moments,
)

PICKERING_RAD = (0.0, np.pi / 4, np.pi / 2)
FESSENKOV_RAD = (0.0, np.pi / 3, 2 * np.pi / 3)


@settings(deadline=None, max_examples=60)
@given(angles=st.lists(st.floats(0.0, 6.0), min_size=3, max_size=8), extinction=st.floats(5.0, 1e6))
def test_inverse_undoes_the_system(angles, extinction):
    try:
        plan = design(angles, extinction)
    except ValueError:
        assume(False)
    assert np.max(np.abs(plan.inverse @ plan.system - np.eye(3))) <= 1e-13 * plan.condition


@settings(deadline=None, max_examples=60)
@given(angles=st.lists(st.floats(0.0, 3.0), min_size=3, max_size=8))
def test_offset_adds_to_s0_only(angles):
    try:
        plan = design(angles)
    except ValueError:
        assume(False)
    offset = plan.inverse @ np.ones(len(angles))
    np.testing.assert_allclose(offset, [2.0, 0.0, 0.0], atol=1e-13 * plan.condition)


ADDITIVE = [
    (PICKERING_RAD, 1.0 + np.sqrt(2.0), (2.0, 2.0, 6.0)),
    (FESSENKOV_RAD, np.sqrt(2.0), (4 / 3, 8 / 3, 8 / 3)),
    (MODIFIED_PICKERING_RAD, np.sqrt(2.0), (1.0, 2.0, 2.0)),
    (tuple(np.pi * np.arange(7) / 7), np.sqrt(2.0), (4 / 7, 8 / 7, 8 / 7)),
]


@pytest.mark.parametrize(("angles", "condition", "variances"), ADDITIVE)
def test_variances_under_additive_noise(angles, condition, variances):
    plan = design(angles)
    assert plan.condition == pytest.approx(condition, rel=1e-13)
    np.testing.assert_allclose(np.diag(plan.inverse @ plan.inverse.T), variances, rtol=1e-13)
    assert plan.ewv == pytest.approx(sum(variances), rel=1e-13)


@pytest.mark.parametrize("leak", [0.0, 1e-3, 0.1, 0.5])
def test_condition_with_leakage(leak):
    extinction = np.inf if leak == 0.0 else 1.0 / leak
    expected = np.sqrt(2.0) * (1.0 + leak) / (1.0 - leak)
    assert design(MODIFIED_PICKERING_RAD, extinction).condition == pytest.approx(expected, rel=1e-12)


def test_repeats_are_allowed_beside_three_angles():
    plan = design(np.deg2rad([0, 60, 120, 180]))
    np.testing.assert_allclose(plan.inverse[:, 0], plan.inverse[:, 3], atol=1e-15)


def test_nearly_equal_angles_are_flagged():
    plan = design(np.deg2rad([0, 90, 90.1]))
    assert plan.condition == pytest.approx(810.3, abs=0.1)
    assert "condition number" in plan.warnings[0]


@pytest.mark.parametrize(
    ("angles_deg", "extinction", "message"),
    [
        ((0, 0, 90), np.inf, "modulo 180 deg"),
        ((0, 180, 45), np.inf, "modulo 180 deg"),
        ((5, 185, 95), np.inf, "modulo 180 deg"),
        ((0.0, 0.08, 0.16), np.inf, "allowed is at most 1e\\+06"),
        ((0.0, 60.0), np.inf, "allowed"),
        ((0.0, 60.0, np.nan), 10.0, "allowed"),
        ((0.0, 45.0, 90.0), 1.0, "allowed"),
    ],
)
def test_angles_that_give_no_stokes_parameters_are_refused(angles_deg, extinction, message):
    with pytest.raises(ValueError, match=message):
        design(np.deg2rad(angles_deg), extinction)


@pytest.mark.parametrize(
    ("given", "found"), [(np.float64, np.float64), (np.float32, np.float32), (np.uint16, np.float64)]
)
def test_pictures_have_their_angles_first_and_single_precision_stays_single(given, found):
    plan = design(MODIFIED_PICKERING_RAD, 500.0)
    stokes = 1000.0 + 100.0 * np.random.default_rng(1).normal(size=(3, 5, 6))
    channels = np.tensordot(plan.system, stokes, axes=1).astype(given)
    result = reconstruct(plan, channels)
    assert result.dtype == found
    np.testing.assert_allclose(np.tensordot(plan.system, result, axes=1).mean(), channels.mean(), rtol=1e-3)
    if given == np.float64:
        np.testing.assert_allclose(result, stokes, rtol=1e-13)


def test_wrong_number_of_channels_is_refused():
    with pytest.raises(ValueError, match="must hold the 3 angles"):
        reconstruct(design(PICKERING_RAD), np.ones((4, 2)))


@pytest.mark.parametrize(("degree", "angle"), [(0.05, 0.3), (0.6, 1.2), (1.0, 2.0)])
def test_shot_noise_closed_form_of_modified_pickering(degree, angle):
    plan = design(MODIFIED_PICKERING_RAD)
    s0, s1, s2 = 1000.0 * np.array([1.0, degree * np.cos(2.0 * angle), degree * np.sin(2.0 * angle)])
    light = plan.system @ [s0, s1, s2]
    found = stokes_moments(plan, Moments(mean=light, cov=np.diag(light)))
    expected = 0.5 * np.array([[s0, s1, s2], [s1, 2 * s0, 0.0], [s2, 0.0, 2 * s0]])
    np.testing.assert_allclose(found.cov, expected, atol=1e-13 * s0)
    # var DoLP = (1 - DoLP^2 / 2) / S0 at every angle.
    np.testing.assert_allclose(first_order(found.mean, found.cov).variance, (1 - degree**2 / 2) / s0, rtol=1e-12)


def test_additive_closed_form_of_modified_pickering():
    plan = design(MODIFIED_PICKERING_RAD)
    found = stokes_moments(plan, Moments(mean=[60.0, 55.0, 40.0, 45.0], cov=9.0 * np.eye(4)))
    np.testing.assert_allclose(found.cov, 9.0 * np.diag([1.0, 2.0, 2.0]), atol=1e-13)
    degree = np.hypot(20.0, 10.0) / 100.0
    np.testing.assert_allclose(first_order(found.mean, found.cov).variance, 9.0 * (2 + degree**2) / 1e4, rtol=1e-13)


@pytest.mark.parametrize("frames", [3, 4, 5, 12])
def test_equal_spacing_reaches_the_best_condition(frames):
    plan = design(equispaced_rad(frames, start_rad=0.3))
    np.testing.assert_allclose([plan.condition, plan.ewv], [np.sqrt(2.0), 20.0 / frames], rtol=1e-13)


def test_an_angle_whose_95_percent_interval_covers_the_half_turn_is_undefined():
    std_rad = np.radians([0.0, 45.9, 46.0, 81.0, np.inf, np.nan])
    np.testing.assert_array_equal(aolp_is_defined(std_rad), [True, True, False, False, False, False])


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


def test_three_angles_have_no_excess_to_speak_of():
    plan = design(np.deg2rad([0.0, 60.0, 120.0]), np.inf)
    assert pair_sum_excess(plan, [1.0, 2.0, 3.0], np.eye(3)) == (0.0, 0.0)


def test_a_common_factor_changes_nothing_and_has_no_error():
    mean = np.array([3.0, 4.0, 5.0])
    plain, _ = channel_ratios(Moments(mean=mean, cov=np.zeros((3, 3))))
    scaled, errors = channel_ratios(Moments(mean=7.0 * mean, cov=0.01 * np.outer(mean, mean)))
    np.testing.assert_allclose(scaled, plain, rtol=1e-14)
    # The root of rounding of a difference of numbers of size 1e-3.
    np.testing.assert_allclose(errors, 0.0, atol=1e-9)


def test_the_covariance_is_that_of_draws():
    cov = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 0.01]])
    _, errors = channel_ratios(Moments(mean=np.array([30.0, 40.0, 50.0]), cov=cov))
    drawn = np.random.default_rng(3).multivariate_normal([30.0, 40.0, 50.0], cov, size=100_000)
    ratios = drawn / drawn.mean(axis=1, keepdims=True)
    # Standard error of a sample variance: sqrt(2/n); five of them. Second order is 1e-4 of it.
    np.testing.assert_allclose(errors**2, ratios.var(axis=0), rtol=5 * np.sqrt(2 / 1e5) + 1e-4)
