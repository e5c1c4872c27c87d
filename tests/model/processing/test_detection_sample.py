"""The RX detector with a background estimated from pixels."""

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.special import betainc, betaincc

from model.processing.detection import rx_p_detection, rx_threshold, sample_roc, sample_threshold
from tests.model.processing.rx_reference import HOTELLING

FloatArray = NDArray[np.float64]

COV = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 3.0]])
SHIFT = np.array([1.0, 2.0, 0.5])
TARGET_COV = np.diag([6.0, 0.2, 1.0])
ZERO = np.zeros(3)
P = np.array([1e-6, 1e-4, 1e-2, 0.1, 0.5, 0.9])


def detected(*arguments, **more) -> FloatArray:
    return sample_roc(*arguments, **more).p_detection


def false_alarms(threshold: FloatArray, n: int) -> FloatArray:
    odds = n / ((n - 1.0) * (n + 1.0)) * threshold
    # The smaller of both shares keeps its digits.
    lower, upper = betaincc(1.5, 0.5 * (n - 3), odds / (1.0 + odds)), betainc(0.5 * (n - 3), 1.5, 1.0 / (1.0 + odds))
    return np.where(odds < 1.0, lower, upper)


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
def test_false_alarms_come_back(n: int) -> None:
    p = np.array([1e-100, 1e-12, 1e-3, 0.5, 0.99])
    # rounding of a threshold t moves the probability by at most t/2 of it, t up to 460
    assert_allclose(false_alarms(sample_threshold(p, n), n), p, rtol=1e-12)


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
    n = 10**7
    p = np.array([1e-4, 0.1])
    threshold = rx_threshold(p)
    # false alarms exceed by (t^2/4 + t)/n, relative, and fall by a half per unit of t
    assert_allclose(sample_threshold(p, n), threshold, rtol=(threshold.max() / 2.0 + 3.0) / n)
    found = detected(p, SHIFT, TARGET_COV, ZERO, COV, n)
    assert_allclose(found, rx_p_detection(p, SHIFT, TARGET_COV, ZERO, COV), rtol=200.0 / n)


@pytest.mark.parametrize("n", [4, 5, 20, 1000])
def test_equal_covariance_is_noncentral_f(n: int) -> None:
    distance = float(SHIFT @ np.linalg.solve(COV, SHIFT))
    p = np.array([0.01, 0.1, 0.5])
    f_value = n * (n - 3) / (3.0 * (n - 1) * (n + 1)) * sample_threshold(p, n)
    expected = [noncentral_f_upper(one, 3, n - 3, distance * n / (n + 1)) for one in f_value]
    # the integration's own tolerance
    assert_allclose(detected(p, SHIFT, COV, ZERO, COV, n), expected, rtol=1e-10)


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("n", [6, 30, 10**5])
def test_target_like_its_background_is_on_the_diagonal(n: int, inside: bool) -> None:
    found = detected(P, SHIFT, COV, SHIFT, COV, n, pixel_in_sample=inside)
    # default tolerance 1e-10 for half the nodes; rounding of a weight t/n of n degrees counts n times
    assert_allclose(found, P, rtol=1e-12)


@pytest.mark.parametrize("inside", [False, True])
def test_unequal_covariance_against_draws(inside: bool) -> None:
    rng = np.random.default_rng(3)
    n, trials = 12, 100_000
    training = rng.standard_normal((trials, n, 3)) @ np.linalg.cholesky(COV).T
    pixel = SHIFT + rng.standard_normal((trials, 3)) * np.sqrt(np.diagonal(TARGET_COV))
    if inside:
        training[:, 0] = pixel
    mean = training.mean(axis=1)
    away = training - mean[:, None]
    scatter = np.einsum("tni,tnj->tij", away, away) / (n - 1)
    gap = pixel - mean
    d = np.einsum("ti,ti->t", gap, np.linalg.solve(scatter, gap[..., None])[..., 0])
    for p in (0.01, 0.1, 0.5):
        expected = detected(p, SHIFT, TARGET_COV, ZERO, COV, n, pixel_in_sample=inside)
        counted = np.mean(d > sample_threshold(p, n, pixel_in_sample=inside))
        assert abs(counted - expected) < 5.0 * np.sqrt(expected * (1.0 - expected) / trials)


def test_roc_holds_together() -> None:
    roc = sample_roc(P, SHIFT, TARGET_COV, ZERO, COV, 20)
    assert_allclose(roc.threshold, sample_threshold(P, 20), rtol=0.0)
    assert_allclose(roc.p_detection + roc.p_miss, 1.0, rtol=1e-15)
    assert np.all(roc.error < 1.1e-10)
    assert roc.warnings == ()


@pytest.mark.parametrize(("n", "inside"), [(3, False), (1, False), (4, True)])
def test_too_few_pixels_are_refused(n: int, inside: bool) -> None:
    with pytest.raises(ValueError, match="n_pixels"):
        sample_threshold(0.1, n, pixel_in_sample=inside)
    with pytest.raises(ValueError, match="n_pixels"):
        detected(0.1, SHIFT, COV, ZERO, COV, n, pixel_in_sample=inside)


def test_values_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="p_false_alarm"):
        sample_threshold(-0.1, 20)
