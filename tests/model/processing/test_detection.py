"""Thresholds, ROC and areas of the RX detector, with known and with estimated background."""

import mpmath
import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.special import betaincc

from model.numerics import erfc
from model.processing.detection import rx_p_detection, rx_p_miss, rx_roc, rx_threshold, sample_roc, sample_threshold
from tests.model.processing.quadratic_form_oracles import ray_log_tail
from tests.model.processing.rx_reference import CASES, HOTELLING, column, moments

FloatArray = NDArray[np.float64]
MEAN = np.array([12.0, 1.0, -2.0])
COV = np.array([[4.0, 0.6, -0.3], [0.6, 2.0, 0.4], [-0.3, 0.4, 1.0]])
P = np.array([1e-300, 1e-134, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 0.9, 1.0 - 1e-12])
# rx52 has a background of condition 1e10, rx34 a target with a spread of 1e-10: rounding of their inputs shows
WELL_POSED = [name for name in CASES if name not in ("rx34", "rx52")]


def noncentral_tail(threshold: float, distance_squared: float, *, upper: bool) -> mp.mpf:
    """Non-central chi-square of 3 degrees as a Poisson mixture of central ones."""
    half, edge = mp.mpf(distance_squared) / 2, mp.mpf(threshold) / 2
    edges = [edge, mp.inf] if upper else [0, edge]
    return mp.nsum(
        lambda k: mp.exp(-half) * half**k / mp.factorial(k) * mp.gammainc(k + mp.mpf(3) / 2, *edges, regularized=True),
        [0, mp.inf],
        method="d",
    )


@pytest.mark.parametrize("name", WELL_POSED)
def test_reference_in_both_tails(name: str) -> None:
    # whitening rounds offsets b (up to 53 here) to some 1e-16, worth b^2 1e-16 of a tail of exp(-b^2/2)
    args = moments(CASES[name])
    p = column(CASES[name], "pfa")
    for found, key in ((rx_p_detection(p, *args), "pd"), (rx_p_miss(p, *args), "pmiss")):
        expected = column(CASES[name], key)
        # subnormal numbers have fewer digits
        normal = (expected > 1e-300) | (expected == 0.0)
        assert_allclose(found[normal], expected[normal], rtol=1e-11)


@pytest.mark.parametrize("name", [name for name in CASES if CASES[name]["auc"] and name != "rx52"])
def test_reference_areas(name: str) -> None:
    assert_allclose(rx_roc(0.1, *moments(CASES[name])).auc, float(CASES[name]["auc"]), atol=1e-14)


def test_nearly_deterministic_target() -> None:
    # rx34: D is 6 with a spread of 5e-5; P_FA 0.1 has its threshold 5000 spreads above, 0.5 far below
    found = rx_roc([0.1, 0.5], *moments(CASES["rx34"]))
    assert_allclose(found.p_detection, [0.0, 1.0], rtol=0.0)
    assert_allclose(found.p_miss, [1.0, 0.0], rtol=0.0)


def test_target_like_its_background_is_on_the_diagonal() -> None:
    roc = rx_roc(P, MEAN, COV, MEAN, COV)
    assert_allclose(roc.p_detection, P, rtol=1e-13)
    assert_allclose(roc.p_miss, 1.0 - P, rtol=1e-13)
    assert_allclose(roc.auc, 0.5, rtol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 0.25, 4.0])
@pytest.mark.parametrize("p", [1e-6, 1e-2, 0.5])
def test_proportional_covariance_is_noncentral_chi_square(factor: float, p: float) -> None:
    shift = np.array([3.0, -1.0, 0.5])
    distance = float(shift @ np.linalg.solve(COV, shift))
    threshold = float(rx_threshold(p))
    args = (MEAN + shift, factor * COV, MEAN, COV)
    upper = noncentral_tail(threshold / factor, distance / factor, upper=True)
    lower = noncentral_tail(threshold / factor, distance / factor, upper=False)
    assert_allclose(rx_p_detection(p, *args), float(upper), rtol=1e-12)
    assert_allclose(rx_p_miss(p, *args), float(lower), rtol=1e-12)


def test_background_of_condition_1e10_is_flagged() -> None:
    found = rx_roc(column(CASES["rx52"], "pfa"), *moments(CASES["rx52"]))
    assert_allclose(found.p_detection, column(CASES["rx52"], "pd"), atol=1e-6, rtol=0.0)
    assert_allclose(found.auc, float(CASES["rx52"]["auc"]), atol=1e-6, rtol=0.0)
    assert "condition number 1e+10" in found.warnings[0]


