import numpy as np
import pytest

from model.processing.dolp import rice_moments
from tests.model.processing.test_dolp_moments import RICE


def _sampled(mean_1, mean_2, sigma_1, sigma_2):
    """Double trapezoidal rule on a fine grid: exact to rounding for smooth integrands."""
    z = np.linspace(-9.0, 9.0, 2881)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()
    length = np.hypot(mean_1 + sigma_1 * z[:, None], mean_2 + sigma_2 * z)
    mean = weight @ length @ weight
    return mean, weight @ (length - mean) ** 2 @ weight


@pytest.mark.parametrize("signal", RICE)
def test_equal_deviations(signal):
    excess, variance = rice_moments(np.array([signal]), np.zeros(1), np.ones(1), np.ones(1))
    np.testing.assert_allclose(signal + excess, RICE[signal][0], rtol=1e-14)
    np.testing.assert_allclose(np.sqrt(variance), RICE[signal][1], rtol=1e-13)


@pytest.mark.parametrize("where", [(4.0, 1.0), (0.0, 6.0), (9.9, 0.5), (10.1, 0.5), (7.0, 7.2)])
def test_unequal_deviations(where):
    excess, variance = rice_moments(np.array([where[0]]), np.array([where[1]]), np.ones(1), np.full(1, 0.4))
    mean, expected = _sampled(*where, 1.0, 0.4)
    # The kink at the origin costs the grid (step / distance)^2 times the density there, below 1e-8 at 4 sigma.
    np.testing.assert_allclose(np.hypot(*where) + excess, mean, rtol=1e-9)
    np.testing.assert_allclose(variance, expected, rtol=1e-8)


def test_both_rules_meet():
    means = 10.0 * (1.0 + np.array([-1e-13, 1e-13]))
    excess, variance = rice_moments(means, np.zeros(2), np.ones(2), np.full(2, 0.7))
    # The Hermite rule with 12 nodes has an error of 1e-13 of the deviation here.
    np.testing.assert_allclose(excess[0], excess[1], rtol=1e-11)
    np.testing.assert_allclose(variance[0], variance[1], rtol=1e-11)


def test_line_is_a_folded_normal():
    excess, variance = rice_moments(np.zeros(1), np.zeros(1), np.ones(1), np.zeros(1))
    np.testing.assert_allclose(excess, np.sqrt(2.0 / np.pi), rtol=1e-14)
    np.testing.assert_allclose(variance, 1.0 - 2.0 / np.pi, rtol=1e-13)


def test_no_fluctuation():
    excess, variance = rice_moments(np.array([3.0]), np.array([4.0]), np.zeros(1), np.zeros(1))
    assert (excess[0], variance[0]) == (0.0, 0.0)
