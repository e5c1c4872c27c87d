"""Moments of DoLP against references of many digits, sampling and the law itself."""

import numpy as np
import pytest

from model.processing import dolp
from model.processing.dolp import rice_moments, second_order
from tests.model.oracles import covariance
from tests.model.processing.dolp_reference import case_id, dolp_cases

WITH_MOMENTS = dolp_cases(with_moments=True)
# First order is 0/0 at DoLP = 0.
POLARIZED = [case for case in dolp_cases() if case["p"] > 0.0]


@pytest.mark.parametrize("case", WITH_MOMENTS, ids=case_id)
def test_exact_moments_of_the_reference(case):
    found = dolp.moments(case["stokes"], case["cov"], tolerance=1e-12)
    # The reference holds to 2e-13 in the mean and 3e-11 in the deviation at its worst, an SNR of S0 of 8.
    np.testing.assert_allclose(found.mean, float(case["mean"]), rtol=1e-12)
    np.testing.assert_allclose(found.std, float(case["std"]), rtol=1e-11)


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-4, 1e-9])
@pytest.mark.parametrize("case", WITH_MOMENTS, ids=case_id)
def test_error_is_within_the_tolerance_and_twice_its_estimate(case, tolerance):
    found = dolp.moments(case["stokes"], case["cov"], tolerance=tolerance)
    for value, error, exact in (
        (found.mean, found.mean_error, float(case["mean"])),
        (found.std, found.std_error, float(case["std"])),
    ):
        assert abs(value - exact) <= tolerance * exact
        assert abs(value - exact) <= 2.0 * error + 4e-15 * exact


@pytest.mark.parametrize("case", POLARIZED, ids=case_id)
def test_first_order_of_the_reference(case):
    found = dolp.first_order(case["stokes"], case["cov"])
    np.testing.assert_allclose(found.mean, float(case["first_order"][0]), rtol=1e-15)
    # Texture cancels four digits of the variance.
    np.testing.assert_allclose(np.sqrt(found.variance), float(case["first_order"][1]), rtol=1e-14 * 20)


@pytest.mark.parametrize("case", [c for c in POLARIZED if c["second_order"][1] is not None], ids=case_id)
def test_second_order_of_the_reference(case):
    found = second_order(case["stokes"], case["cov"])
    np.testing.assert_allclose(found.mean, float(case["second_order"][0]), rtol=1e-14)
    # At a Q of 0.7 standard deviations the terms are 1e5 times their sum.
    np.testing.assert_allclose(np.sqrt(found.variance), float(case["second_order"][1]), rtol=1e-8)


def test_second_order_variance_that_is_negative_falls_through_to_quadrature():
    mean, cov = (1.0, 0.05, 0.0), np.diag([0.01, 0.02, 0.02])
    assert second_order(mean, cov).variance < 0.0
    assert dolp.moments(mean, cov, tolerance=0.5).method == "quadrature"


@pytest.mark.parametrize(("mean", "method"), [((1.0, 0.3, 0.1), "first order"), ((1.0, 0.001, 0.0), "quadrature")])
def test_cheapest_way_that_meets_the_tolerance_is_taken(mean, method):
    assert dolp.moments(mean, 1e-6 * np.eye(3), tolerance=1e-4).method == method


# Mean and deviation over sigma of a Rice variable, at mean over sigma of the key: 18 digits.
RICE = {
    0.0: (1.25331413731550025, 0.655136377562033553),
    1.0: (1.54857246055114538, 0.775837182933746276),
    3.0: (3.17257728790071783, 0.966826433387361306),
    10.0: (10.0501269366774211, 0.997471080618839767),
}


@pytest.mark.parametrize("signal", RICE)
def test_known_intensity_gives_rice_moments(signal):
    found = dolp.moments((1.0, 1e-3 * signal, 0.0), np.diag([0.0, 1e-6, 1e-6]), tolerance=1e-12)
    np.testing.assert_allclose(found.mean, 1e-3 * RICE[signal][0], rtol=1e-12)
    np.testing.assert_allclose(found.std, 1e-3 * RICE[signal][1], rtol=1e-12)