def test_target_without_spread_gives_a_step() -> None:
    # D = 9, between the thresholds of 0.1 (6.25) and 0.01 (11.3)
    args = ([3.0, 0.0, 0.0], np.zeros((3, 3)), np.zeros(3), np.eye(3))
    assert_allclose(rx_p_detection([0.01, 0.1], *args), [0.0, 1.0], rtol=0.0)
    assert_allclose(rx_p_miss([0.01, 0.1], *args), [1.0, 0.0], rtol=0.0)
    # the area is the probability that a chi-square variable stays below 9
    assert_allclose(rx_roc(0.1, *args).auc, 1.0 - float(mp.gammainc(1.5, 4.5, regularized=True)), rtol=1e-13)


def test_rank_one_target_has_a_constant_part() -> None:
    # D = 4 + 9 (z + 1)^2
    args = ([2.0, 0.0, 3.0], np.diag([0.0, 0.0, 9.0]), np.zeros(3), np.eye(3))
    distance = np.sqrt((rx_threshold(0.01) - 4.0) / 9.0)
    expected = mp.erfc((distance - 1.0) / mp.sqrt(2)) / 2 + mp.erfc((distance + 1.0) / mp.sqrt(2)) / 2
    assert_allclose(rx_p_detection(0.01, *args), float(expected), rtol=1e-13)


def test_roc_may_lie_below_the_diagonal_and_rises_all_the_same() -> None:
    p = np.linspace(0.001, 0.999, 400)
    roc = rx_roc(p, MEAN + 0.1, 0.05 * COV, MEAN, COV)
    assert np.all(np.diff(roc.p_detection) > 0.0)
    assert np.all(roc.p_detection[:200] < p[:200])
    assert roc.auc < 0.5


def test_area_is_the_integral_of_the_curve() -> None:
    # in x, P_FA = x^2 (3 - 2 x): smooth at both ends, where the curve has infinite slope or curvature
    node, weight = np.polynomial.legendre.leggauss(200)
    x = 0.5 * (node + 1.0)
    roc = rx_roc(x**3 * (10.0 - 15.0 * x + 6.0 * x * x), MEAN + 1.5, 1.7 * COV + np.diag([0.0, 3.0, 0.0]), MEAN, COV)
    integral = np.sum(0.5 * weight * roc.p_detection * 30.0 * x**2 * (1.0 - x) ** 2)
    assert_allclose(roc.auc, integral, atol=1e-8, rtol=0.0)


def test_twelve_channels_and_a_nearly_singular_target() -> None:
    rng = np.random.default_rng(12)
    axes, _ = np.linalg.qr(rng.normal(size=(12, 12)))
    spread = 10.0 ** -np.arange(12.0)
    cov_t = (axes * spread) @ axes.T
    shift = axes @ np.full(12, 0.3)
    found = rx_roc(1e-12, shift, 0.5 * (cov_t + cov_t.T), np.zeros(12), np.eye(12))
    # the smallest of the weights is good to 1e-5 only, as cov_t itself is rounded; it moves D by 1e-12 * 1e5
    expected = ray_log_tail(
        float(rx_threshold(1e-12, 12)), spread.tolist(), (0.3 / np.sqrt(spread)).tolist(), upper=True
    )
    assert_allclose(np.log(found.p_detection), float(expected), rtol=0.0, atol=1e-9)


def test_classes_broadcast_over_leading_axes() -> None:
    target = MEAN + np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.0]])[:, None, :]
    roc = rx_roc([0.01, 0.1, 0.5], target, COV, MEAN, COV)
    assert roc.p_detection.shape == (2, 3)
    assert roc.auc.shape == (2, 1)
    assert_allclose(roc.p_detection[1, 1], rx_p_detection(0.1, target[1, 0], COV, MEAN, COV), rtol=1e-14)
    assert roc.threshold.shape == roc.p_false_alarm.shape == (2, 3)


def test_ends_of_the_curve() -> None:
    roc = rx_roc([0.0, 1.0], MEAN + 1.0, COV, MEAN, COV)
    assert_allclose(roc.p_detection, [0.0, 1.0], rtol=0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"p_false_alarm": 1.5}, "p_false_alarm"),
        ({"p_false_alarm": np.nan}, "p_false_alarm"),
        ({"target_cov": np.diag([1.0, 1.0, -1.0])}, "target_cov"),
        ({"target_mean": np.zeros(4), "target_cov": np.eye(4)}, "components"),
        ({"target_mean": np.array([1.0, np.nan, 0.0])}, "not finite"),
        ({"target_cov": np.eye(2)}, "do not fit"),
        ({"background_cov": np.diag([1.0, 1.0, -1.0])}, "background_cov"),
        ({"background_cov": np.diag([1.0, 1.0, 1e-13])}, "background_cov is singular"),
        ({"background_cov": np.ones((3, 3))}, "background_cov is singular"),
        ({"background_cov": np.zeros((3, 3))}, "background_cov is singular"),
    ],
)
def test_refusals_name_the_argument(change: dict[str, object], message: str) -> None:
    names = ("p_false_alarm", "target_mean", "target_cov", "background_mean", "background_cov")
    arguments: dict[str, object] = dict(zip(names, (0.1, MEAN, COV, MEAN, COV), strict=True))
    with pytest.raises(ValueError, match=message):
        rx_p_detection(**(arguments | change))


