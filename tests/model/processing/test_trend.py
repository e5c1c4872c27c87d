import math

import numpy as np
import pytest

from model.processing.agreement import drift_line, rank_correlation


def test_the_slope_is_that_of_weighted_least_squares():
    x, y, s = np.array([0.0, 1.0, 3.0, 4.0]), np.array([1.0, 2.5, 6.0, 9.5]), np.array([1.0, 0.5, 0.5, 2.0])
    basis = np.column_stack([np.ones(4), x]) / s[:, None]
    cov = np.linalg.inv(basis.T @ basis)
    found = drift_line(x, y, s)
    assert found.slope == pytest.approx((cov @ basis.T @ (y / s))[1], rel=1e-12)
    assert found.std_error == pytest.approx(np.sqrt(cov[1, 1]), rel=1e-12)
    assert found.degrees_of_freedom == 2


@pytest.mark.parametrize(("x", "s"), [([0, 1], [1, 1]), ([1, 1, 1], [1, 1, 1]), ([0, 1, 2], [1, 0, 1])])
def test_what_has_no_slope_is_refused(x, s):
    with pytest.raises(ValueError, match="three numbers or more"):
        drift_line(x, np.zeros(len(x)), s)


def _order(predicted, measured, *, predicted_error=0.0, measured_error=0.0):
    n = len(predicted)
    return rank_correlation(
        predicted,
        measured,
        predicted_cov=predicted_error**2 * np.eye(n),
        measured_cov=measured_error**2 * np.eye(n),
    )


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_numbers_in_order_have_the_chance_of_one_order_of_all(n):
    found = _order(np.arange(n), np.arange(n) ** 2)
    assert found.tau == 1.0
    assert found.p_value == pytest.approx(1 / math.factorial(n))
    assert found.share_concordant == 1.0


def test_the_other_way_round_is_minus_one():
    found = _order([1, 2, 3, 4], [4, 3, 2, 1])
    assert found.tau == -1.0
    assert found.p_value == 1.0


def test_many_numbers_agree_with_the_exact_law_of_eight():
    # One neighbouring pair swapped of 8 in order: tau = 26/28, and 8 of 8! orders are that good or better.
    found = _order(np.arange(8), [0, 1, 2, 3, 4, 5, 7, 6])
    assert found.tau == pytest.approx(26 / 28)
    assert found.p_value == pytest.approx(8 / 40320, rel=1e-12)


@pytest.mark.parametrize("n", [3, 9])
def test_a_constant_has_no_order(n):
    found = _order(np.ones(n), np.arange(n))
    assert (found.tau, found.p_value) == (0.0, 1.0)


def test_pairs_within_their_error_are_not_known():
    found = _order([1.0, 1.1, 5.0], [1.1, 1.0, 5.0], measured_error=0.1)
    # The first two differ by 0.1; two errors of a difference are 0.28.
    assert (found.pairs, found.known_pairs, found.concordant) == (3, 2, 2)


def test_what_two_numbers_have_in_common_does_not_blur_their_order():
    common = np.full((3, 3), 4.0) + 1e-4 * np.eye(3)
    found = rank_correlation([1, 2, 3], [1, 2, 3], predicted_cov=common, measured_cov=np.zeros((3, 3)))
    assert found.known_pairs == 3


def test_nothing_known_has_no_share():
    assert _order([1, 2], [1, 2], measured_error=10.0).share_concordant is None


def test_one_number_is_refused():
    with pytest.raises(ValueError, match="2 or more"):
        _order([1], [1])
