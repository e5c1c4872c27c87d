"""DoLP against SNR, estimators, laws of normalized Stokes parameters, drawn ROC."""

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ndtr

from model.processing import dolp
from model.processing.detection import rx_p_detection
from model.processing.dolp_studies import (
    ESTIMATORS,
    Estimator,
    bias_and_rms,
    dolp_against_snr,
    normalized_density,
    poisson_dolp,
    rx_draws,
    true_snr,
)
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, design
from tests.model.oracles import covariance

PAPER = np.array([1.0, 0.5, 0.5])
PLAN = design(MODIFIED_PICKERING_RAD)


def _study(snr, draws=40_000, seed=1):
    return dolp_against_snr(PAPER, snr, draws=draws, generator=np.random.default_rng(seed))


def test_true_moments_meet_the_draws_and_the_first_order_is_biased_at_20_db():
    draws = 400_000
    found = _study([10.0, 30.0, 100.0], draws=draws)
    mean_error = found.true_std / np.sqrt(draws)
    assert np.all(np.abs(found.true_mean - found.drawn_mean) < 4.0 * mean_error)
    # The law is close to normal, for which the deviation of n draws has a relative error of 1/sqrt(2 n).
    assert np.all(np.abs(found.true_std / found.drawn_std - 1.0) < 5.0 / np.sqrt(2.0 * draws))
    assert abs(found.first_mean[0] - found.drawn_mean[0]) > 20.0 * mean_error[0]


def test_above_the_last_sum_the_law_of_poisson_counts_is_carried_on_from_the_gaussian_law():
    snr = 10.0 ** (np.array([18.0, 20.0, 20.02]) / 20.0)
    found = _study(snr, draws=10)
    light = PAPER * snr[:, None] ** 2 / 2.0
    gaussian = dolp.moments(light, [PLAN.inverse @ np.diag(PLAN.system @ one) @ PLAN.inverse.T for one in light])
    for true, error, limit in (
        (found.true_mean, found.true_mean_error, gaussian.mean),
        (found.true_std, found.true_std_error, gaussian.std),
    ):
        _, summed, carried = true - limit
        # 0.02 dB are 0.46 % of the electrons, and the difference falls with their square at most.
        assert 0.99 < carried / summed < 0.996
        assert abs(carried) > 3.0 * error[2] > 0.0


def test_with_fewer_than_two_sums_the_error_of_the_gaussian_law_is_not_known():
    found = _study([100.0], draws=10)
    assert np.isfinite(found.true_mean[0])
    assert np.isnan(found.true_mean_error[0])


# bias and rms error in units of the noise at these true values, to the digits that quadrature gave independently
TRUE = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0])
TABLE: dict[Estimator, tuple[list[float], list[float]]] = {
    "naive": (
        [1.253, 0.830, 0.549, 0.272, 0.173, 0.101, 0.063],
        [1.414, 1.081, 0.950, 0.954, 0.982, 0.995, 0.998],
    ),
    "asymptotic": (
        [0.760, 0.354, 0.118, -0.024, -0.016, -0.002, -0.001],
        [1.101, 0.915, 0.951, 1.064, 1.049, 1.012, 1.004],
    ),
    "wardle_kronberg": (
        [0.819, 0.413, 0.176, 0.019, 0.003, 0.000, 0.0],
        [1.155, 0.950, 0.959, 1.040, 1.029, 1.010, 1.004],
    ),
    "maximum_likelihood": (
        [0.541, 0.137, -0.088, -0.153, -0.060, -0.005, -0.001],
        [0.979, 0.891, 1.024, 1.199, 1.120, 1.015, 1.004],
    ),
    "mean": (
        [0.612, 0.207, -0.021, -0.112, -0.049, -0.006, -0.001],
        [1.013, 0.890, 0.990, 1.146, 1.095, 1.015, 1.004],
    ),
    "median": (
        [0.674, 0.270, 0.042, -0.066, -0.029, -0.003, -0.001],
        [1.059, 0.911, 0.983, 1.112, 1.071, 1.013, 1.004],
    ),
    "mas": (
        [0.988, 0.567, 0.292, 0.051, 0.002, -0.001, 0.0],
        [1.186, 0.901, 0.851, 0.968, 1.017, 1.011, 1.004],
    ),
}
# a printed third decimal: half a unit, and one hundredth of it for those that end in 5
PRINTED = 5.1e-4
INVERTED: list[Estimator] = ["wardle_kronberg", "maximum_likelihood", "mean", "median"]
MEASURED = [1.42, 1.6, 2.5, 7.0, 40.0, 200.0]


def bessel_ratio(y: mp.mpf) -> mp.mpf:
    return mp.besseli(1, y) / mp.besseli(0, y)


