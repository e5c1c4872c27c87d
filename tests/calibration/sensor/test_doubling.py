"""The doubling interval of a dark current."""

import numpy as np
import pytest
from scipy.stats import binom

from calibration.results import CalibrationError
from calibration.sensor.curves import doubling_temperature

TEMPERATURE_C = np.array([0.0, 8.0, 16.0, 24.0, 32.0, 40.0])
DOUBLING_K = 7.0
N_SEEDS = 200


def currents() -> np.ndarray:
    return np.asarray(10.0 * 2.0 ** (TEMPERATURE_C / DOUBLING_K))


def test_exact_currents_give_the_interval() -> None:
    found = doubling_temperature(TEMPERATURE_C, currents(), 0.01 * currents())
    # A straight line through points on it: rounding alone.
    assert found.value_k == pytest.approx(DOUBLING_K, rel=1e-12)
    assert found.n_temperatures == 6


def test_intervals_of_95_percent_cover_at_their_rate() -> None:
    draws = np.random.default_rng(1)
    inside = 0
    for _ in range(N_SEEDS):
        error = 0.03 * currents()
        found = doubling_temperature(TEMPERATURE_C, currents() + error * draws.standard_normal(6), error)
        inside += abs(found.value_k - DOUBLING_K) < 1.96 * found.std_error_k
    # Binomial at 1e-3.
    assert inside >= binom.ppf(1e-3, N_SEEDS, 0.95)


def test_one_temperature_is_refused() -> None:
    with pytest.raises(CalibrationError, match="1 different temperatures"):
        doubling_temperature(np.array([20.0, 20.0]), np.array([5.0, 5.0]), np.array([0.1, 0.1]))


def test_a_current_that_is_not_resolved_is_refused() -> None:
    with pytest.raises(CalibrationError, match=r"at 0 C the dark current is 10\.0 \+- 5\.0"):
        doubling_temperature(TEMPERATURE_C, currents(), np.full(6, 5.0))


def test_a_current_that_does_not_grow_is_refused() -> None:
    with pytest.raises(CalibrationError, match="does not grow"):
        doubling_temperature(TEMPERATURE_C, currents()[::-1], 0.01 * currents()[::-1])
