"""The law of DoLP: references, both tails, singular covariances."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from model.processing import dolp
from model.processing.dolp_law import product
from tests.model.oracles import covariance, dolp_tails
from tests.model.processing.dolp_reference import case_id, dolp_cases

# What the reference gives: 20 digits, but 2e-11 where the SNR of S0 is below 8.
LOW_SNR_DIGITS = 4e-11


def _case_tolerance(case):
    return 1e-12 if case["mean"] is not None else LOW_SNR_DIGITS


@pytest.mark.parametrize("case", dolp_cases(), ids=case_id)
def test_quantiles_of_the_reference(case):
    probability = [float(p) for p in case["quantiles"]]
    expected = np.array([float(x) for x in case["quantiles"].values()])
    # At SNR 1e6 the input mean alone, rounded, moves a quantile by 1e-16 of its value.
    found = dolp.quantile(probability, case["stokes"], case["cov"])
    np.testing.assert_allclose(found, expected, rtol=_case_tolerance(case))


@pytest.mark.parametrize("case", dolp_cases(), ids=case_id)
def test_cdf_returns_the_probabilities_of_the_reference(case):
    probability = np.array([float(p) for p in case["quantiles"]])
    x = np.array([float(x) for x in case["quantiles"].values()])
    # A quantile rounded to a double moves the cdf by x f(x) 1e-16, up to 1e-10 at SNR 1e6.
    slack = (
        x * dolp.pdf(x, case["stokes"], case["cov"]) * max(1e-15, _case_tolerance(case) if case["mean"] is None else 0)
    )
    found = dolp.cdf(x, case["stokes"], case["cov"])
    assert np.all(np.abs(found - probability) <= 1e-13 * probability + slack)


NASTY = {
    "low SNR, lower tail": ((1.0, 0.1, 0.05), covariance((0.3, 0.4, 0.4)), 1e-3),
    "low SNR, upper tail": ((1.0, 0.1, 0.05), covariance((0.3, 0.4, 0.4)), 30.0),
    "SNR 0.1": ((1.0, 0.3, 0.1), covariance((10.0, 8.0, 5.0), r01=0.3), 1.0),
    "thin ellipse": ((1.0, 0.3, 0.05), covariance((0.1, 0.1, 1e-7), psi_deg=20.0), 0.2),
    "thin ellipse, tilted": ((1.0, 0.3, 0.0), covariance((0.01, 0.02, 1e-8), psi_deg=15.0), 0.2),
    "thin across the mean": ((1.0, 0.3, 0.0), covariance((0.01, 1e-7, 0.05)), 0.2999999),
    "correlation .9999": ((1.0, 0.3, 0.1), covariance((0.12, 0.08, 0.05), r01=0.9999, psi_deg=10.0), 0.1),
    "correlation -.9999": ((1.0, 0.3, 0.1), covariance((0.12, 0.08, 0.05), r01=-0.9999), 0.6),
    "mean far behind the apex's shadow": ((1.0, 0.5, 0.0), covariance((1 / 3, 0.1, 0.1), r01=0.97), 0.01),
    "SNR 8.01, fully polarized": ((1.0, 1.0, 0.0), covariance((1 / 8.01, 1 / 8.01, 0.1), r01=0.9), 0.5),
    "SNR 8.01, upper tail": ((1.0, 0.05, 0.0), covariance((1 / 8.01, 0.1, 0.1), r01=0.5), 0.9),
    "S0 without noise": ((1.0, 0.3, 0.0), covariance((0.0, 0.1, 0.05), r12=0.3), 0.5),
    "mean of S0 negative": ((-1.0, 0.3, 0.0), covariance((0.5, 0.5, 0.6), r01=0.7), 5.0),
    "no light at all": ((0.0, 0.0, 0.0), covariance((0.5, 0.5, 0.6), r01=0.7), 0.3),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NASTY)
def test_both_tails_against_the_double_integral(name):
    mean, cov, x = NASTY[name]
    lower, upper = dolp_tails(mean, cov, x)
    # The oracle is good to about 1e-12 in the worst of these (thin, tilted: rounding of a ratio of 1e6).
    np.testing.assert_allclose(dolp.cdf(x, mean, cov), lower, rtol=2e-11)
    np.testing.assert_allclose(dolp.probability_above(x, mean, cov), upper, rtol=2e-11)


@pytest.mark.parametrize("p", [1e-300, 1e-12, 1e-3, 0.5, 1.0 - 1e-3, 1.0 - 1e-12])
@pytest.mark.parametrize(
    ("mean", "cov"),
    [
        ((1.0, 0.3, 0.1), covariance((0.1, 0.14, 0.1))),
        ((1.0, 0.05, 0.0), covariance((1.0, 1.0, 1.0))),
        ((1.0, 0.5, 0.0), covariance((1 / 8.01, 1 / 8.01, 1 / 8.01))),
        ((1.0, 1e-6, 0.0), covariance((1e-6, 1.4e-6, 1.4e-6))),
        ((1.0, 1.0, 0.0), covariance((1e-6, 1e-6, 1e-6), r01=0.5)),
    ],
)
def test_quantile_inverts_the_tails_far_out(p, mean, cov):
    x = dolp.quantile(p, mean, cov)
    tails = dolp.distribution_tails(x, mean, cov)
    smaller = tails.lower / p if p <= 0.5 else tails.upper / (1.0 - p)
    # The search runs over log x, up to 700 in size: rounding 1e-13. Rounding of x alone changes the tail by
    # 1e-16 x f / tail, 1e-9 at SNR 1e6.
    assert abs(smaller - 1.0) < 1e-12 + 4e-16 * abs(x * tails.density / min(tails.lower, tails.upper))


# A needle 1e-5 as thick as long that crosses the cone twice: two peaks 3e-6 wide on the border.
NEEDLE_MEAN = (1.0, -2.886512283280837e-07, 9.57434315441372e-07)
NEEDLE_COV = np.array(
    [
        [1.0475518565396937e-12, -3.868902352686666e-13, 4.430232276328773e-13],
        [-3.868902352686666e-13, 1.4288939799347293e-13, -1.6362088396247595e-13],
        [4.430232276328773e-13, -1.6362088396247595e-13, 1.873602523949511e-13],
    ]
)


@pytest.mark.parametrize(
    ("x", "lower", "upper", "digits"),
    [
        # Beside its closest approach the tail changes 2e5 times as fast as x; places along so thin a needle are
        # known to some 1e-13, in the oracle as well.
        (4.1236e-7, 7.134953514e-05, 9.9992865046485e-01, 1e-7),
        (4.1384e-7, 1.3815884848659e-02, 9.8618411515135e-01, 1e-10),
        (2.2e-6, 9.8519002520448e-01, 1.4809974795272e-02, 1e-10),
    ],
)
def test_needle_loses_neither_of_its_two_peaks(x, lower, upper, digits):
    # Both from the double integral of the oracles, which takes half a minute here.
    np.testing.assert_allclose(dolp.cdf(x, NEEDLE_MEAN, NEEDLE_COV), lower, rtol=digits)
    np.testing.assert_allclose(dolp.probability_above(x, NEEDLE_MEAN, NEEDLE_COV), upper, rtol=digits)


def test_search_for_a_quantile_ends_where_newton_would_cycle():
    cov = [[78.0, 29.0, 74.1], [29.0, 195.1, -225.0], [74.1, -225.0, 416.85]]
    x = dolp.quantile(0.025, (1.0, 0.0, 0.0), cov)
    np.testing.assert_allclose(dolp.cdf(x, (1.0, 0.0, 0.0), cov), 0.025, rtol=1e-10)


def test_low_signal_with_a_singular_covariance_has_both_far_tails():
    factor = np.array([[1.5, 0.3], [-0.2, 0.9], [0.4, -0.7]])
    p = np.array([1e-12, 1.0 - 1e-9])
    mean = (1.0, 0.27, 0.12)
    found = dolp.distribution_tails(dolp.quantile(p, mean, factor @ factor.T), mean, factor @ factor.T)
    np.testing.assert_allclose([found.lower[0] / p[0], found.upper[1] / (1.0 - p[1])], 1.0, rtol=1e-9)


def test_density_is_the_derivative_of_the_cdf():
    mean, cov = (1.0, 0.4, 0.1), covariance((0.2, 0.2, 0.05), r01=0.6, psi_deg=30.0)
    x, step = np.linspace(0.05, 1.5, 15), 1e-4
    # Central difference of fourth order: its error is (step / width)^4 / 30, about 1e-11.
    c = [dolp.cdf(x + k * step, mean, cov) for k in (-2, -1, 1, 2)]
    slope = (c[0] - 8.0 * c[1] + 8.0 * c[2] - c[3]) / (12.0 * step)
    np.testing.assert_allclose(dolp.pdf(x, mean, cov), slope, rtol=1e-7, atol=1e-11)


@settings(deadline=None, max_examples=20)
@given(angle=st.floats(-3.0, 3.0), x=st.floats(0.01, 2.0))
def test_turning_the_axes_changes_nothing(angle, x):
    mean, cov = np.array([1.0, 0.3, 0.1]), covariance((0.3, 0.2, 0.02), r01=0.8, psi_deg=12.0)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    turned = turn @ cov @ turn.T
    # The thin axis has 1e-2 of the variance's root: rounding of the turned covariance enters as 1e-16 1e4.
    np.testing.assert_allclose(dolp.cdf(x, turn @ mean, 0.5 * (turned + turned.T)), dolp.cdf(x, mean, cov), rtol=1e-11)


@settings(deadline=None, max_examples=20)
@given(exponent=st.floats(-9.0, 9.0), x=st.floats(0.01, 2.0))
def test_unit_of_the_stokes_parameters_changes_nothing(exponent, x):
    mean, cov = np.array([1.0, 0.3, 0.1]), covariance((0.3, 0.2, 0.1), r01=0.8, psi_deg=12.0)
    k = 10.0**exponent
    np.testing.assert_allclose(dolp.cdf(x, k * mean, k * k * cov), dolp.cdf(x, mean, cov), rtol=1e-12)


@pytest.mark.parametrize("bad", [-0.1, 1.1, np.nan])
def test_probability_outside_of_its_range_is_refused(bad):
    with pytest.raises(ValueError, match="allowed is 0 to 1"):
        dolp.quantile(bad, (1.0, 0.1, 0.0), np.eye(3))


def test_s0_that_is_never_positive_is_refused():
    with pytest.raises(ValueError, match="no probability"):
        dolp.cdf(0.5, (-1.0, 0.1, 0.0), np.diag([0.0, 1.0, 1.0]))


def test_value_that_is_not_a_number_is_refused():
    with pytest.raises(ValueError, match="not a number"):
        dolp.cdf(np.nan, (1.0, 0.1, 0.0), np.eye(3))


MEAN = np.array([1.0, 0.3, 0.1])


def test_common_factor_leaves_one_value():
    cov = 0.01 * np.outer(MEAN, MEAN)
    np.testing.assert_allclose(dolp.quantile([0.01, 0.5, 0.99], MEAN, cov), np.hypot(0.3, 0.1), rtol=1e-8)


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


number = st.floats(-1e20, 1e20).filter(lambda value: value == 0.0 or abs(value) > 1e-20)


@settings(deadline=None)
@given(number, number, number, number)
def test_difference_of_products_keeps_its_digits(a, b, c, d):
    found = (product(np.array(a), np.array(b)) - product(np.array(c), np.array(d))).value
    exact = Fraction(a) * Fraction(b) - Fraction(c) * Fraction(d)
    size = abs(Fraction(a) * Fraction(b)) + abs(Fraction(c) * Fraction(d))
    # Twice the precision: 2^-104 of the terms, and the rounding of the result.
    assert abs(Fraction(float(found)) - exact) <= abs(exact) * Fraction(2) ** -52 + size * Fraction(2) ** -100


@settings(deadline=None)
@given(number, number)
def test_product_of_sums_keeps_its_digits(first, second):
    a, b = product(np.array(first), np.array(1.1)), product(np.array(second), np.array(0.7))
    exact = Fraction(first) * Fraction(1.1) * Fraction(second) * Fraction(0.7)
    assert abs(Fraction(float((a * b).value)) - exact) <= abs(exact) * Fraction(2) ** -52
