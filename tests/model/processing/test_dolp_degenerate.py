import numpy as np
import pytest
from scipy.special import ndtr

from model.processing import dolp

MEAN = np.array([1.0, 0.3, 0.1])


def test_common_factor_leaves_one_value():
    cov = 0.01 * np.outer(MEAN, MEAN)
    np.testing.assert_allclose(dolp.quantile([0.01, 0.5, 0.99], MEAN, cov), np.hypot(0.3, 0.1), rtol=1e-8)


def test_no_fluctuation_leaves_one_value():
    np.testing.assert_array_equal(dolp.cdf([0.31, 0.32], MEAN, np.zeros((3, 3))), [0.0, 1.0])


def test_line_of_fluctuation_against_sampling_the_line():
    direction = np.array([0.1, 0.05, -0.02])
    z = np.linspace(-9.9, 12.0, 2_000_001)
    points = MEAN + z[:, None] * direction
    degree = np.hypot(points[:, 1], points[:, 2]) / points[:, 0]
    weight = np.exp(-0.5 * z**2)
    x = np.array([0.35, 0.4, 0.6])
    expected = [np.sum(weight[degree <= value]) / np.sum(weight) for value in x]
    # One step of the line carries up to 1.1e-5 / sqrt(2 pi) of the probability, and there are two ends.
    np.testing.assert_allclose(dolp.cdf(x, MEAN, np.outer(direction, direction)), expected, atol=1e-5)


def test_s0_and_one_direction_without_noise_is_a_normal_interval():
    cov = np.diag([0.0, 0.01, 0.0])
    half = np.sqrt(0.25**2 - 0.2**2)
    expected = ndtr((half - 0.3) / 0.1) - ndtr((-half - 0.3) / 0.1)
    np.testing.assert_allclose(dolp.cdf(0.25, (1.0, 0.3, 0.2), cov), expected, rtol=1e-14)


def test_dolp_below_the_fixed_component_is_impossible():
    assert dolp.cdf(0.19, (1.0, 0.3, 0.2), np.diag([0.0, 0.01, 0.0])) == 0.0


@pytest.mark.parametrize("x", [0.05, 0.2, 0.3, 0.5])
def test_plane_through_zero_is_the_limit_of_a_thin_law(x):
    cov = np.diag([0.01, 0.01, 0.0])
    # Width 1e-5 across changes the law by about (1e-5 / 0.05)^2.
    thin = cov + np.diag([0.0, 0.0, 1e-10])
    np.testing.assert_allclose(dolp.cdf(x, (1.0, 0.3, 0.0), cov), dolp.cdf(x, (1.0, 0.3, 0.0), thin), rtol=1e-7)


def test_plane_through_zero_has_small_quantiles_in_proportion():
    found = dolp.quantile([1e-12, 1e-9], (1.0, 0.0, 0.0), np.diag([0.01, 0.01, 0.0]))
    # The density of |S1| / S0 is flat at zero.
    np.testing.assert_allclose(found[1] / found[0], 1e3, rtol=1e-9)


def test_rounding_of_a_singular_covariance_does_not_matter():
    factor = np.array([[0.1, 0.02], [0.03, 0.05], [0.01, 0.04]])
    cov = factor @ factor.T
    nudged = cov + 1e-18 * np.eye(3)
    x = np.array([0.25, 0.3, 0.5])
    # The width across of 1e-9 enters in square.
    np.testing.assert_allclose(dolp.cdf(x, MEAN, cov), dolp.cdf(x, MEAN, nudged), rtol=1e-9)
