"""Stated intervals of 95 % hold the truth at their rate, case by case: binomial at 1e-3."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from calibration.estimate import Estimate
from calibration.sensor.levels import LevelStatistics
from calibration.sensor.noise import NoiseCalibration, Performance, calibrate_noise
from tests.calibration.sensor.synthetic_sensor import EXPOSURES_S, SIGNALS_E, SyntheticCamera, SyntheticSensor

FloatArray = NDArray[np.float64]
N_SEEDS = 50
# 43 or more of 50: fewer have a chance of 1e-3.
LEAST_INSIDE = int(binom.ppf(1e-3, N_SEEDS, 0.95))
EFFICIENCY = 0.45
GAIN, READ_NOISE_E = 0.25, 10.0
LEVELS = Callable[[int], list[LevelStatistics]]


def low_at_saturation(signal_dn: FloatArray) -> FloatArray:
    return signal_dn * (1.0 - 0.02 * (signal_dn / 4035.0) ** 2)


def clean(seed: int) -> list[LevelStatistics]:
    levels = SyntheticCamera(SyntheticSensor(), 9000 + seed).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    # Light of 1e6 e-/s: photons as an ideal meter would say.
    return [
        replace(level, photons=1e6 * level.exposure_s / EFFICIENCY)
        if level.kind == "flat" and level.exposure_s
        else level
        for level in levels
    ]


def bent(seed: int) -> list[LevelStatistics]:
    sensor = SyntheticSensor(response=low_at_saturation)
    return SyntheticCamera(sensor, 9000 + seed).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)


def flickering(seed: int) -> list[LevelStatistics]:
    camera = SyntheticCamera(SyntheticSensor(), 9000 + seed)
    return camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S, flicker=0.003)


def lamp_swept(seed: int) -> list[LevelStatistics]:
    camera = SyntheticCamera(SyntheticSensor(), 9000 + seed)
    flats = [camera.level(2, kind="flat", light_e=light_e, exposure_s=0.01) for light_e in SIGNALS_E]
    darks = [camera.level(4, kind="dark", light_e=0.0, exposure_s=time_s) for time_s in (0.01, 0.1, 0.5, 1.0)]
    return [*flats, *darks]


def unevenly_lit(seed: int) -> list[LevelStatistics]:
    camera = SyntheticCamera(SyntheticSensor(), 9000 + seed)
    camera.response_map *= np.linspace(0.97, 1.03, camera.sensor.shape[1])
    return camera.sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)


def in_bursts(seed: int) -> list[LevelStatistics]:
    camera = SyntheticCamera(SyntheticSensor(), 9000 + seed)
    return camera.sweep(signals_e=SIGNALS_E[::2], exposures_s=EXPOSURES_S[::2], stack=2) + [
        camera.level(6, kind="flat", light_e=light_e, exposure_s=light_e / 1e6) for light_e in SIGNALS_E[1::2]
    ]


@cache
def calibrations(case: LEVELS) -> tuple[NoiseCalibration, ...]:
    return tuple(calibrate_noise(case(seed), bit_depth=12) for seed in range(N_SEEDS))


def inside(found: list[Estimate | None], truth: float) -> int:
    assert None not in found
    return sum(abs(one.value - truth) < 1.96 * one.std_error for one in found if one is not None)


@pytest.mark.parametrize("case", [bent, flickering, lamp_swept, unevenly_lit, in_bursts])
@pytest.mark.parametrize(("name", "truth"), [("gain_dn_per_e", GAIN), ("read_noise_e", READ_NOISE_E)])
def test_gain_and_read_noise(case: LEVELS, name: str, truth: float) -> None:
    assert inside([getattr(one, name) for one in calibrations(case)], truth) >= LEAST_INSIDE


def test_scores_of_the_gain_where_the_response_is_bent() -> None:
    scores = np.array([(one.gain_dn_per_e.value - GAIN) / one.gain_dn_per_e.std_error for one in calibrations(bent)])
    # As without a bend: 4 sigma of 50 normal draws.
    assert abs(scores.mean()) < 4.0 / np.sqrt(N_SEEDS)
    assert abs(scores.var(ddof=1) - 1.0) < 4.0 * np.sqrt(2.0 / (N_SEEDS - 1))


def test_prnu_in_uneven_light() -> None:
    # With the shading of 6 % the spatial variance is four times that of the pixels alone.
    assert inside([one.prnu for one in calibrations(unevenly_lit)], 0.01) >= LEAST_INSIDE


def test_prnu_of_a_bent_response() -> None:
    # As measured it is 1.1 % too small where the fixed pattern is taken, and its error is 1.5 %.
    assert inside([one.prnu for one in calibrations(bent)], 0.01) >= LEAST_INSIDE


# The dark noise of 10 e- with 1/12 DN^2 of rounding, and half an electron.
THRESHOLD_E = 0.5 + np.sqrt(0.25 + READ_NOISE_E**2 + 1.0 / 12.0 / GAIN**2)


@pytest.mark.parametrize(
    ("name", "truth"),
    [("threshold_e", THRESHOLD_E), ("dark_current_variance_e_per_s", 400.0), ("quantum_efficiency", EFFICIENCY)],
)
def test_figures_of_merit(name: str, truth: float) -> None:
    found = [getattr(one.performance, name) for one in calibrations(clean)]
    assert inside(found, truth) >= LEAST_INSIDE


def test_the_disagreement_of_dark_currents_is_a_standard_score() -> None:
    scores = np.array([one.performance.dark_current_disagreement for one in calibrations(clean)])
    # 4 sigma of 50 normal draws.
    assert abs(scores.mean()) < 4.0 / np.sqrt(N_SEEDS)
    assert scores.var(ddof=1) < 1.0 + 4.0 * np.sqrt(2.0 / N_SEEDS)


def test_what_does_not_exist_is_none() -> None:
    levels = [level for level in clean(0) if level.kind == "flat" or level.exposure_s == EXPOSURES_S[0]]
    found: Performance = calibrate_noise([replace(one, photons=None) for one in levels], bit_depth=12).performance
    assert found.dark_current_variance_e_per_s is None
    assert found.dark_current_disagreement is None
    assert found.quantum_efficiency is None
    # The sweep ends at three quarters of full scale.
    assert found.dynamic_range is None
    assert found.snr_max is None