def test_counts_behind_hundreds_of_angles_have_a_probability_of_detection():
    scale = np.linspace(0.5, 2.0, 500)
    found = rx_roc(np.array([1e-3]), np.zeros(500), np.diag(scale), np.zeros(500), np.eye(500))
    # A sum of so many squares is as good as normal: mean sum(w), variance 2 sum(w^2); skewness leaves some 1e-2.
    threshold = float(rx_threshold(1e-3, 500))
    normal = 0.5 * erfc((threshold - scale.sum()) / np.sqrt(4.0 * np.sum(scale**2)))
    assert found.p_detection[0] == pytest.approx(normal, abs=0.02)
    assert np.isfinite(found.error[0])


P_SCALED = np.array([1e-9, 1e-3, 0.2, 0.9])
SEEDS = st.integers(0, 2**32 - 1)


def classes(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Two random classes, covariances of condition below about 1e3, means some deviations apart."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(2, 3, 3))
    cov_t, cov_b = factor @ np.swapaxes(factor, 1, 2) + 0.1 * np.eye(3)
    mean_b = rng.normal(size=3)
    return mean_b + 3.0 * rng.normal(size=3), cov_t, mean_b, cov_b


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS)
@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_unit_of_radiance_is_free(seed: int, scale: float) -> None:
    mean_t, cov_t, mean_b, cov_b = classes(seed)
    here = rx_roc(P_SCALED, mean_t, cov_t, mean_b, cov_b)
    there = rx_roc(P_SCALED, scale * mean_t, scale**2 * cov_t, scale * mean_b, scale**2 * cov_b)
    # offsets of up to 30 in a tail: rounding of the scaled arguments counts 900 times, cond(S_b) 1e3 times
    assert_allclose(there.p_detection, here.p_detection, rtol=1e-10, atol=1e-12)
    assert_allclose(there.auc, here.auc, rtol=1e-10)


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS)
def test_axes_and_units_of_the_components_are_free(seed: int) -> None:
    mean_t, cov_t, mean_b, cov_b = classes(seed)
    rng = np.random.default_rng([seed, 1])
    left, right = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    change = (left * rng.uniform(0.2, 5.0, 3)) @ right.T
    here = rx_roc(P_SCALED, mean_t, cov_t, mean_b, cov_b)
    mapped = [change @ cov @ change.T for cov in (cov_t, cov_b)]
    symmetric = [0.5 * (cov + cov.T) for cov in mapped]
    there = rx_roc(P_SCALED, change @ mean_t, symmetric[0], change @ mean_b, symmetric[1])
    assert_allclose(there.p_detection, here.p_detection, rtol=1e-9, atol=1e-10)
    assert_allclose(there.p_miss, here.p_miss, rtol=1e-9, atol=1e-10)


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS)
def test_the_two_probabilities_add_to_one_and_rise(seed: int) -> None:
    roc = rx_roc(P_SCALED, *classes(seed))
    assert_allclose(roc.p_detection + roc.p_miss, 1.0, rtol=1e-15)
    assert np.all(np.diff(roc.p_detection) >= 0.0)
    assert np.all(roc.error < 1.1e-10)


SAMPLE_COV = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 3.0]])
SHIFT = np.array([1.0, 2.0, 0.5])
TARGET_COV = np.diag([6.0, 0.2, 1.0])
ZERO = np.zeros(3)


def detected(*arguments, **more) -> FloatArray:
    return sample_roc(*arguments, **more).p_detection


def noncentral_f_upper(f_value: float, first: int, second: int, noncentrality: float) -> float:
    """Return the probability above `f_value`: incomplete beta functions, Poisson weighted, in 30 digits."""
    with mpmath.workdps(30):
        share, half = second / (second + first * mpmath.mpf(f_value)), mpmath.mpf(noncentrality) / 2
        # The weights beyond 100 are below 1e-60 for the noncentralities here, which are below 10.
        terms = (
            mpmath.exp(-half)
            * half**k
            / mpmath.factorial(k)
            * mpmath.betainc(second / mpmath.mpf(2), first / mpmath.mpf(2) + k, 0, share, regularized=True)
            for k in range(100)
        )
        return float(mpmath.fsum(terms))


def false_alarms_inside(threshold: FloatArray, n: int) -> FloatArray:
    return betaincc(1.5, 0.5 * (n - 4), threshold * n / (n - 1.0) ** 2)


