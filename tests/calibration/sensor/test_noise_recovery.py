"""Known truth is found again, and as far off as the standard errors say: each quantity on its own."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.estimate import Estimate
from calibration.sensor.curves import brighter_fatter
from calibration.sensor.levels import LevelStatistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise
from tests.calibration.sensor.synthetic_sensor import (
    EXPOSURES_S,
    SATURATING_EXPOSURES_S,
    SATURATING_SIGNALS_E,
    SIGNALS_E,
    SyntheticCamera,
    SyntheticSensor,
)

TRUTH = {
    "gain_dn_per_e": 0.25,
    "read_noise_e": 10.0,
    "dark_current_e_per_s": 400.0,
    "black_level_dn": 60.0,
    "prnu": 0.01,
    "dsnu_e": 4.0,
}
N_SEEDS = 60


def estimate(calibration: NoiseCalibration, name: str) -> Estimate:
    found = getattr(calibration, name)
    assert isinstance(found, Estimate), f"{name} is {found}; flags {[flag.name for flag in calibration.flags]}"
    return found


def score(calibration: NoiseCalibration, name: str, truth: float) -> float:
    found = estimate(calibration, name)
    return (found.value - truth) / found.std_error


@cache
def sweeps() -> tuple[list[LevelStatistics], ...]:
    return tuple(
        SyntheticCamera(SyntheticSensor(), seed).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
        for seed in range(N_SEEDS)
    )


@cache
def calibrations() -> tuple[NoiseCalibration, ...]:
    return tuple(calibrate_noise(levels, bit_depth=12) for levels in sweeps())


@pytest.mark.parametrize("name", TRUTH)
def test_scores_have_mean_0_and_variance_1(name: str) -> None:
    scores = np.array([score(calibration, name, TRUTH[name]) for calibration in calibrations()])
    # 4 sigma of 60 normal draws: 1 / sqrt(60) for the mean, sqrt(2 / 59) for the variance.
    assert abs(scores.mean()) < 4.0 / np.sqrt(N_SEEDS)
    assert abs(scores.var(ddof=1) - 1.0) < 4.0 * np.sqrt(2.0 / (N_SEEDS - 1))


@pytest.mark.parametrize("name", TRUTH)
def test_intervals_of_95_percent_cover_at_their_rate(name: str) -> None:
    inside = sum(abs(score(calibration, name, TRUTH[name])) < 1.96 for calibration in calibrations())
    # Binomial of 60 draws: 50 or fewer with a chance of 7e-4.
    assert inside >= 51


@pytest.mark.parametrize("name", TRUTH)
def test_every_seed_is_within_five_standard_errors(name: str) -> None:
    # 6e-7 each for normal errors.
    assert max(abs(score(calibration, name, TRUTH[name])) for calibration in calibrations()) < 5.0


def test_joint_covariance_fits_the_errors_together() -> None:
    squares = []
    for calibration in calibrations():
        names = calibration.covariance.names
        assert set(names) == set(TRUTH)
        error = np.array([estimate(calibration, name).value - TRUTH[name] for name in names])
        squares.append(error @ np.linalg.solve(calibration.covariance.matrix, error))
    # Chi-squared of 6: mean 6, variance 12; 4 sigma of 60. Read noise and gain go together by -0.9: taken as
    # independent, the mean would be far from 6.
    assert np.mean(squares) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / N_SEEDS))


def test_diagonal_of_the_covariance_holds_the_squared_standard_errors() -> None:
    calibration = calibrations()[0]
    errors = [estimate(calibration, name).std_error for name in calibration.covariance.names]
    np.testing.assert_allclose(np.sqrt(np.diag(calibration.covariance.matrix)), errors, rtol=1e-12)


def test_estimates_say_how_many_frames_they_are_from() -> None:
    calibration = calibrations()[0]
    # 12 exposures, eleven with two flats and two darks, one with sixteen of each; none above 80 % of full scale.
    # The gain's range ends at 3228 DN: all 38 flats and 38 darks.
    assert estimate(calibration, "gain_dn_per_e").n == 76
    assert estimate(calibration, "read_noise_e").n == 38
    assert estimate(calibration, "prnu").n == 32
    assert estimate(calibration, "dsnu_e").n == 16


def large_sweep(sensor: SyntheticSensor, *, seed: int = 1, flicker: float = 0.0) -> NoiseCalibration:
    camera = SyntheticCamera(replace(sensor, shape=(160, 160)), seed)
    levels = camera.sweep(signals_e=SATURATING_SIGNALS_E, exposures_s=SATURATING_EXPOSURES_S, flicker=flicker, stack=8)
    return calibrate_noise(levels, bit_depth=12)


def test_a_lamp_sweep_at_one_exposure_with_more_dark_exposures() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(160, 160)), 11)
    flats = [camera.level(2, kind="flat", light_e=light_e, exposure_s=0.01) for light_e in SIGNALS_E]
    darks = [camera.level(4, kind="dark", light_e=0.0, exposure_s=time_s) for time_s in (0.01, 0.1, 0.5, 1.0)]
    calibration = calibrate_noise([*flats, *darks], bit_depth=12)
    # No light is known: no response, and the cubic term is fitted.
    assert calibration.transfer.linearity is None
    for name in ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s"):
        assert abs(score(calibration, name, TRUTH[name])) < 4.0
    by_mean, by_variance = (calibration.emva1288[f"dark_current_{how}_e_per_s"] for how in ("mean", "variance"))
    assert by_mean is not None
    assert by_variance is not None
    assert by_mean.value == pytest.approx(400.0, rel=0.03)
    # 500 e- of variance over 100 e- of read noise: pairs of 25 600 pixels know it to a per cent.
    assert by_variance.value == pytest.approx(400.0, rel=0.05)


@pytest.mark.parametrize("flicker", [0.003, 0.02])
def test_a_lamp_that_flickers_leaves_gain_and_read_noise(flicker: float) -> None:
    calibration = large_sweep(SyntheticSensor(), flicker=flicker)
    assert abs(score(calibration, "gain_dn_per_e", 0.25)) < 5.0
    assert abs(score(calibration, "read_noise_e", 10.0)) < 5.0


def test_low_gain_with_noise_below_a_count() -> None:
    # 0.78 DN of dark noise: rounding adds a seventh to its variance, and is taken off once.
    sensor = SyntheticSensor(gain_dn_per_e=0.06, read_noise_e=13.0)
    camera = SyntheticCamera(replace(sensor, shape=(160, 160)), 2)
    signals_e = tuple(float(signal) for signal in np.linspace(2000.0, 60_000.0, 12))
    exposures_s = tuple(signal / 1e6 for signal in signals_e)
    calibration = calibrate_noise(camera.sweep(signals_e=signals_e, exposures_s=exposures_s), bit_depth=12)
    assert abs(score(calibration, "gain_dn_per_e", 0.06)) < 5.0
    assert abs(score(calibration, "read_noise_e", 13.0)) < 5.0


def test_saturation_of_the_converter() -> None:
    calibration = large_sweep(SyntheticSensor())
    # The peak is where clipping begins: 4095 DN less black, less about 1.5 of its noise of 32 DN.
    found = estimate(calibration, "saturation_e")
    assert abs(found.value - (4095.0 - 60.0 - 48.0) / 0.25) < np.sqrt(3.0) * found.std_error
    assert "saturated_levels" in {flag.name for flag in calibration.flags}


def two_percent_low_at_saturation(signal_dn: NDArray[np.float64]) -> NDArray[np.float64]:
    return signal_dn * (1.0 - 0.02 * (signal_dn / 4035.0) ** 2)


def test_a_response_that_is_two_percent_low_at_saturation() -> None:
    sensor = SyntheticSensor(response=two_percent_low_at_saturation, shape=(480, 640))
    levels = SyntheticCamera(sensor, 1).sweep(
        signals_e=SATURATING_SIGNALS_E, exposures_s=SATURATING_EXPOSURES_S, stack=2
    )
    found = estimate(calibrate_noise(levels, bit_depth=12), "gain_dn_per_e")
    # A line through the origin is 2.1 % low, line and bend together 1.1 % high (even weights up to u = 0.8: 0.1 * 0.8^2
    # / 6). The standard error of 12 points with 0.26 % each is twice their mean's: 0.15 %, 3 sigma.
    assert found.value == pytest.approx(0.25, rel=0.005)
    assert abs(found.value - 0.25) < 4.0 * found.std_error
    assert found.std_error / 0.25 < 0.0025


def test_spreading_charge_is_told_from_the_response() -> None:
    camera = SyntheticCamera(SyntheticSensor(response=two_percent_low_at_saturation, shape=(320, 400)), 5)
    spreading = [
        replace(
            level,
            temporal_variance_dn2=level.temporal_variance_dn2 * (1.0 - 0.08 * (level.mean_dn - 60.0) / 3000.0),
        )
        if level.kind == "flat"
        else level
        for level in camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S, stack=2)
    ]
    calibration = calibrate_noise(spreading, bit_depth=12)
    found = brighter_fatter(calibration.transfer)
    assert found is not None
    assert abs(found.value + 0.08 * found.signal_dn / 3000.0) < 4.0 * found.std_error
    assert found.std_error < 0.02
    assert abs(score(calibration, "gain_dn_per_e", 0.25)) < 4.0


def test_points_that_scatter_make_the_error_bar_of_the_gain() -> None:
    scores = []
    for seed, sweep in enumerate(sweeps()):
        draws = np.random.default_rng(1000 + seed)
        levels = [
            replace(level, temporal_variance_dn2=level.temporal_variance_dn2 * (1.0 + 0.06 * draws.standard_normal()))
            if level.kind == "flat"
            else level
            for level in sweep
        ]
        scores.append(score(calibrate_noise(levels, bit_depth=12), "gain_dn_per_e", 0.25))
    # About 10 degrees of freedom behind the error bar: variance near 10 / 8, excess kurtosis 1; 4 sigma of 60.
    assert abs(np.mean(scores)) < 4.0 * np.sqrt(1.25 / N_SEEDS)
    assert np.var(scores, ddof=1) == pytest.approx(1.25, abs=4.0 * 1.25 * np.sqrt(3.0 / N_SEEDS))
