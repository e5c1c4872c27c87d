"""Scores and Holm's rule, propagation and update of inputs, trends."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.processing.agreement import (
    MOVED,
    confusion,
    drift_line,
    holm_rejections,
    input_jacobian,
    propagate,
    rank_correlation,
    two_sided_p_value,
    update_inputs,
)


def test_two_sided_p_value_of_known_scores():
    # Tables of the normal law: 1.959963985 leaves 5 % outside, 3.290526731 one in a thousand.
    assert two_sided_p_value([1.959963984540054, -3.290526731491926, 0.0]) == pytest.approx(
        [0.05, 1e-3, 1.0], rel=1e-12
    )


def test_holm_rejects_step_by_step():
    # alpha / 4, / 3, / 2, / 1 = 0.0125, 0.0167, 0.025, 0.05: the third fails, so the fourth is kept too.
    assert holm_rejections([0.04, 0.001, 0.03, 0.015], alpha=0.05).tolist() == [False, True, False, True]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30))
@settings(deadline=None, max_examples=100)
def test_holm_rejects_all_that_bonferroni_does_and_nothing_above_alpha(p_values):
    p = np.array(p_values)
    rejected = holm_rejections(p, alpha=0.05)
    assert rejected[p <= 0.05 / p.size].all()
    assert not rejected[p > 0.05].any()


def test_family_wise_error_rate_holds_for_dependent_scores():
    rng = np.random.default_rng(1)
    common = rng.normal(size=(4000, 1))
    p = two_sided_p_value(0.8 * common + 0.6 * rng.normal(size=(4000, 20)))
    any_rejected = [holm_rejections(row, alpha=0.05).any() for row in p]
    # 4000 trials at 5 %: standard error 0.0034; dependence can only lower the rate.
    assert np.mean(any_rejected) < 0.05 + 4 * 0.0034


def test_an_input_at_its_limit_is_varied_to_one_side_only():
    seen = []

    def function(x):
        seen.append(float(x[0]))
        return 3.0 * x

    found = input_jacobian(function, [0.0], [2.0], least=(0.0,))
    assert min(seen) >= 0.0
    assert found[0, 0] == pytest.approx(3.0, rel=1e-12)


def _propagate(function, values, cov, **limits):
    size = len(values)
    free = {"least": np.full(size, -np.inf), "most": np.full(size, np.inf)}
    return propagate(function, values, cov, **(free | limits))


def test_a_linear_response_gives_j_cov_j():
    matrix = np.array([[1.0, 2.0], [0.5, -3.0], [0.0, 1.0]])
    cov = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = _propagate(lambda x: matrix @ x, [1.0, 2.0], cov)
    # Differences over 0.2 and 0.3 of numbers of size 10: rounding of 1e-14.
    np.testing.assert_allclose(found.cov, matrix @ cov @ matrix.T, atol=1e-13)
    np.testing.assert_allclose(found.effects, matrix * [0.2, 0.3], atol=1e-13)
    assert found.curved == ()


def test_a_square_about_its_vertex_is_taken_by_quadrature():
    # x^2 with x ~ N(0, s): second moment about the value at 0 is 3 s^4; the slope alone says 0. Exact for 3 nodes on.
    found = _propagate(lambda x: x**2, [0.0], np.array([[0.25]]))
    assert found.curved == (0,)
    np.testing.assert_allclose(found.cov, [[3 * 0.25**2]], rtol=1e-12)


def test_correlated_inputs_bend_together_along_the_axes_of_their_covariance():
    # x0 + x1 ~ N(0, t) with t = 2 s^2 (1 + rho): of its square the second moment is 3 t^2. Each alone makes 3 s^4.
    cov = 0.25 * np.array([[1.0, 0.9], [0.9, 1.0]])
    found = _propagate(lambda x: np.array([(x[0] + x[1]) ** 2]), [0.0, 0.0], cov)
    assert found.curved == (0, 1)
    np.testing.assert_allclose(found.cov, [[3.0 * cov.sum() ** 2]], rtol=1e-12)


def test_correlated_inputs_without_room_together_are_moved_alone():
    cov = np.array([[0.25, 0.2], [0.2, 0.25]])
    room = {"least": np.array([-9.0, 0.0]), "curvature_tolerance": 0.01}
    found = _propagate(lambda x: np.array([x[0] ** 2 + 9.0 * x[1]]), [0.0, 0.6], cov, **room)
    assert (found.curved, found.limited) == ((0,), ())
    np.testing.assert_allclose(found.cov, [[81.0 * 0.25 + 3.0 * 0.25**2]], rtol=1e-12)


def test_a_curved_response_beside_a_steep_one_is_left_to_slopes():
    def function(x):
        return np.array([100.0 * x[0] + x[1] ** 2])

    found = _propagate(function, [0.0, 0.0], np.eye(2))
    # The bend is 1 against 100: it changes the deviation by 3 / 2e4.
    assert found.curved == ()


def test_an_input_near_its_limit_has_a_slope_over_the_room_that_there_is_and_is_named():
    found = _propagate(lambda x: 2.0 * x, [0.5], np.array([[1.0]]), least=np.array([0.4]))
    np.testing.assert_allclose(found.effects, [[2.0]], rtol=1e-12)
    assert found.limited == (0,)


def test_a_curved_input_without_room_for_quadrature_is_named():
    # One standard uncertainty fits above 0; the outer node of three, at 1.73 of them, does not.
    found = _propagate(lambda x: x**3, [1.2], np.array([[1.0]]), least=np.array([0.0]))
    assert found.limited == (0,)
    assert found.curved == ()


def test_limits_are_never_crossed():
    seen = []

    def function(x):
        seen.append(float(x[0]))
        return x**3

    _propagate(function, [0.9], np.array([[0.04]]), least=np.array([0.0]), most=np.array([1.0]))
    assert min(seen) >= 0.0
    assert max(seen) <= 1.0


def test_where_results_do_not_exist_on_one_side_the_other_has_to_do():
    def function(x):
        if x[0] > 1.1:
            raise ValueError("too large")
        return 2.0 * x

    found = _propagate(function, [1.0], np.array([[0.25]]))
    np.testing.assert_allclose(found.effects, [[1.0]], rtol=1e-12)
    assert found.limited == (0,)


def test_a_curved_response_that_ends_before_the_outer_node_takes_the_narrower_rule():
    def function(x):
        if abs(x[0]) > 2.0:
            raise ValueError("too far")
        return x**2

    # Nodes of three lie at 1.73 standard uncertainties, of five at 2.86.
    found = _propagate(function, [0.0], np.array([[1.0]]))
    assert found.curved == (0,)
    np.testing.assert_allclose(found.cov, [[3.0]], rtol=1e-12)


RNG = np.random.default_rng(12)
# Eight results, three inputs: the first acts alone, the second and third act alike on all.
EFFECTS = np.array([[1.0, 0, 0, 1, 0, 0, 1, 0], [0.5] * 8, [0.25] * 8]).T
NOISE = 0.01 * np.eye(8)


def _explain(residual, effects=EFFECTS, noise=NOISE, correlation=None):
    correlation = np.eye(effects.shape[1]) if correlation is None else correlation
    return update_inputs(residual, measurement_cov=noise, effects=effects, input_correlation=correlation)


def test_the_joint_update_is_that_of_the_normal_equations():
    residual = RNG.normal(size=8)
    found = _explain(residual)
    # Precision form of the same posterior; condition number about 1e4.
    precision = np.eye(3) + EFFECTS.T @ np.linalg.inv(NOISE) @ EFFECTS
    cov = np.linalg.inv(precision)
    np.testing.assert_allclose(found.joint_move, cov @ EFFECTS.T @ np.linalg.inv(NOISE) @ residual, atol=1e-10)
    np.testing.assert_allclose(found.joint_std, np.sqrt(np.diag(cov)), atol=1e-10)


def test_a_moved_input_is_first_and_its_move_is_found():
    found = _explain(5.0 * EFFECTS[:, 0])
    assert found.order[0] == 0
    # The move is biased by nothing: without noise it is the move, to rounding.
    np.testing.assert_allclose(found.move[0], 5.0, rtol=1e-10)
    np.testing.assert_allclose(found.chi_square_left[0], 0.0, atol=1e-8)


def test_of_inputs_that_act_alike_the_one_that_moves_least_comes_first_and_both_are_named():
    found = _explain(5.0 * EFFECTS[:, 2])
    assert found.order[0] == 1
    np.testing.assert_allclose(found.move[1:], [2.5, 5.0], rtol=1e-10)
    assert 2 in found.confused_with(1)
    assert 1 in found.confused_with(2)
    assert found.confused_with(0) == ()


def test_an_input_that_the_data_do_not_see_has_no_move():
    effects = np.column_stack([EFFECTS, np.zeros(8)])
    found = _explain(RNG.normal(size=8), effects=effects)
    assert found.move[3] == 0.0
    assert found.seen[3] == 0.0
    assert len(found.confused_with(3)) > 0


def test_scores_are_standard_normal_where_everything_stated_is_right():
    draws = 4000
    inputs = RNG.normal(size=(draws, 3))
    residuals = inputs @ EFFECTS.T + 0.1 * RNG.normal(size=(draws, 8))
    found = [_explain(residual) for residual in residuals]
    scores = np.array([explanation.score for explanation in found])
    # Variance of a sample variance: 2/n; five standard errors.
    np.testing.assert_allclose(scores.var(axis=0), 1.0, atol=5 * np.sqrt(2 / draws))
    chi_squares = np.array([explanation.chi_square for explanation in found])
    np.testing.assert_allclose(chi_squares.mean(), 8.0, atol=5 * np.sqrt(16 / draws))


def test_the_chance_of_confusion_is_that_of_draws():
    seen, alike, draws = 0.5, 0.6, 200_000
    scores = RNG.multivariate_normal(
        MOVED * np.sqrt(seen) * np.array([1.0, alike]), [[1.0, alike], [alike, 1.0]], size=draws
    )
    drawn = np.mean(np.abs(scores[:, 1]) > scores[:, 0])
    # Binomial standard error about sqrt(0.06 / n); five of them. The two half-planes overlap by nothing that counts.
    np.testing.assert_allclose(confusion(seen, alike), drawn, atol=5 * np.sqrt(0.06 / draws))


def test_a_correlated_input_takes_the_other_with_it():
    correlation = np.array([[1.0, 0.5], [0.5, 1.0]])
    effects = np.array([[1.0, 0.0], [0.0, 1.0]])
    # Where the first moves by 2, the second is expected to move by 1.
    found = _explain(np.array([2.0, 1.0]), effects=effects, noise=1e-6 * np.eye(2), correlation=correlation)
    np.testing.assert_allclose(found.move[0], 2.0, rtol=1e-5)
    np.testing.assert_allclose(found.chi_square_left[0], 0.0, atol=1e-5)


def test_results_in_different_units_do_not_disturb_each_other():
    units = np.array([1e6, 1, 1, 1e-6, 1, 1, 1, 1.0])
    residual = RNG.normal(size=8)
    plain = _explain(residual)
    scaled = _explain(residual * units, effects=EFFECTS * units[:, None], noise=NOISE * np.outer(units, units))
    np.testing.assert_allclose(scaled.score, plain.score, rtol=1e-8)


def test_the_slope_is_that_of_weighted_least_squares():
    x, y, s = np.array([0.0, 1.0, 3.0, 4.0]), np.array([1.0, 2.5, 6.0, 9.5]), np.array([1.0, 0.5, 0.5, 2.0])
    basis = np.column_stack([np.ones(4), x]) / s[:, None]
    cov = np.linalg.inv(basis.T @ basis)
    found = drift_line(x, y, s)
    assert found.slope == pytest.approx((cov @ basis.T @ (y / s))[1], rel=1e-12)
    assert found.std_error == pytest.approx(np.sqrt(cov[1, 1]), rel=1e-12)
    assert found.degrees_of_freedom == 2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: holm_rejections([0.1], alpha=1.0), "alpha"),
        (lambda: holm_rejections([1.1], alpha=0.05), "p_values"),
        (lambda: _explain(np.zeros(8), effects=np.zeros((8, 1)), noise=np.zeros((8, 8))), "one result needs one"),
        (lambda: drift_line([0, 1], np.zeros(2), [1, 1]), "at least three numbers"),
        (lambda: drift_line([1, 1, 1], np.zeros(3), [1, 1, 1]), "at least three numbers"),
        (lambda: drift_line([0, 1, 2], np.zeros(3), [1, 0, 1]), "at least three numbers"),
    ],
)
def test_arguments_without_a_result_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


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


def test_pairs_within_their_error_are_not_known():
    found = _order([1.0, 1.1, 5.0], [1.1, 1.0, 5.0], measured_error=0.1)
    # The first two differ by 0.1; two errors of a difference are 0.28.
    assert (found.pairs, found.known_pairs, found.concordant) == (3, 2, 2)


def test_what_two_numbers_have_in_common_does_not_blur_their_order():
    common = np.full((3, 3), 4.0) + 1e-4 * np.eye(3)
    found = rank_correlation([1, 2, 3], [1, 2, 3], predicted_cov=common, measured_cov=np.zeros((3, 3)))
    assert found.known_pairs == 3
