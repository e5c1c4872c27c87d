import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.processing.agreement import holm_rejections, propagate_inputs, two_sided_p_value


def test_two_sided_p_value_of_known_scores():
    # Tables of the normal law: 1.959963985 leaves 5 % outside, 3.290526731 one in a thousand.
    assert two_sided_p_value([1.959963984540054, -3.290526731491926, 0.0]) == pytest.approx(
        [0.05, 1e-3, 1.0], rel=1e-12
    )


def test_holm_rejects_step_by_step():
    # alpha / 4, / 3, / 2, / 1 = 0.0125, 0.0167, 0.025, 0.05: the third fails, so the fourth is kept too.
    assert holm_rejections([0.04, 0.001, 0.03, 0.015], alpha=0.05).tolist() == [False, True, False, True]


def test_holm_rejects_all_where_all_pass():
    assert holm_rejections([0.001, 0.002], alpha=0.05).all()


def test_holm_of_nothing_rejects_nothing():
    assert holm_rejections([], alpha=0.05).size == 0


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


@pytest.mark.parametrize("alpha", [0.0, 1.0, -1.0])
def test_alpha_outside_of_its_range_is_refused(alpha):
    with pytest.raises(ValueError, match="alpha"):
        holm_rejections([0.1], alpha=alpha)


def test_inputs_propagate_exactly_through_a_linear_function():
    a = np.array([[1.0, 2.0], [0.5, -3.0], [0.0, 1.0]])
    cov = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = propagate_inputs(lambda x: a @ x, [1.0, 2.0], cov, least=(-np.inf, -np.inf))
    assert found == pytest.approx(a @ cov @ a.T, rel=1e-12)


def test_an_input_at_its_limit_is_varied_to_one_side_only():
    seen = []

    def function(x):
        seen.append(float(x[0]))
        return 3.0 * x

    found = propagate_inputs(function, [0.0], [[4.0]], least=(0.0,))
    assert min(seen) >= 0.0
    assert found[0, 0] == pytest.approx(36.0, rel=1e-12)


def test_an_input_without_uncertainty_adds_nothing():
    found = propagate_inputs(lambda x: x**2, [1.0, 2.0], np.diag([0.0, 0.01]), least=(-np.inf, -np.inf))
    assert found[0, 0] == 0.0
    assert found[1, 1] == pytest.approx(0.16, rel=1e-12)