def defect(estimator: Estimator, r: mp.mpf, v: mp.mpf) -> mp.mpf:
    """What the defining equation of an estimator leaves, per unit of v."""
    if estimator == "wardle_kronberg":
        return 1 / r - r + v * bessel_ratio(r * v)
    if estimator == "maximum_likelihood":
        return v - r * bessel_ratio(r * v)
    if estimator == "mean":
        x = v**2 / 4
        ends = (1 + 2 * x) * mp.besseli(0, x) + 2 * x * mp.besseli(1, x)
        return mp.sqrt(mp.pi / 2) * mp.exp(-x) * ends - r
    density = lambda t: t * mp.exp(-((t - v) ** 2) / 2) * mp.besseli(0, t * v) * mp.exp(-t * v)  # noqa: E731
    below = mp.quad(density, [max(mp.mpf(0), v - 12), max(mp.mpf(0), v - 4), v, r])
    return (mp.mpf(1) / 2 - below) / density(r)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_bias_and_rms_table(estimator: Estimator) -> None:
    found = bias_and_rms(estimator, TRUE)
    assert_allclose(found.bias, TABLE[estimator][0], rtol=0.0, atol=PRINTED)
    assert_allclose(found.rms, TABLE[estimator][1], rtol=0.0, atol=PRINTED)


@pytest.mark.parametrize("estimator", INVERTED)
@pytest.mark.parametrize("measured", MEASURED)
def test_defining_equation(estimator: Estimator, measured: float) -> None:
    with mp.workdps(25):
        r, v = mp.mpf(measured), mp.mpf(float(true_snr(measured, estimator)))
        step = mp.mpf("1e-8")
        slope = (defect(estimator, r, v + step) - defect(estimator, r, v - step)) / (2 * step)
        # the spline's error in (v/r)^2 is 1e-11 at most, twice that over v/r in v
        assert abs(float(defect(estimator, r, v) / slope)) < 1e-9


@pytest.mark.parametrize("estimator", INVERTED)
def test_interpolation_error_is_far_below_what_is_promised(estimator: Estimator) -> None:
    # at thrice the nodes the neighbours of a spline's knots show its error; the curve is smooth, so a cubic through
    # four fine points is exact to 1e-13 and differs from the spline by the spline's own error
    u = np.linspace(0.02, 0.4, 4001)
    share = (true_snr(u**-0.5, estimator) * np.sqrt(u)) ** 2
    fourth = np.abs(share[4:] - 4.0 * share[3:-1] + 6.0 * share[2:-2] - 4.0 * share[1:-3] + share[:-4])
    assert np.max(fourth) < 1e-9


@pytest.mark.parametrize(
    ("estimator", "threshold"),
    [
        ("asymptotic", 1.0),
        ("wardle_kronberg", 1.0),
        ("maximum_likelihood", 1.414214),
        ("mean", 1.253314),
        ("median", 1.177410),
    ],
)
def test_zero_thresholds(estimator: Estimator, threshold: float) -> None:
    found = true_snr([0.0, threshold - 1e-6, threshold + 1e-6, threshold + 1e-3], estimator)
    assert found[0] == found[1] == 0.0
    assert 0.0 < found[2] < found[3] < 0.2


@pytest.mark.parametrize("estimator", ESTIMATORS[1:])
def test_far_from_zero_the_excess_of_the_square_is_taken_off(estimator: Estimator) -> None:
    # all but the naive one tend to r - 1/(2 r), up to r^-3
    r = np.array([30.0, 1e3, 1e6])
    # r^-3 times a constant of order one, and the rounding of r
    assert_allclose(true_snr(r, estimator), r - 0.5 / r, rtol=1e-15, atol=2.0 / r[0] ** 3)


def test_far_from_zero_bias_and_rms_stay_exact() -> None:
    found = bias_and_rms("naive", [1e4])
    assert_allclose(found.bias, 0.5e-4, rtol=1e-6)
    assert_allclose(found.rms, 1.0, rtol=1e-8)


def light_of(snr: float) -> np.ndarray:
    # Four ideal channels of pairs: var S0 = S0 / 2.
    return PAPER * snr**2 / 2.0


@pytest.mark.parametrize(("decibel", "mean", "std"), [(0.0, 1.6995, 0.5442), (10.0, 0.8758, 0.3585)])
def test_moments_are_those_of_the_plain_sum_at_0_and_10_db(decibel, mean, std):
    assert poisson_dolp(PLAN, light_of(10.0 ** (decibel / 20.0))) == pytest.approx((mean, std), abs=6e-5)


def test_no_sum_over_too_many_counts():
    assert poisson_dolp(PLAN, PAPER * 1e4) is None


