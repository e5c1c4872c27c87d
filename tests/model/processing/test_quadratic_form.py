"""The law of a quadratic form in normal variables: anchors, limits and refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import betainc, erfc, ndtr

from model.processing import quadratic_forms as chi_square
from model.processing.quadratic_forms import tail_probabilities

# Two or three roundings in the exponent and in the prefactor.
ROUNDING = 1e-14


def upper_tail(*arguments, **more):
    return tail_probabilities(*arguments, **more).upper


def lower_tail(*arguments, **more):
    return tail_probabilities(*arguments, **more).lower


def test_one_central_square_is_the_error_function() -> None:
    threshold = np.array([1e-3, 1.0, 10.0, 50.0])
    assert_allclose(upper_tail(threshold, [1.0], [0.0]), erfc(np.sqrt(threshold / 2.0)), rtol=ROUNDING)


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


def test_constant_shifts_the_threshold() -> None:
    assert_allclose(
        upper_tail(7.0, [1.0, 2.0], [0.5, 0.0], constant=3.0), upper_tail(4.0, [1.0, 2.0], [0.5, 0.0]), rtol=0.0
    )


def test_zero_weights_count_for_nothing() -> None:
    assert_allclose(upper_tail(3.0, [1.0, 0.0], [0.5, 9.0]), upper_tail(3.0, [1.0], [0.5]), rtol=0.0)


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


def test_leading_axes_broadcast() -> None:
    weights = np.array([[1.0, 2.0], [0.5, -1.0], [3.0, 1e-9]])[:, None, :]
    threshold = np.array([0.5, 4.0])
    found = upper_tail(threshold, weights, [0.2, 1.0])
    assert found.shape == (3, 2)
    for i in range(3):
        for j in range(2):
            assert found[i, j] == upper_tail(threshold[j], weights[i, 0], [0.2, 1.0])


def test_more_forms_than_a_block() -> None:
    threshold = np.linspace(0.1, 40.0, 1000)
    found = upper_tail(threshold, [1.0, 1.0], [0.0, 0.0])
    assert_allclose(found, np.exp(-threshold / 2.0), rtol=ROUNDING)


def test_no_forms_at_all() -> None:
    assert upper_tail(np.zeros(0), [1.0], [0.0]).shape == (0,)


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
    weights=st.lists(st.floats(0.01, 100.0), min_size=1, max_size=5),
    offset=st.floats(-20.0, 20.0),
    place=st.floats(-3.0, 10.0),
    exponent=st.integers(-60, 60),
)
def test_unit_of_the_weights_is_free(weights: list[float], offset: float, place: float, exponent: int) -> None:
    w, b = np.array(weights), np.full(len(weights), offset)
    deviation = np.sqrt(np.sum(2.0 * w**2 * (1.0 + 2.0 * b**2)))
    threshold = np.sum(w * (1.0 + b**2)) + place * deviation
    # a power of two: no rounding, so only the path of the integral could differ
    unit = 2.0**exponent
    here, there = tail_probabilities(threshold, w, b), tail_probabilities(unit * threshold, unit * w, b)
    assert_allclose(there.log_upper, here.log_upper, rtol=1e-13, atol=1e-13)
    assert_allclose(there.log_lower, here.log_lower, rtol=1e-13, atol=1e-13)


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