@pytest.mark.parametrize("row", HOTELLING, ids=lambda row: f"n={row['n']}")
def test_hotelling_table(row: dict[str, str | int]) -> None:
    n = int(row["n"])
    # 18 digits given; the incomplete beta function and its inverse are good to a few 1e-15
    assert_allclose(sample_threshold(float(row["pfa"]), n), float(row["eta_hotelling"]), rtol=1e-13)


@pytest.mark.parametrize("n", [6, 20, 1000, 10**6])
def test_false_alarms_come_back_inside_the_sample(n: int) -> None:
    p = np.array([1e-12, 1e-3, 0.5, 0.99])
    threshold = sample_threshold(p, n, pixel_in_sample=True)
    # the probability goes as (1 - t/limit)^((n - 4)/2): close to its limit a rounded threshold knows little of it
    spare = 1.0 - threshold * n / (n - 1.0) ** 2
    known = 1e-12 + 0.5 * (n - 4) * 4e-16 / np.maximum(spare, 1e-15)
    error = np.abs(false_alarms_inside(threshold, n) / p - 1.0)
    assert np.all(error <= known)


def test_threshold_inside_the_sample_stays_below_its_limit() -> None:
    assert sample_threshold(1e-12, 10, pixel_in_sample=True) < 81.0 / 10.0


def test_many_pixels_are_a_known_background() -> None:
    n, p = 10**7, np.array([1e-4, 0.1])
    threshold = rx_threshold(p)
    # False alarms exceed by (t^2/4 + t)/n, relative, and fall by a half per unit of t.
    assert_allclose(sample_threshold(p, n), threshold, rtol=(threshold.max() / 2.0 + 3.0) / n)
    found = detected(p, SHIFT, TARGET_COV, ZERO, SAMPLE_COV, n)
    assert_allclose(found, rx_p_detection(p, SHIFT, TARGET_COV, ZERO, SAMPLE_COV), rtol=200.0 / n)


@pytest.mark.parametrize("n", [4, 5, 20, 1000])
def test_equal_covariance_is_noncentral_f(n: int) -> None:
    distance = float(SHIFT @ np.linalg.solve(SAMPLE_COV, SHIFT))
    p = np.array([0.01, 0.1, 0.5])
    f_value = n * (n - 3) / (3.0 * (n - 1) * (n + 1)) * sample_threshold(p, n)
    expected = [noncentral_f_upper(one, 3, n - 3, distance * n / (n + 1)) for one in f_value]
    # the integration's own tolerance
    assert_allclose(detected(p, SHIFT, SAMPLE_COV, ZERO, SAMPLE_COV, n), expected, rtol=1e-10)


@pytest.mark.parametrize("inside", [False, True])
def test_unequal_covariance_against_draws(inside: bool) -> None:
    rng = np.random.default_rng(3)
    n, trials = 12, 100_000
    training = rng.standard_normal((trials, n, 3)) @ np.linalg.cholesky(SAMPLE_COV).T
    pixel = SHIFT + rng.standard_normal((trials, 3)) * np.sqrt(np.diagonal(TARGET_COV))
    if inside:
        training[:, 0] = pixel
    mean = training.mean(axis=1)
    away = training - mean[:, None]
    scatter = np.einsum("tni,tnj->tij", away, away) / (n - 1)
    gap = pixel - mean
    d = np.einsum("ti,ti->t", gap, np.linalg.solve(scatter, gap[..., None])[..., 0])
    for p in (0.01, 0.1, 0.5):
        expected = detected(p, SHIFT, TARGET_COV, ZERO, SAMPLE_COV, n, pixel_in_sample=inside)
        counted = np.mean(d > sample_threshold(p, n, pixel_in_sample=inside))
        assert abs(counted - expected) < 5.0 * np.sqrt(expected * (1.0 - expected) / trials)


@pytest.mark.parametrize(("n", "inside"), [(3, False), (1, False), (4, True)])
def test_too_few_pixels_are_refused(n: int, inside: bool) -> None:
    with pytest.raises(ValueError, match="n_pixels"):
        sample_threshold(0.1, n, pixel_in_sample=inside)
    with pytest.raises(ValueError, match="n_pixels"):
        detected(0.1, SHIFT, SAMPLE_COV, ZERO, SAMPLE_COV, n, pixel_in_sample=inside)


def test_false_alarms_come_back_from_1e_300_to_1() -> None:
    p = np.concatenate([10.0 ** np.arange(-300.0, 0.0, 7.0), 1.0 - 10.0 ** np.arange(-1.0, -13.0, -1.0)])
    # half a unit in the last place of a threshold of 1390 is worth 6e-14 of the probability
    back = [float(mp.gammainc(1.5, mp.mpf(one) / 2, regularized=True)) for one in rx_threshold(p)]
    assert_allclose(back, p, rtol=1e-13)


def test_dimension_below_1_is_refused() -> None:
    with pytest.raises(ValueError, match="dim"):
        rx_threshold(0.1, 0)