MEAN = np.array([1.0, 0.3, 0.1])
COV = covariance((0.5, 0.22, 0.14), r01=0.4, r02=-0.3)


def _cdf(x, component):
    """Pr(S_k <= x S0 | S0 > 0) with the inner integral closed and the outer one by a fine Gauss-Legendre rule."""
    slope = COV[component, 0] / COV[0, 0]
    own = np.sqrt(COV[component, component] - slope * COV[component, 0])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    s0 = 3.0 * (nodes + 1.0)
    bell = np.exp(-0.5 * ((s0 - 1.0) / 0.5) ** 2) / (0.5 * np.sqrt(2.0 * np.pi))
    inner = ndtr((x * s0 - MEAN[component] - slope * (s0 - 1.0)) / own)
    return np.sum(3.0 * weights * bell * inner) / ndtr(2.0)


@pytest.mark.parametrize("component", [1, 2])
@pytest.mark.parametrize("x", [-3.0, -0.2, 0.3, 1.0])
def test_density_is_the_slope_of_the_double_integral(x, component):
    step = 1e-4
    # Differences of four places leave errors of step^4; rounding leaves 1e-15 / step.
    slope = (8.0 * (_cdf(x + step, component) - _cdf(x - step, component))) / (12.0 * step)
    slope -= (_cdf(x + 2.0 * step, component) - _cdf(x - 2.0 * step, component)) / (12.0 * step)
    assert_allclose(normalized_density(x, MEAN, COV, component=component), slope, rtol=1e-8, atol=1e-11)


def test_known_intensity_leaves_a_normal_law():
    found = normalized_density([0.05, 0.35], (2.0, 0.3, 0.1), np.diag([0.0, 0.04, 0.09]), component=2)
    assert_allclose(found, np.exp([0.0, -2.0]) / (0.15 * np.sqrt(2.0 * np.pi)), rtol=1e-13)


def test_high_signal_to_noise_keeps_the_width():
    # First order: sqrt(1 + 0.3^2) 1e-6; the next order is 1e-6 of it.
    width = np.sqrt(1.09) * 1e-6
    found = normalized_density(0.3, (1.0, 0.3, 0.1), 1e-12 * np.eye(3), component=1)
    assert_allclose(found, 1.0 / (width * np.sqrt(2.0 * np.pi)), rtol=1e-5)


def test_a_component_that_follows_s0_has_no_density():
    with pytest.raises(ValueError, match="fluctuation"):
        normalized_density(0.3, MEAN, np.outer(MEAN, MEAN), component=1)


TARGET_MEAN = np.array([880.0, 44.0, 21.0])
TARGET_COV = np.array([[91.0, 4.4, 2.1], [4.4, 158.0, 0.0], [2.1, 0.0, 158.0]])
BACKGROUND = np.array([900.0, 30.0, -12.0])
BACKGROUND_COV = np.array([[701.0, 2.4, -1.0], [2.4, 168.0, 0.0], [-1.0, 0.0, 168.0]])
P = np.array([1e-3, 1e-2, 0.1, 0.5])


MOMENTS = (TARGET_MEAN, TARGET_COV, BACKGROUND, BACKGROUND_COV)


def test_drawn_probabilities_agree_with_the_law_within_their_errors() -> None:
    detected, error = rx_draws(P, *MOMENTS, draws=200_000, generator=np.random.default_rng(5))
    assert np.all(np.abs(detected - rx_p_detection(P, *MOMENTS)) < 5.0 * error)


def test_standard_error_is_the_scatter_of_repeats() -> None:
    generator = np.random.default_rng(6)
    runs = np.array([rx_draws(P[1:], *MOMENTS, draws=2000, generator=generator) for _ in range(300)])
    scatter = np.std(runs[:, 0], axis=0)
    claimed = np.sqrt(np.mean(np.square(runs[:, 1]), axis=0))
    # A deviation of 300 values is known to 4 %, at 5 sigma 20 %; the slope taken from 2000 draws adds some per cent.
    assert_allclose(claimed, scatter, rtol=0.25)


def test_nothing_detected_leaves_an_error() -> None:
    far = BACKGROUND_COV * 1e-6
    detected, error = rx_draws(
        [0.01], BACKGROUND, far, BACKGROUND, BACKGROUND_COV, draws=100, generator=np.random.default_rng(1)
    )
    assert detected == 0.0
    assert error > 1.0 / 200.0


def test_a_threshold_of_less_than_one_false_alarm_is_refused() -> None:
    with pytest.raises(ValueError, match="less than one false alarm"):
        rx_draws(1e-6, *MOMENTS, draws=1000, generator=np.random.default_rng(1))
