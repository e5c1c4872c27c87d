"""Curves of a sensor: linearity and its slope, saturation, and the doubling interval of the dark current."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import binom

from calibration.results import CalibrationError
from calibration.sensor.curves import (
    LINEARITY_LEVELS,
    LinearityCurve,
    PhotonTransfer,
    doubling_temperature,
    fit_linearity,
    response_slope,
    saturation_level,
)
from calibration.sensor.levels import LevelStatistics
from calibration.sensor.noise import calibrate_noise
from tests.calibration.sensor.synthetic_sensor import EXPOSURES_S, SIGNALS_E, SyntheticCamera, SyntheticSensor

FloatArray = NDArray[np.float64]

LIGHT = np.linspace(0.05, 0.8, 14)
FULL_DN, NOISE_DN = 4000.0, 0.5
QUADRATIC, CUBIC = -0.01 / FULL_DN, -0.02 / FULL_DN**2


@cache
def template() -> LevelStatistics:
    return SyntheticCamera(SyntheticSensor(shape=(8, 8)), 1).level(2, kind="flat", light_e=1000.0, exposure_s=0.01)


def response(x_dn: FloatArray) -> FloatArray:
    return x_dn * (1.0 + QUADRATIC * x_dn + CUBIC * x_dn**2)


def fitted(
    seed: int, *, flicker: float = 0.0, offset_s: float = 0.0, photons_per_s: float | None = None, lamp: float = 1.0
) -> LinearityCurve:
    """Levels of exposures that are `offset_s` longer than stated, the lamp `lamp` times as bright from halfway on."""
    draws = np.random.default_rng(seed)
    brightness = np.where(np.arange(len(LIGHT)) < 7, 1.0, lamp) * (1.0 + flicker * draws.standard_normal(len(LIGHT)))
    signal = response(FULL_DN * (LIGHT + offset_s) * brightness) + NOISE_DN * draws.standard_normal(len(LIGHT))
    photons = (
        [None] * len(LIGHT) if photons_per_s is None else (photons_per_s * (LIGHT + offset_s) * brightness).tolist()
    )
    flats = [
        replace(template(), exposure_s=light, photons=one) for light, one in zip(LIGHT.tolist(), photons, strict=True)
    ]
    found = fit_linearity(flats, signal, noise_dn2=np.full(len(LIGHT), NOISE_DN**2))
    assert found is not None
    return found


@pytest.mark.parametrize(("flicker", "offset_s"), [(0.0, 0.0), (0.0, 0.004), (0.0, -0.004), (0.003, 0.0)])
def test_terms_of_the_response_have_the_errors_that_they_say(flicker: float, offset_s: float) -> None:
    scores = []
    for seed in range(60):
        found = fitted(seed, flicker=flicker, offset_s=offset_s)
        error = np.array([found.quadratic_per_dn - QUADRATIC, found.cubic_per_dn2 - CUBIC])
        scores.append(error / np.sqrt(np.diag(found.covariance)))
    # Scatter from 10 degrees of freedom: variance near 10 / 8; where there is none, the part of it that noise makes up
    # half of the time lowers it. 4 sigma of 60.
    assert np.all(np.abs(np.mean(scores, axis=0)) < 4.0 * np.sqrt(1.25 / 60.0))
    assert np.all(np.abs(np.var(scores, axis=0) - 1.0) < 4.0 * 1.25 * np.sqrt(3.0 / 60.0))


def curve(quadratic: float, cubic: float) -> LinearityCurve:
    return replace(fitted(1), quadratic_per_dn=quadratic, cubic_per_dn2=cubic, covariance=np.zeros((2, 2)))


def test_what_the_response_does_to_the_variance() -> None:
    x = np.linspace(0.05, 0.5, 10) * FULL_DN
    slope = 1.0 + 2.0 * QUADRATIC * x + 3.0 * CUBIC * x**2
    signal = response(x)
    cubic = curve(QUADRATIC, CUBIC).variance_cubic_per_dn2
    series = signal * (1.0 + 3.0 * QUADRATIC * signal + cubic * signal**2)
    # What is left out: products of three terms, at most 20 b c u^3 + 40 c^2 u^4 with b = 0.01, c = 0.02, u = 0.5.
    np.testing.assert_allclose(x * slope**2, series, rtol=0.0015)


def test_a_lamp_that_drifts_is_within_the_error_of_the_cubic_term() -> None:
    # signal = t (1 - a t + 2 a^2 t^2 ...) of a linear sensor, whose photon-transfer curve has no cubic term.
    found = curve(-1e-5, 2.0 * 1e-5**2)
    assert abs(found.variance_cubic_per_dn2) < 1.8 * found.variance_cubic_error_per_dn2


def test_photons_count_where_the_lamp_was_changed_and_exposures_where_both_say_the_same() -> None:
    found = fitted(1, photons_per_s=1e5, lamp=1.2)
    assert found.light == "photons"
    assert abs(found.cubic_per_dn2 - CUBIC) < 5.0 * np.sqrt(found.covariance[1, 1])
    assert fitted(1, photons_per_s=1e5).light == "exposure"


def test_an_unsteady_lamp_makes_the_errors_large() -> None:
    steady, unsteady = fitted(2), fitted(2, flicker=0.02)
    assert unsteady.variance_cubic_error_per_dn2 > 5.0 * steady.variance_cubic_error_per_dn2
    # Half of the largest, by its few degrees of freedom.
    assert unsteady.relative_scatter == pytest.approx(0.02, rel=0.6)


@pytest.mark.parametrize("lights", [LIGHT[: LINEARITY_LEVELS - 1], np.full(14, 0.01)])
def test_few_exposures_or_one_give_no_response(lights: FloatArray) -> None:
    flats = [replace(template(), exposure_s=float(light)) for light in lights]
    assert fit_linearity(flats, FULL_DN * LIGHT[: len(lights)], noise_dn2=np.ones(len(lights))) is None


SLOPE_FULL_DN, SIGNAL_DN = 4035.0, 1500.0


def transfer(*, low: float, light_known: bool = True, n: int = len(SIGNALS_E)) -> PhotonTransfer:
    """Return the curve of a sensor whose response is a parabola, `low` at saturation."""
    sensor = SyntheticSensor(response=lambda dn: dn * (1.0 - low * dn / SLOPE_FULL_DN), shape=(160, 160))
    camera = SyntheticCamera(sensor, 31)
    if light_known:
        levels = camera.sweep(signals_e=SIGNALS_E[-n:], exposures_s=EXPOSURES_S[-n:])
    else:
        levels = [camera.level(2, kind="flat", light_e=light_e, exposure_s=None) for light_e in SIGNALS_E[-n:]]
        levels.append(camera.level(16, kind="dark", light_e=0.0, exposure_s=None))
    return calibrate_noise(levels, bit_depth=12).transfer


@pytest.mark.parametrize("light_known", [True, False])
@pytest.mark.parametrize("low", [0.02, 0.06])
def test_the_slope_of_a_parabola(low: float, light_known: bool) -> None:
    value, error = response_slope(transfer(low=low, light_known=light_known), SIGNAL_DN)
    # Slope over ratio where signal = x (1 - low x / full) is SIGNAL_DN.
    x = SLOPE_FULL_DN / (2.0 * low) * (1.0 - np.sqrt(1.0 - 4.0 * low * SIGNAL_DN / SLOPE_FULL_DN))
    truth = (1.0 - 2.0 * low * x / SLOPE_FULL_DN) / (1.0 - low * x / SLOPE_FULL_DN)
    # 4 sigma; terms of third order, up to (0.06 * 0.4)^2 * 5, are left out where light is not known.
    assert abs(value - truth) < 4.0 * error + 5.0 * (low * SIGNAL_DN / SLOPE_FULL_DN) ** 2
    # Known well enough to tell that it is not 1.
    assert value + error < 1.0


def test_a_linear_sensor_has_the_slope_one_and_few_levels_say_nothing() -> None:
    value, error = response_slope(transfer(low=1e-9), SIGNAL_DN)
    assert abs(value - 1.0) < 4.0 * error
    assert response_slope(transfer(low=0.02, light_known=False, n=4), SIGNAL_DN) == (1.0, 0.0)


def clipped_curve(light_dn: FloatArray, ceiling_dn: float = 4000.0) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of min(N(light, 0.25 * light), ceiling), whose moments are known."""
    sigma = np.sqrt(0.25 * light_dn)
    alpha = (ceiling_dn - light_dn) / sigma
    density = np.exp(-0.5 * alpha**2) / np.sqrt(2.0 * np.pi)
    mean = light_dn * ndtr(alpha) - sigma * density + ceiling_dn * ndtr(-alpha)
    square = (light_dn**2 + sigma**2) * ndtr(alpha) - sigma * (light_dn + ceiling_dn) * density
    return mean, square + ceiling_dn**2 * ndtr(-alpha) - mean**2


