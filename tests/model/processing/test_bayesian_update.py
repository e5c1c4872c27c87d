import numpy as np
import pytest

from model.processing.agreement import MOVED, confusion, update_inputs

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


def test_no_uncertainty_at_all_is_refused():
    with pytest.raises(ValueError, match="at least one result needs one"):
        _explain(np.zeros(8), effects=np.zeros((8, 1)), noise=np.zeros((8, 8)))


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="do not fit effects"):
        _explain(np.zeros(7))
