import numpy as np
import pytest

from model.moments import Moments
from model.processing.reconstruction import channel_ratios


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


def test_no_light_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        channel_ratios(Moments(mean=np.zeros(3), cov=np.eye(3)))
