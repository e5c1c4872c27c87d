"""Tails of quadratic forms: closed forms, invariances, and two oracles."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import betainc, gammaincc, ndtr

from model.processing import quadratic_forms as chi_square
from model.processing.quadratic_forms import tail_probabilities
from tests.model.processing.quadratic_form_oracles import ray_log_tail

# Two or three roundings in the exponent and in the prefactor.
ROUNDING = 1e-14


def upper_tail(*arguments, **more):
    return tail_probabilities(*arguments, **more).upper


def lower_tail(*arguments, **more):
    return tail_probabilities(*arguments, **more).lower


def test_one_shifted_square_is_a_sum_of_two_normal_tails() -> None:
    # (z + 30)^2 <= 4: z between -32 and -28, a probability of 1e-172
    assert_allclose(lower_tail(4.0, [1.0], [30.0]), ndtr(-28.0) - ndtr(-32.0), rtol=1e-13)


def test_equal_weights_are_chi_square_down_to_1e_300() -> None:
    p = np.array([1e-300, 1e-134, 1e-12, 0.3, 0.999])
    threshold = chi_square.upper_quantile(p, 5)
    # half a unit in the last place of the threshold is worth 8e-14 at 1e-300
    assert_allclose(upper_tail(2.5 * threshold, np.full(5, 2.5), np.zeros(5)), p, rtol=1e-13)


def test_logarithm_reaches_beyond_doubles() -> None:
    tails = tail_probabilities(1e5, [1.0, 1.0], [0.0, 0.0])
    assert tails.upper == 0.0
    assert_allclose(tails.log_upper, -5e4, rtol=1e-15)


def test_lower_tail_close_to_the_support() -> None:
    # P(chi-square_3 <= t) tends to sqrt(2/pi) t^1.5/3
    assert_allclose(lower_tail(1e-180, np.ones(3), np.zeros(3)), np.sqrt(2.0 / np.pi) * 1e-270 / 3.0, rtol=1e-13)


def test_weights_of_both_signs_at_zero_are_a_beta_law() -> None:
    # P(2 chi-square_3 > 5 chi-square_4), with y = chi_4/(chi_3 + chi_4) < 2/7
    found = upper_tail(0.0, [2.0, -5.0], [0.0, 0.0], degrees=[3.0, 4.0])
    assert_allclose(found, betainc(2.0, 1.5, 2.0 / 7.0), rtol=ROUNDING)


def test_degrees_stand_for_repeated_weights() -> None:
    repeated = upper_tail(9.0, [2.0, 0.5, 0.5, 0.5], [1.0, 0.6, 0.0, 0.8])
    assert_allclose(upper_tail(9.0, [2.0, 0.5], [1.0, 1.0], degrees=[1.0, 3.0]), repeated, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("threshold", "weights", "expected"),
    [
        (-1.0, [1.0, 2.0], 1.0),
        (0.0, [1.0, 2.0], 1.0),
        (0.0, [-1.0, -2.0], 0.0),
        (1.0, [-1.0, -2.0], 0.0),
        (np.inf, [1.0, -1.0], 0.0),
        (-np.inf, [1.0, -1.0], 1.0),
        (1.0, [0.0, 0.0], 0.0),
        (0.0, [0.0, 0.0], 0.0),
        (-1.0, [0.0, 0.0], 1.0),
    ],
)
def test_impossible_and_certain_events(threshold: float, weights: list[float], expected: float) -> None:
    tails = tail_probabilities(threshold, weights, [0.3, 0.0])
    assert (tails.upper, tails.lower) == (expected, 1.0 - expected)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_tolerance_is_kept_and_the_estimate_says_so(tolerance: float) -> None:
    threshold = np.array([0.01, 0.5, 3.0, 8.0, 30.0, 90.0])
    args = ([0.2, 1.0, 3.0], [2.0, 0.0, -1.0])
    rough = tail_probabilities(threshold, *args, tolerance=tolerance)
    fine = tail_probabilities(threshold, *args, tolerance=1e-12)
    above = threshold > np.sum(np.array(args[0]) * (1.0 + np.square(args[1])))
    error = np.where(above, rough.log_upper - fine.log_upper, rough.log_lower - fine.log_lower)
    assert np.all(np.abs(error) < tolerance)
    # geometric convergence: what half the nodes still missed is more than what all of them miss
    assert np.all(np.abs(error) <= 2.0 * rough.error)
    assert np.all(rough.error <= tolerance + 1e-12)


@settings(deadline=None, max_examples=60)
@given(
    weights=st.lists(st.floats(-10.0, 10.0).filter(lambda x: abs(x) > 1e-3), min_size=2, max_size=5),
    offset=st.floats(-5.0, 5.0),
    place=st.floats(-4.0, 4.0),
)
def test_negative_of_a_form_swaps_the_tails(weights: list[float], offset: float, place: float) -> None:
    w, b = np.array(weights), np.full(len(weights), offset)
    deviation = np.sqrt(np.sum(2.0 * w**2 * (1.0 + 2.0 * b**2)))
    threshold = np.sum(w * (1.0 + b**2)) + place * deviation
    here, there = tail_probabilities(threshold, w, b), tail_probabilities(-threshold, -w, b)
    assert_allclose(there.lower, here.upper, rtol=1e-12)
    assert_allclose(there.upper, here.lower, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": [1.0, np.nan]}, "weights"),
        ({"weights": 1.0}, "last axis"),
        ({"offsets": [0.0, np.inf]}, "offsets"),
        ({"threshold": np.nan}, "threshold"),
        ({"degrees": [1.0, 0.0]}, "degrees"),
        ({"constant": np.inf}, "constant"),
        ({"tolerance": 1e-15}, "tolerance"),
        ({"tolerance": 0.5}, "tolerance"),
    ],
)
def test_refusals_name_the_argument(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"threshold": 1.0, "weights": [1.0, 2.0], "offsets": [0.0, 0.0]} | change
    with pytest.raises(ValueError, match=message):
        tail_probabilities(**arguments)


# The default tolerance is 1e-10 for half of the nodes in use; rounding of a threshold and of offsets b adds about
# b times 1e-16. Geometric convergence leaves less than 1e-12 of all that in every case here.
RELATIVE = 1e-12
RAYS = [
    # (threshold, weights, offsets, upper)
    (11.3, [1e-12, 1.0, 1e6], [1.0, 2.0, 3.0], False),
    (2.4, [1e-12, 1.0, 1e6], [0.0, 0.0, 0.0], False),
    (3e7, [1e-12, 1.0, 1e6], [1.0, 2.0, 3.0], True),
    (1650.0, [1e-6, 1.0, 2.0], [4e4, 1.0, -1.0], True),  # a narrow component at 40 sigma beside two wide ones
    (1590.0, [1e-6, 1.0, 2.0], [4e4, 1.0, -1.0], False),
    (1e6 + 5e4, [1.0, 0.3], [1e3, 2.0], True),
    (9e5, [1.0, 0.3], [1e3, 2.0], False),
    (30.66484970621360, [0.02, 0.03, 0.05], [1.0, 0.0, 0.0], True),  # 6e-135
    (2.365973884375338, [0.139675, 0.482143, 0.484825], [-52.6127, -1.47938, 10.8357], False),  # 1e-540
    (50.0, [0.5**k for k in range(12)], [0.1 * k for k in range(12)], True),
    (164463.5552304844, [2.28309971, 5.83185265], [253.805556, 0.0204860363], True),
]
MIXED = [
    # (threshold, weights, offsets, degrees, upper, angle of the oracle's ray)
    (0.0, [1e-12, 1.0, 1e6, -1.0], [1.0, 2.0, 3.0, 0.0], [1.0, 1.0, 1.0, 3.0], False, 60),
    (0.0, [0.02, 0.03, 0.05, -1.0], [1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 3.0], True, 60),
    (0.0, [1e-10, 1e-10, 1e-10, -1.0], [1e5, 2e5, 1e5, 0.0], [1.0, 1.0, 1.0, 3.0], True, 120),
    # DoLP: two positive weights, a negative one that is a threshold but for 1e-3 or 1e-6 of it
    (0.0, [1.0, 1.2, -1e-6], [0.1, 0.2, 1e3], [1.0, 1.0, 1.0], True, 60),
    (0.0, [1.0, 1.2, -9e-12], [0.1, 0.2, 1e6], [1.0, 1.0, 1.0], True, 60),
    # found by random scans: cancellation at a negative weight beyond 1e12 of the positive ones, and its mirror
    (319579165.3361443, [-1.45810044e-05, 3.47870638e07], [-7.32440215, 5.39912215], [7.0, 2.0], False, 120),
    (
        -253663603932.91553,
        [1.13592271e-12, -1.75506725e-05, -3.88554108e10],
        [-5.94616792, 1.85740628, -2.35125466],
        [1.0, 1.0, 1.0],
        True,
        120,
    ),
    (0.0304256978393522, [-2.2034424498e-11, 0.00176597411], [-4.96566674, -6.51463161], [1.0, 1.0], False, 120),
]


@pytest.mark.slow
@pytest.mark.parametrize(("threshold", "weights", "offsets", "upper"), RAYS)
def test_spread_weights_against_a_straight_ray(
    threshold: float, weights: list[float], offsets: list[float], upper: bool
) -> None:
    tails = tail_probabilities(threshold, weights, offsets)
    expected = ray_log_tail(threshold, weights, offsets, upper=upper)
    found = float(tails.log_upper if upper else tails.log_lower)
    # a double holds the logarithm of a tail of 1e-540 to 1e-13
    assert found == pytest.approx(float(expected), abs=RELATIVE)


@pytest.mark.slow
@pytest.mark.parametrize(("threshold", "weights", "offsets", "degrees", "upper", "angle_deg"), MIXED)
def test_weights_of_both_signs_against_a_straight_ray(
    threshold: float, weights: list[float], offsets: list[float], degrees: list[float], upper: bool, angle_deg: int
) -> None:
    tails = tail_probabilities(threshold, weights, offsets, degrees=degrees)
    expected = ray_log_tail(threshold, weights, offsets, upper=upper, angle_deg=angle_deg, degrees=degrees)
    found = float(tails.log_upper if upper else tails.log_lower)
    assert found == pytest.approx(float(expected), abs=RELATIVE)


def test_nearly_equal_weights_are_continuous() -> None:
    threshold = np.array([0.1, 3.0, 20.0, 60.0])
    equal = tail_probabilities(threshold, [1.0, 1.0, 1.0], [1.0, 2.0, 0.0])
    # a weight of 1 +- d changes a tail by d (t/2) relative at most: 3e-8 at t = 60 and d = 1e-9, and to first
    # order the two changes here cancel but for the difference of their offsets
    for spread in (1e-9, 1e-11, 1e-13):
        near = tail_probabilities(threshold, [1.0 - spread, 1.0, 1.0 + spread], [1.0, 2.0, 0.0])
        np.testing.assert_allclose(near.upper, equal.upper, rtol=31.0 * spread + 1e-13)


def test_error_estimate_grows_with_the_exponent() -> None:
    # offsets of 1e7: the exponent at the saddle is a difference of terms of 1e14 s, which rounding blurs
    easy = tail_probabilities(1.21, [1e-10] * 2, [1e5, 0.0])
    blurred = tail_probabilities(1.21, [1e-14] * 2, [1e7, 0.0])
    assert blurred.error > 10.0 * easy.error


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 13, 40])
@pytest.mark.parametrize("p", [1e-300, 1e-12, 0.4, 0.6, 1.0 - 1e-12])
def test_quantile(degrees: int, p: float) -> None:
    found = float(chi_square.upper_quantile(p, degrees))
    half, order = mp.mpf(found) / 2, mp.mpf(degrees) / 2
    if p < 0.5:
        residual = mp.gammainc(order, half, regularized=True) / mp.mpf(p) - 1
        scale = mp.gammainc(order, half)
    else:
        residual = 1 - mp.gammainc(order, 0, half, regularized=True) / (1 - mp.mpf(p))
        scale = mp.gammainc(order, 0, half)
    # one Newton step from the quantile found to the true one, relative to it
    step = residual * scale / (half**order * mp.exp(-half))
    assert abs(float(step)) < 1e-15


@pytest.mark.parametrize("degrees", [200, 201, 500, 2000])
@pytest.mark.parametrize("p", [1e-12, 1e-3, 0.5, 0.999])
def test_many_degrees_of_freedom_have_quantiles(p, degrees):
    found = chi_square.upper_quantile(p, degrees)
    assert gammaincc(0.5 * degrees, 0.5 * found) == pytest.approx(p, rel=1e-9)


def test_quantiles_at_both_ends() -> None:
    assert [float(chi_square.upper_quantile(p, 3)) for p in (0.0, 1.0)] == [np.inf, 0.0]
