"""What an RX detection probability must not depend on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from model.processing.detection import rx_roc

FloatArray = NDArray[np.float64]

P = np.array([1e-9, 1e-3, 0.2, 0.9])
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
    here = rx_roc(P, mean_t, cov_t, mean_b, cov_b)
    there = rx_roc(P, scale * mean_t, scale**2 * cov_t, scale * mean_b, scale**2 * cov_b)
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
    here = rx_roc(P, mean_t, cov_t, mean_b, cov_b)
    mapped = [change @ cov @ change.T for cov in (cov_t, cov_b)]
    symmetric = [0.5 * (cov + cov.T) for cov in mapped]
    there = rx_roc(P, change @ mean_t, symmetric[0], change @ mean_b, symmetric[1])
    assert_allclose(there.p_detection, here.p_detection, rtol=1e-9, atol=1e-10)
    assert_allclose(there.p_miss, here.p_miss, rtol=1e-9, atol=1e-10)


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS)
def test_target_like_its_background_is_on_the_diagonal(seed: int) -> None:
    _, _, mean, cov = classes(seed)
    roc = rx_roc(P, mean, cov, mean, cov)
    assert_allclose(roc.p_detection, P, rtol=1e-13)
    assert_allclose(roc.auc, 0.5, rtol=1e-12)


@settings(deadline=None, max_examples=40)
@given(seed=SEEDS)
def test_the_two_probabilities_add_to_one_and_rise(seed: int) -> None:
    roc = rx_roc(P, *classes(seed))
    assert_allclose(roc.p_detection + roc.p_miss, 1.0, rtol=1e-15)
    assert np.all(np.diff(roc.p_detection) >= 0.0)
    assert np.all(roc.error < 1.1e-10)
