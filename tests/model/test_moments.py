import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.moments import Moments, covariance_factor, propagate_first_order, propagate_linear


def test_linear_map_is_exact():
    moments = Moments(mean=[1.0, 2.0], cov=[[2.0, 0.5], [0.5, 1.0]])
    found = propagate_linear(moments, [[1.0, 1.0], [1.0, -1.0], [0.0, 3.0]])
    np.testing.assert_array_equal(found.mean, [3.0, -1.0, 6.0])
    np.testing.assert_array_equal(np.diag(found.cov), [4.0, 2.0, 9.0])
    assert found.cov[0, 1] == 1.0


def test_first_order_uses_the_jacobian():
    found = propagate_first_order(Moments(mean=[3.0], cov=[[0.01]]), [9.0], [[6.0]])
    np.testing.assert_allclose([found.mean[0], found.cov[0, 0]], [9.0, 0.36])


@pytest.mark.parametrize(
    ("mean", "cov", "message"),
    [
        ([1.0, 2.0], np.eye(3), "do not fit"),
        (1.0, [[1.0]], "do not fit"),
        ([np.nan, 0.0], np.eye(2), "not finite"),
        ([0.0, 0.0], [[1.0, 0.1], [0.2, 1.0]], "not symmetric"),
        ([0.0, 0.0], [[1.0, 2.0], [2.0, 1.0]], "not positive semi-definite"),
        ([0.0, 0.0], [[1.0, 0.0], [0.0, -1e-11]], "not positive semi-definite"),
        (np.zeros((4, 2)), np.ones((3, 2, 2)), "broadcast"),
    ],
)
def test_what_is_no_mean_and_covariance_is_refused(mean, cov, message):
    with pytest.raises(ValueError, match=message):
        Moments(mean=mean, cov=cov)


def test_eigenvalue_negative_by_rounding_counts_as_zero():
    cov = np.diag([1.0, -1e-18])
    factor = covariance_factor(Moments(mean=[0.0, 0.0], cov=cov).cov)
    np.testing.assert_array_equal(factor @ factor.T, np.diag([1.0, 0.0]))


def test_values_cannot_be_changed_afterwards():
    moments = Moments(mean=np.zeros(2), cov=np.eye(2))
    with pytest.raises(ValueError, match="read-only"):
        moments.cov[0, 0] = 2.0


def test_no_covariance_at_all_is_a_covariance():
    assert Moments(mean=[1.0, 2.0], cov=np.zeros((2, 2))).cov.sum() == 0.0


@settings(deadline=None, max_examples=50)
@given(exponent=st.floats(-80.0, 80.0), rank=st.integers(0, 4))
def test_factor_reproduces_a_covariance_of_any_rank_and_unit(exponent, rank):
    root = np.random.default_rng(rank).normal(size=(4, rank)) * 10.0**exponent
    cov = root @ root.T
    factor = covariance_factor(cov)
    # Rounding of an eigenvalue problem of size 4.
    assert np.max(np.abs(factor @ factor.T - cov)) <= 2e-15 * np.trace(cov)


def test_common_factor_that_drops_out_of_a_ratio_leaves_a_covariance():
    # Texture alone, DoLP 0.999: the ratios S1/S0 and S2/S0 do not vary, and rounding must not be refused.
    stokes = np.array([1.0, 0.8, 0.598331])
    cov = 0.01**2 * np.outer(stokes, stokes) + 1e-14 * np.diag([1.0, 2.0, 3.0])
    jacobian = np.array([[-stokes[1], 1.0, 0.0], [-stokes[2], 0.0, 1.0]])
    found = propagate_first_order(Moments(mean=stokes, cov=cov), stokes[1:], jacobian)
    np.testing.assert_array_equal(found.cov, found.cov.T)
    assert np.all(np.linalg.eigvalsh(found.cov) >= -1e-20)