def test_thin_unpolarized_law_is_half_normal_over_the_intensity():
    # E|S1| = 0.1 sqrt(2 / pi), and the finite parts of E[1/S0] and E[1/S0^2] at SNR 10 in 18 digits.
    inverse, inverse_square = 1.01031615649185989, 1.03156164918598872
    found = dolp.moments((1.0, 0.0, 0.0), np.diag([0.01, 0.01, 1e-18]))
    mean = 0.1 * np.sqrt(2.0 / np.pi) * inverse
    np.testing.assert_allclose(found.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(found.std, np.sqrt(0.01 * inverse_square - mean**2), rtol=2e-4)


def _by_law(mean, cov):
    """Mean and deviation as integrals of the tails about the median: unrelated to the moment rule."""
    levels = np.array([1e-300, 1e-100, 1e-40, 1e-25, 1e-18, 1e-14, 1e-10, 1e-7, 1e-5, 1e-3, 0.02, 0.1, 0.3, 0.5])
    low = dolp.quantile(levels, mean, cov)
    ends = np.unique(np.concatenate([[0.0], low, dolp.quantile(1.0 - levels[5:], mean, cov)]))
    nodes, weights = np.polynomial.legendre.leggauss(16)
    half = 0.5 * np.diff(ends)[:, None]
    x, w = (0.5 * (ends[:-1] + ends[1:])[:, None] + half * nodes).ravel(), (half * weights).ravel()
    tails = dolp.distribution_tails(x, mean, cov)
    tail = np.where(x < low[-1], -tails.lower, tails.upper)
    shift = np.sum(w * tail)
    return low[-1] + shift, np.sqrt(np.sum(2.0 * w * (x - low[-1]) * tail) - shift**2)


def _texture(noise):
    mean = np.array([1.0, 0.2, 0.4 * np.sqrt(3.0) / 2.0])
    return mean, np.outer(mean, mean) / 8.01**2 + noise**2 * np.eye(3)


NASTY = {
    "correlation .95": ((1.0, 0.3, 0.1), covariance((0.1, 0.08, 0.05), r01=0.95, psi_deg=10.0)),
    "correlation .9999": ((1.0, 0.3, 0.1), covariance((0.1, 0.08, 0.05), r01=0.9999, psi_deg=10.0)),
    "correlation -.9999, DoLP 1": ((1.0, 1.0, 0.0), covariance((0.1, 0.1, 0.05), r01=-0.9999)),
    "thin ellipse": ((1.0, 0.3, 0.05), covariance((0.1, 0.1, 1e-7), psi_deg=20.0)),
    "SNR 8.01": ((1.0, 0.05, 0.0), covariance((1 / 8.01, 0.1, 0.1), r01=0.5)),
    "SNR 8.01, DoLP 1": ((1.0, 1.0, 0.0), covariance((1 / 8.01, 0.17, 0.17), r01=-0.7)),
    "DoLP 1e-6": ((1.0, 1e-6, 0.0), covariance((1e-4, 1e-7, 2e-7), r01=0.3)),
    "texture and little noise": _texture(1e-3),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NASTY)
def test_hard_moments_against_the_law(name):
    mean, cov = NASTY[name]
    found = dolp.moments(mean, cov)
    expected_mean, expected_std = _by_law(mean, cov)
    # The oracle ends at the quantile 1 - 1e-14: at SNR 8 it misses 4e-11 of the deviation.
    np.testing.assert_allclose(found.mean, expected_mean, rtol=1e-11)
    np.testing.assert_allclose(found.std, expected_std, rtol=1e-10)


def test_continuous_at_unpolarized_light():
    means = np.array([[1.0, p, 0.0] for p in (0.0, 1e-12, 1e-9)])
    found = dolp.moments(means, np.diag([0.01, 0.01, 0.01]))
    # DoLP enters in square: (1e-9 / 0.1)^2.
    np.testing.assert_allclose(found.mean, found.mean[0], rtol=1e-14)
    np.testing.assert_allclose(found.std, found.std[0], rtol=1e-13)


def test_common_factor_alone_leaves_no_variance():
    mean = np.array([1.0, 0.3, 0.1])
    found = dolp.moments(mean, 0.0025 * np.outer(mean, mean))
    assert found.std**2 <= 1e-14
    np.testing.assert_allclose(found.mean, np.hypot(0.3, 0.1), rtol=1e-14)


@pytest.mark.parametrize("snr", [0.1, 1.0, 3.0, 6.0])
def test_moments_are_refused_where_s0_comes_close_to_zero(snr):
    found = dolp.moments((1.0, 0.3, 0.0), np.eye(3) / snr**2)
    assert not found.exists
    assert np.isnan(found.mean)
    assert np.isnan(found.std)
    assert "not bounded away from 0" in found.reason


def test_existence_depends_on_the_tolerance():
    # At SNR 5 the mean is uncertain by SNR phi(SNR) ln 100 = 3e-5, the deviation by about 1e-3.
    cov = np.eye(3) / 25.0
    assert dolp.moments((1.0, 0.3, 0.0), cov, tolerance=1e-2).exists
    assert not dolp.moments((1.0, 0.3, 0.0), cov, tolerance=1e-6).exists
    assert not dolp.moments((1.0, 0.3, 0.0), cov, tolerance=1e-2, existing_to=1e-6).exists
    assert dolp.moments((1.0, 0.3, 0.0), cov, tolerance=1e-2, existing_to=0.1).exists


def test_regions_are_computed_together_as_apart():
    means = np.array([[1.0, 0.3, 0.0], [1.0, 0.001, 0.0], [1.0, 0.1, 0.9], [1.0, 0.0, 0.0]])
    covs = np.array([1e-2, 1e-6, 1e-3, 0.2])[:, None, None] * np.eye(3)
    together = dolp.moments(means, covs)
    for index in range(4):
        apart = dolp.moments(means[index], covs[index])
        np.testing.assert_allclose(together.std[index], apart.std, rtol=1e-14)
        assert together.method[index] == apart.method
    assert together.exists.tolist() == [True, True, True, False]


def test_covariance_that_is_none_is_refused():
    with pytest.raises(ValueError, match="not positive semi-definite"):
        dolp.moments((1.0, 0.3, 0.0), np.diag([1.0, 1.0, -1e-3]))


def test_tolerance_must_be_positive():
    with pytest.raises(ValueError, match="tolerance"):
        dolp.moments((1.0, 0.3, 0.0), np.eye(3), tolerance=0.0)


def _sampled(mean_1, mean_2, sigma_1, sigma_2):
    """Double trapezoidal rule on a fine grid: exact to rounding for smooth integrands."""
    z = np.linspace(-9.0, 9.0, 2881)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()
    length = np.hypot(mean_1 + sigma_1 * z[:, None], mean_2 + sigma_2 * z)
    mean = weight @ length @ weight
    return mean, weight @ (length - mean) ** 2 @ weight


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
