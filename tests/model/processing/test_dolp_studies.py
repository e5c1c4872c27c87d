"""DoLP against SNR, estimators, normalized Stokes parameters, drawn ROC."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ndtr

from model.processing import dolp_studies as normalized_stokes
from model.processing.detection import rx_p_detection, rx_threshold
from model.processing.dolp_studies import (
    ESTIMATORS,
    Estimator,
    bias_and_rms,
    dolp_against_snr,
    poisson_dolp,
    rx_draws,
    true_snr,
)
from model.processing.reconstruction import MODIFIED_PICKERING_RAD, design
from tests.model.oracles import covariance

PAPER = (1.0, 0.5, 0.5)


def _study(snr, draws=40_000, seed=1):
    return dolp_against_snr(PAPER, snr, draws=draws, generator=np.random.default_rng(seed))


def test_exact_moments_meet_the_draws_where_counts_are_many():
    found = _study([30.0, 100.0])
    # 450 and more electrons: Poisson and Gaussian differ by less than the sampling error of 4e4 draws.
    assert np.all(np.abs(found.mean - found.drawn_mean) < 4 * found.drawn_mean_error)
    assert np.all(np.abs(found.std - found.drawn_std) < 4 * found.drawn_std_error)


def test_first_order_is_biased_at_20_db_and_the_exact_law_is_not():
    found = _study([10.0], draws=400_000)
    assert abs(found.first_mean[0] - found.drawn_mean[0]) > 20 * found.drawn_mean_error[0]
    assert abs(found.mean[0] - found.drawn_mean[0]) < 0.2 * abs(found.first_mean[0] - found.drawn_mean[0])


def test_where_moments_do_not_exist_there_is_none_and_the_draws_are_counted():
    found = _study([1.0], draws=5000)
    assert np.isnan(found.mean[0])
    assert found.drawn_without_light[0] > 0


@pytest.mark.parametrize(("snr", "draws"), [([0.0], 100), ([[1.0]], 100), ([1.0], 1)])
def test_arguments_out_of_range_are_refused(snr, draws):
    with pytest.raises(ValueError, match="allowed are"):
        _study(snr, draws=draws)


@pytest.mark.parametrize("moment", ["mean", "std"])
def test_above_the_last_sum_the_law_of_poisson_counts_is_carried_on(moment):
    decibel = np.array([14.0, 16.0, 18.0, 20.0])
    found = dolp_against_snr((1.0, 0.5, 0.5), 10.0 ** (decibel / 20.0), draws=10, generator=np.random.default_rng(1))
    summed = getattr(found, f"poisson_{moment}")
    shorter = replace(found, **{f"poisson_{moment}": np.where(decibel > 18.0, np.nan, summed)})
    value, error = shorter.truth(moment)
    # Steps of 2 dB fall regularly: what the last one missed is no more than the one before missed.
    assert abs(value[-1] - summed[-1]) < error[-1] / 1.5
    assert abs(getattr(found, moment)[-1] - summed[-1]) > 3.0 * error[-1]


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


def test_refusals() -> None:
    with pytest.raises(ValueError, match="measured_snr"):
        true_snr(-1.0, "mas")
    with pytest.raises(ValueError, match="estimator"):
        true_snr(1.0, "best")
    with pytest.raises(ValueError, match="estimator"):
        bias_and_rms("best", 1.0)
    with pytest.raises(ValueError, match="true_snr_values"):
        bias_and_rms("mas", np.inf)


PLAN = design(MODIFIED_PICKERING_RAD)
SHAPE = np.array([1.0, 0.5, 0.5])


def light_of(snr: float) -> np.ndarray:
    # Four ideal channels of pairs: var S0 = S0 / 2.
    return SHAPE * snr**2 / 2.0


@pytest.mark.parametrize(("decibel", "mean", "std"), [(0.0, 1.6995, 0.5442), (10.0, 0.8758, 0.3585)])
def test_moments_are_those_of_the_plain_sum_at_0_and_10_db(decibel, mean, std):
    found = poisson_dolp(PLAN, light_of(10.0 ** (decibel / 20.0)))
    assert (found.mean, found.std) == (pytest.approx(mean, abs=6e-5), pytest.approx(std, abs=6e-5))
    assert found.error < 1e-12


def test_drawn_counts_have_these_moments():
    light = light_of(3.0)
    counts = np.random.default_rng(5).poisson((PLAN.system @ light)[:, None], (4, 100_000))
    stokes = PLAN.inverse @ counts
    values = np.hypot(stokes[1], stokes[2])[stokes[0] > 0] / stokes[0][stokes[0] > 0]
    found = poisson_dolp(PLAN, light)
    assert abs(values.mean() - found.mean) < 4.0 * found.std / np.sqrt(values.size)
    assert np.mean(stokes[0] <= 0) == pytest.approx(found.without_light, abs=4.0 * np.sqrt(found.without_light / 1e5))


def test_too_much_light_and_light_below_0_are_refused():
    with pytest.raises(ValueError, match="combinations of counts"):
        poisson_dolp(PLAN, SHAPE * 1e4)
    with pytest.raises(ValueError, match="allowed is 0 and above"):
        poisson_dolp(PLAN, [1.0, 2.0, 0.0])


MEAN = np.array([1.0, 0.3, 0.1])
COV = covariance((0.5, 0.22, 0.14), r01=0.4, r02=-0.3)


def _double_integral(x, component):
    """Pr(S_k <= x S0, S0 > 0) with the inner integral closed and the outer one by a fine Gauss-Legendre rule."""
    slope = COV[component, 0] / COV[0, 0]
    own = np.sqrt(COV[component, component] - slope * COV[component, 0])
    nodes, weights = np.polynomial.legendre.leggauss(200)
    s0 = 3.0 * (nodes + 1.0)
    bell = np.exp(-0.5 * ((s0 - 1.0) / 0.5) ** 2) / (0.5 * np.sqrt(2.0 * np.pi))
    inner = ndtr((x * s0 - MEAN[component] - slope * (s0 - 1.0)) / own)
    return np.sum(3.0 * weights * bell * inner) / ndtr(2.0)


@pytest.mark.parametrize("component", [1, 2])
@pytest.mark.parametrize("x", [-3.0, -0.2, 0.3, 1.0])
def test_cdf_against_the_double_integral(x, component):
    found = normalized_stokes.distribution(x, MEAN, COV, component=component)
    # The outer rule leaves out S0 above 6, ten deviations.
    np.testing.assert_allclose(found.lower, _double_integral(x, component), rtol=1e-12)
    np.testing.assert_allclose(found.lower + found.upper, 1.0, rtol=1e-14)


@pytest.mark.parametrize("p", [1e-12, 1e-3, 0.5, 1.0 - 1e-9])
def test_quantile_inverts_the_law(p):
    x = normalized_stokes.quantile(p, MEAN, COV, component=1)
    found = normalized_stokes.distribution(x, MEAN, COV, component=1)
    smaller = found.lower / p if p <= 0.5 else found.upper / (1.0 - p)
    np.testing.assert_allclose(smaller, 1.0, rtol=1e-12)


def test_known_intensity_leaves_a_normal_law():
    found = normalized_stokes.quantile(0.975, (2.0, 0.3, 0.1), np.diag([0.0, 0.04, 0.09]), component=2)
    np.testing.assert_allclose(found, 0.05 + 0.15 * 1.959963984540054, rtol=1e-13)


def test_high_signal_to_noise_keeps_the_width():
    found = normalized_stokes.quantile([0.16, 0.84], (1.0, 0.3, 0.1), 1e-12 * np.eye(3), component=1)
    # First order: sqrt(1 + 0.3^2) 1e-6; the next order is 1e-6 of it.
    width = np.sqrt(1.09) * 1e-6 * 2.0 * 0.994457883209753
    np.testing.assert_allclose(found[1] - found[0], width, rtol=1e-5)


@pytest.mark.parametrize(("component", "cov"), [(3, COV), (1, np.outer(MEAN, MEAN))])
def test_what_has_no_law_is_refused(component, cov):
    with pytest.raises(ValueError, match=r"component|fluctuation"):
        normalized_stokes.distribution(0.3, MEAN, cov, component=component)


TARGET_MEAN = np.array([880.0, 44.0, 21.0])
TARGET_COV = np.array([[91.0, 4.4, 2.1], [4.4, 158.0, 0.0], [2.1, 0.0, 158.0]])
BACKGROUND = np.array([900.0, 30.0, -12.0])
BACKGROUND_COV = np.array([[701.0, 2.4, -1.0], [2.4, 168.0, 0.0], [-1.0, 0.0, 168.0]])
P = np.array([1e-3, 1e-2, 0.1, 0.5])


@pytest.mark.parametrize("draw_threshold", [False, True])
def test_counts_agree_with_the_law(draw_threshold: bool) -> None:
    drawn = rx_draws(
        P,
        TARGET_MEAN,
        TARGET_COV,
        BACKGROUND,
        BACKGROUND_COV,
        draws=200_000,
        generator=np.random.default_rng(5),
        draw_threshold=draw_threshold,
    )
    exact = rx_p_detection(P, TARGET_MEAN, TARGET_COV, BACKGROUND, BACKGROUND_COV)
    assert np.all(np.abs(drawn.p_detection - exact) < 5.0 * drawn.standard_error)


@pytest.mark.parametrize("draw_threshold", [False, True])
def test_standard_error_is_the_scatter_of_repeats(draw_threshold: bool) -> None:
    generator = np.random.default_rng(6)
    repeats = 300
    runs = [
        rx_draws(
            P[1:],
            TARGET_MEAN,
            TARGET_COV,
            BACKGROUND,
            BACKGROUND_COV,
            draws=2000,
            generator=generator,
            draw_threshold=draw_threshold,
        )
        for _ in range(repeats)
    ]
    scatter = np.std([run.p_detection for run in runs], axis=0)
    claimed = np.sqrt(np.mean([np.square(run.standard_error) for run in runs], axis=0))
    # a deviation of 300 values is known to 4 %, at 5 sigma 20 %; the slope taken from 2000 draws adds some per cent
    assert_allclose(claimed, scatter, rtol=0.25)


def test_nothing_detected_leaves_an_error() -> None:
    drawn = rx_draws(
        [1e-12],
        BACKGROUND,
        TARGET_COV,
        BACKGROUND,
        BACKGROUND_COV,
        draws=100,
        generator=np.random.default_rng(1),
    )
    assert drawn.p_detection == 0.0
    assert drawn.standard_error > 1.0 / 200.0
    assert_allclose(drawn.threshold, rx_threshold([1e-12]), rtol=0.0)


def test_threshold_of_less_than_one_false_alarm_is_refused() -> None:
    with pytest.raises(ValueError, match="less than one false alarm"):
        rx_draws(
            1e-6,
            TARGET_MEAN,
            TARGET_COV,
            BACKGROUND,
            BACKGROUND_COV,
            draws=1000,
            generator=np.random.default_rng(1),
            draw_threshold=True,
        )