@pytest.mark.parametrize("step_dn", [90.0, 137.0, 210.0, 333.0])
@pytest.mark.parametrize("start", [0.0, 0.25, 0.5, 0.75])
def test_the_interval_of_saturation_holds_the_peak_of_the_variance(step_dn: float, start: float) -> None:
    fine_mean, fine_variance = clipped_curve(np.linspace(3000.0, 4200.0, 24_001))
    mean, variance = clipped_curve(np.arange(300.0 + start * step_dn, 5000.0, step_dn))
    level = saturation_level(signal_dn=mean, variance_dn2=variance)
    assert level is not None
    # A value evenly likely in an interval is never further than sqrt(3) standard deviations from its middle.
    assert abs(level.signal_dn - fine_mean[np.argmax(fine_variance)]) <= np.sqrt(3.0) * level.std_error_dn
    # Two steps at most: the level with the largest variance may be past the peak, and the next one not yet fallen.
    assert level.std_error_dn <= 2.0 * step_dn / np.sqrt(12.0)


@pytest.mark.parametrize(("step_dn", "last"), [(100.0, 1.0), (300.0, 0.97)])
def test_a_sweep_that_ends_early_or_dips_within_its_scatter_has_no_saturation(step_dn: float, last: float) -> None:
    mean, variance = clipped_curve(np.arange(300.0, 2400.0, step_dn))
    variance[-1] = variance[-1] if last == 1.0 else last * variance[-2]
    assert saturation_level(signal_dn=mean, variance_dn2=variance) is None


