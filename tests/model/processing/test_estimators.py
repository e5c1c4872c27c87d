"""Estimators of the true DoLP: defining equations, published errors, behaviour at the ends."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from model.processing.dolp_studies import ESTIMATORS, Estimator, bias_and_rms, true_snr

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


@settings(deadline=None, max_examples=30)
@given(low=st.floats(0.0, 20.0), step=st.floats(1e-6, 5.0), estimator=st.sampled_from(ESTIMATORS))
def test_estimates_rise_with_what_is_measured(low: float, step: float, estimator: Estimator) -> None:
    first, second = true_snr([low, low + step], estimator)
    assert 0.0 <= first <= second
    assert first <= low


def test_mas_is_half_the_measured_value_near_zero() -> None:
    assert_allclose(true_snr([0.0, 1e-9], "mas"), [0.0, 5e-10], rtol=1e-6)


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
