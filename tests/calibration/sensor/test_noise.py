"""Known truth is found again, and as far off as the standard errors say: each quantity on its own, case by case."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from calibration.estimate import Estimate
from calibration.results import CalibrationError
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

FloatArray = NDArray[np.float64]
Levels = list[LevelStatistics]
TRUTH = {
    "gain_dn_per_e": 0.25,
    "read_noise_e": 10.0,
    "dark_current_e_per_s": 400.0,
    "black_level_dn": 60.0,
    "prnu": 0.01,
    "dsnu_e": 4.0,
}
EFFICIENCY = 0.45
# The dark noise of 10 e- with 1/12 DN^2 of rounding, and half an electron.
THRESHOLD_E = 0.5 + np.sqrt(0.25 + 10.0**2 + 1.0 / 12.0 / 0.25**2)
N_CLEAN, N_OTHER = 60, 50


def low_at_saturation(signal_dn: FloatArray) -> FloatArray:
    """A response that is 2 % low at saturation."""
    return signal_dn * (1.0 - 0.02 * (signal_dn / 4035.0) ** 2)


def clean(camera: SyntheticCamera) -> Levels:
    """Light of 1e6 e-/s: photons as an ideal meter would say."""
    return [
        replace(one, photons=1e6 * (one.exposure_s or 0.0) / EFFICIENCY) if one.kind == "flat" else one
        for one in camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    ]


def bent(camera: SyntheticCamera) -> Levels:
    camera.sensor = replace(camera.sensor, response=low_at_saturation)
    return camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)


def flickering(camera: SyntheticCamera) -> Levels:
    return camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S, flicker=0.003)


def lamp_swept(camera: SyntheticCamera) -> Levels:
    flats = [camera.level(2, kind="flat", light_e=light_e, exposure_s=0.01) for light_e in SIGNALS_E]
    darks = [camera.level(4, kind="dark", light_e=0.0, exposure_s=time_s) for time_s in (0.01, 0.1, 0.5, 1.0)]
    return [*flats, *darks]


def unevenly_lit(camera: SyntheticCamera) -> Levels:
    """With the shading of 6 % the spatial variance is four times that of the pixels alone."""
    camera.response_map *= np.linspace(0.97, 1.03, camera.sensor.shape[1])
    return camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)


def in_bursts(camera: SyntheticCamera) -> Levels:
    return camera.sweep(signals_e=SIGNALS_E[::2], exposures_s=EXPOSURES_S[::2], stack=2) + [
        camera.level(6, kind="flat", light_e=light_e, exposure_s=light_e / 1e6) for light_e in SIGNALS_E[1::2]
    ]


Case = Callable[[SyntheticCamera], Levels]


@cache
def sweeps(case: Case) -> tuple[Levels, ...]:
    first, n = (0, N_CLEAN) if case is clean else (9000, N_OTHER)
    return tuple(case(SyntheticCamera(SyntheticSensor(), first + seed)) for seed in range(n))


@cache
def calibrations(case: Case) -> tuple[NoiseCalibration, ...]:
    return tuple(calibrate_noise(levels, bit_depth=12) for levels in sweeps(case))


def estimate(calibration: object, name: str) -> Estimate:
    found = getattr(calibration, name)
    assert isinstance(found, Estimate), name
    return found


def score(calibration: object, name: str, truth: float) -> float:
    found = estimate(calibration, name)
    return (found.value - truth) / found.std_error


def scores(found: Sequence[object], name: str, truth: float) -> FloatArray:
    return np.array([score(one, name, truth) for one in found])


def assert_covers(found: FloatArray) -> None:
    """Intervals of 95 % hold the truth at their rate: binomial at 1e-3."""
    assert np.count_nonzero(np.abs(found) < 1.96) >= binom.ppf(1e-3, len(found), 0.95)


@pytest.mark.slow
@pytest.mark.parametrize("name", TRUTH)
def test_scores_of_a_clean_sweep_are_those_of_a_normal_law(name: str) -> None:
    found = scores(calibrations(clean), name, TRUTH[name])
    # 4 sigma of 60 normal draws: 1 / sqrt(60) for the mean, sqrt(2 / 59) for the variance; 5 sigma of each.
    assert abs(found.mean()) < 4.0 / np.sqrt(N_CLEAN)
    assert abs(found.var(ddof=1) - 1.0) < 4.0 * np.sqrt(2.0 / (N_CLEAN - 1))
    assert np.abs(found).max() < 5.0
    assert_covers(found)


def test_joint_covariance_fits_the_errors_together() -> None:
    squares = []
    for calibration in calibrations(clean):
        names, matrix = calibration.covariance.names, calibration.covariance.matrix
        assert set(names) == set(TRUTH)
        error = np.array([estimate(calibration, name).value - TRUTH[name] for name in names])
        squares.append(error @ np.linalg.solve(matrix, error))
        errors = [estimate(calibration, name).std_error for name in names]
        np.testing.assert_allclose(np.sqrt(np.diag(matrix)), errors, rtol=1e-12)
    # Chi-squared of 6: mean 6, variance 12; 4 sigma of 60. Read noise and gain go together by -0.9: taken as
    # independent, the mean would be far from 6.
    assert np.mean(squares) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / N_CLEAN))


def test_estimates_say_how_many_frames_they_are_from() -> None:
    calibration = calibrations(clean)[0]
    # 12 exposures, eleven with two flats and two darks, one with sixteen of each; none above 80 % of full scale.
    frames = {"gain_dn_per_e": 76, "read_noise_e": 38, "prnu": 32, "dsnu_e": 16}
    assert {name: estimate(calibration, name).n for name in frames} == frames


@pytest.mark.slow
@pytest.mark.parametrize("case", [bent, flickering, lamp_swept, unevenly_lit, in_bursts])
@pytest.mark.parametrize("name", ["gain_dn_per_e", "read_noise_e"])
def test_gain_and_read_noise_of_other_sweeps(case: Case, name: str) -> None:
    assert_covers(scores(calibrations(case), name, TRUTH[name]))


@pytest.mark.parametrize("case", [clean, bent, lamp_swept])
def test_the_gain_of_flats_whose_black_level_is_stated(case: Case) -> None:
    found = []
    for seed, levels in enumerate(sweeps(case)):
        black = Estimate(value=60.0 + np.random.default_rng(seed).normal(0.0, 0.5), std_error=0.5, n=1)
        flats = [level for level in levels if level.kind == "flat"]
        found.append(calibrate_noise(flats, bit_depth=12, black_level_dn=black))
    assert_covers(scores(found, "gain_dn_per_e", 0.25))
    for one in found:
        missing = (one.read_noise_e, one.dark_current_e_per_s, one.dsnu_e, one.prnu, one.performance.threshold_e)
        assert missing == (None,) * 5
        assert one.bounds["prnu"].value > 0.01
        assert not {"read_noise_e", "dark_current_e_per_s", "dsnu_e"} & one.bounds.keys()


def test_the_response_is_the_same_without_darks() -> None:
    levels, black = sweeps(bent)[0], Estimate(value=60.0, std_error=0.5, n=1)
    flats = [level for level in levels if level.kind == "flat"]
    with_darks = calibrate_noise(levels, bit_depth=12).transfer.linearity
    without = calibrate_noise(flats, bit_depth=12, black_level_dn=black).transfer.linearity
    assert with_darks is not None
    assert without is not None
    error = np.sqrt(np.diag(with_darks.covariance + without.covariance))
    assert abs(without.quadratic_per_dn - with_darks.quadratic_per_dn) < error[0]
    assert abs(without.cubic_per_dn2 - with_darks.cubic_per_dn2) < error[1]


def test_a_level_of_other_noise_is_found_without_darks() -> None:
    flats = [level for level in sweeps(clean)[0] if level.kind == "flat"]
    flats[4] = replace(flats[4], temporal_variance_dn2=1.5 * flats[4].temporal_variance_dn2)
    found = calibrate_noise(flats, bit_depth=12, black_level_dn=Estimate(value=60.0, std_error=0.5, n=1))
    assert "wrong_variance" in {flag.name for flag in found.flags}
    assert abs(score(found, "gain_dn_per_e", 0.25)) < 4.0


def test_a_black_level_is_not_stated_beside_darks() -> None:
    with pytest.raises(CalibrationError, match="dark levels, which determine the black level"):
        calibrate_noise(sweeps(clean)[0], bit_depth=12, black_level_dn=Estimate(value=60.0, std_error=0.5, n=1))


def test_scores_of_the_gain_where_the_response_is_bent() -> None:
    found = scores(calibrations(bent), "gain_dn_per_e", 0.25)
    assert abs(found.mean()) < 4.0 / np.sqrt(N_OTHER)
    assert abs(found.var(ddof=1) - 1.0) < 4.0 * np.sqrt(2.0 / (N_OTHER - 1))


@pytest.mark.parametrize("case", [unevenly_lit, bent])
def test_prnu_in_uneven_light_and_of_a_bent_response(case: Case) -> None:
    # As measured that of the bent response is 1.1 % too small where the pattern is taken, and its error is 1.5 %.
    assert_covers(scores(calibrations(case), "prnu", 0.01))


@pytest.mark.parametrize(
    ("name", "truth"),
    [("threshold_e", THRESHOLD_E), ("dark_current_variance_e_per_s", 400.0), ("quantum_efficiency", EFFICIENCY)],
)
def test_figures_of_merit(name: str, truth: float) -> None:
    assert_covers(scores([one.performance for one in calibrations(clean)], name, truth))


def test_the_disagreement_of_dark_currents_is_a_standard_score() -> None:
    found = np.array([one.performance.dark_current_disagreement for one in calibrations(clean)])
    assert abs(found.mean()) < 4.0 / np.sqrt(N_CLEAN)
    assert found.var(ddof=1) < 1.0 + 4.0 * np.sqrt(2.0 / N_CLEAN)


def test_what_does_not_exist_is_none() -> None:
    levels = [level for level in sweeps(clean)[0] if level.kind == "flat" or level.exposure_s == EXPOSURES_S[0]]
    found = calibrate_noise([replace(one, photons=None) for one in levels], bit_depth=12).performance
    assert found.dark_current_variance_e_per_s is None
    assert found.dark_current_disagreement is None
    assert found.quantum_efficiency is None
    # The sweep ends at three quarters of full scale.
    assert found.dynamic_range is None
    assert found.snr_max is None


def test_points_that_scatter_make_the_error_bar_of_the_gain() -> None:
    found = []
    for seed, sweep in enumerate(sweeps(clean)):
        factors = 1.0 + 0.06 * np.random.default_rng(1000 + seed).standard_normal(len(sweep))
        levels = [
            replace(level, temporal_variance_dn2=level.temporal_variance_dn2 * factor)
            if level.kind == "flat"
            else level
            for level, factor in zip(sweep, factors.tolist(), strict=True)
        ]
        found.append(score(calibrate_noise(levels, bit_depth=12), "gain_dn_per_e", 0.25))
    # About 10 degrees of freedom behind the error bar: variance near 10 / 8, excess kurtosis 1; 4 sigma of 60.
    assert abs(np.mean(found)) < 4.0 * np.sqrt(1.25 / N_CLEAN)
    assert np.var(found, ddof=1) == pytest.approx(1.25, abs=4.0 * 1.25 * np.sqrt(3.0 / N_CLEAN))


def test_a_lamp_sweep_at_one_exposure_with_more_dark_exposures() -> None:
    calibration = calibrate_noise(lamp_swept(SyntheticCamera(SyntheticSensor(shape=(160, 160)), 11)), bit_depth=12)
    # No light is known: no response, and the cubic term is fitted.
    assert calibration.transfer.linearity is None
    for name in ("gain_dn_per_e", "read_noise_e", "dark_current_e_per_s"):
        assert abs(score(calibration, name, TRUTH[name])) < 4.0
    # 500 e- of variance over 100 e- of read noise: pairs of 25 600 pixels know it to a per cent.
    for how, tolerance in (("mean", 0.03), ("variance", 0.05)):
        figure = calibration.emva1288[f"dark_current_{how}_e_per_s"]
        assert figure is not None
        assert figure.value == pytest.approx(400.0, rel=tolerance)


@pytest.mark.parametrize("flicker", [0.0, 0.003, 0.02])
def test_flicker_leaves_gain_and_read_noise_and_saturation(flicker: float) -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(160, 160)), 1)
    calibration = calibrate_noise(
        camera.sweep(signals_e=SATURATING_SIGNALS_E, exposures_s=SATURATING_EXPOSURES_S, flicker=flicker, stack=8),
        bit_depth=12,
    )
    assert abs(score(calibration, "gain_dn_per_e", 0.25)) < 5.0
    assert abs(score(calibration, "read_noise_e", 10.0)) < 5.0
    # The peak is where clipping begins: 4095 DN less black, less about 1.5 of its noise of 32 DN.
    found = estimate(calibration, "saturation_e")
    assert flicker or abs(found.value - (4095.0 - 60.0 - 48.0) / 0.25) < np.sqrt(3.0) * found.std_error


def test_low_gain_with_noise_below_a_count() -> None:
    # 0.78 DN of dark noise: rounding adds a seventh to its variance, and is taken off once.
    camera = SyntheticCamera(SyntheticSensor(gain_dn_per_e=0.06, read_noise_e=13.0, shape=(160, 160)), 2)
    signals_e = np.linspace(2000.0, 60_000.0, 12).tolist()
    levels = camera.sweep(signals_e=signals_e, exposures_s=[one / 1e6 for one in signals_e])
    calibration = calibrate_noise(levels, bit_depth=12)
    assert abs(score(calibration, "gain_dn_per_e", 0.06)) < 5.0
    assert abs(score(calibration, "read_noise_e", 13.0)) < 5.0


def test_a_response_that_is_two_percent_low_at_saturation() -> None:
    camera = SyntheticCamera(SyntheticSensor(response=low_at_saturation, shape=(480, 640)), 1)
    levels = camera.sweep(signals_e=SATURATING_SIGNALS_E, exposures_s=SATURATING_EXPOSURES_S, stack=2)
    found = estimate(calibrate_noise(levels, bit_depth=12), "gain_dn_per_e")
    # A line through the origin is 2.1 % low, line and bend together 1.1 % high (even weights up to u = 0.8: 0.1 * 0.8^2
    # / 6). The standard error of 12 points with 0.26 % each is twice their mean's: 0.15 %, 3 sigma.
    assert found.value == pytest.approx(0.25, rel=0.005)
    assert abs(found.value - 0.25) < 4.0 * found.std_error
    assert found.std_error / 0.25 < 0.0025


def test_spreading_charge_is_told_from_the_response() -> None:
    camera = SyntheticCamera(SyntheticSensor(response=low_at_saturation, shape=(320, 400)), 5)
    spreading = [
        replace(one, temporal_variance_dn2=one.temporal_variance_dn2 * (1.0 - 0.08 * (one.mean_dn - 60.0) / 3000.0))
        if one.kind == "flat"
        else one
        for one in camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S, stack=2)
    ]
    calibration = calibrate_noise(spreading, bit_depth=12)
    found = brighter_fatter(calibration.transfer)
    assert found is not None
    value, error = found
    assert abs(value + 0.08 * calibration.transfer.top_dn / 3000.0) < 4.0 * error
    assert error < 0.02
    assert abs(score(calibration, "gain_dn_per_e", 0.25)) < 4.0