TEMPERATURE_C = np.array([0.0, 8.0, 16.0, 24.0, 32.0, 40.0])
CURRENTS = 10.0 * 2.0 ** (TEMPERATURE_C / 7.0)


def test_the_doubling_interval_of_a_dark_current_has_the_error_that_it_says() -> None:
    found = doubling_temperature(TEMPERATURE_C, CURRENTS, 0.01 * CURRENTS)
    # A straight line through points on it: rounding alone.
    assert found.value_k == pytest.approx(7.0, rel=1e-12)
    assert found.n_temperatures == 6
    draws, error, inside = np.random.default_rng(1), 0.03 * CURRENTS, 0
    for _ in range(200):
        found = doubling_temperature(TEMPERATURE_C, CURRENTS + error * draws.standard_normal(6), error)
        inside += abs(found.value_k - 7.0) < 1.96 * found.std_error_k
    assert inside >= binom.ppf(1e-3, 200, 0.95)


@pytest.mark.parametrize(
    ("temperature_c", "currents", "errors", "said"),
    [
        (np.full(2, 20.0), np.full(2, 5.0), np.full(2, 0.1), "1 different temperatures"),
        (TEMPERATURE_C, CURRENTS, np.full(6, 5.0), r"at 0 C the dark current is 10\.0 \+- 5\.0"),
        (TEMPERATURE_C, CURRENTS[::-1], 0.01 * CURRENTS[::-1], "does not grow"),
    ],
)
def test_currents_without_a_doubling_interval_are_refused(
    temperature_c: FloatArray, currents: FloatArray, errors: FloatArray, said: str
) -> None:
    with pytest.raises(CalibrationError, match=said):
        doubling_temperature(temperature_c, currents, errors)
