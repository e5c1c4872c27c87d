"""The standard's own figures: known truth, what they leave out, and their errors."""

from functools import cache

import numpy as np
import pytest

from calibration.sensor.emva1288 import EMVA_SYMBOLS, EmvaFigure, emva1288_figures
from calibration.sensor.levels import LevelStatistics, level_statistics
from tests.calibration.sensor.synthetic_sensor import (
    EXPOSURES_S,
    SATURATING_EXPOSURES_S,
    SATURATING_SIGNALS_E,
    SIGNALS_E,
    SyntheticCamera,
    SyntheticSensor,
)

EFFICIENCY = 0.4


def levels(sensor: SyntheticSensor, *, seed: int, photons: bool = True) -> list[LevelStatistics]:
    camera = SyntheticCamera(sensor, seed)
    found = []
    for index, (light_e, exposure_s) in enumerate(zip(SATURATING_SIGNALS_E, SATURATING_EXPOSURES_S, strict=True)):
        for n in (2, 16) if index == 6 else (2,):
            bright = camera.frames(n, light_e=light_e, exposure_s=exposure_s)
            dark = camera.frames(n, light_e=0.0, exposure_s=exposure_s)
            stated = light_e / EFFICIENCY if photons else None
            found.append(level_statistics(bright, kind="flat", exposure_s=exposure_s, photons=stated))
            found.append(level_statistics(dark, kind="dark", exposure_s=exposure_s))
    return found


def figures(given: list[LevelStatistics]) -> dict[str, EmvaFigure | None]:
    flats = [level for level in given if level.kind == "flat"]
    return emva1288_figures(flats, [level for level in given if level.kind == "dark"], ceiling_dn=4095)


@cache
def linear() -> dict[str, EmvaFigure | None]:
    return figures(levels(SyntheticSensor(shape=(160, 160)), seed=3))


# Dark noise: 10 e- are 2.5 DN, and rounding adds 1/12 DN^2.
TRUTH = {
    "gain_dn_per_e": 0.25,
    "responsivity_dn_per_photon": 0.1,
    "quantum_efficiency": EFFICIENCY,
    "temporal_dark_noise_dn": np.sqrt(6.25 + 1.0 / 12.0),
    "temporal_dark_noise_e": 10.0,
    "threshold_e": np.sqrt(6.25 + 1.0 / 12.0) / 0.25 + 0.5,
    "threshold_photons": (np.sqrt(6.25 + 1.0 / 12.0) / 0.25 + 0.5) / EFFICIENCY,
    "dark_current_mean_e_per_s": 400.0,
    "dark_current_variance_e_per_s": 400.0,
    "prnu": 0.01,
    "prnu_pixel": 0.01,
    "dsnu_e": 4.0,
    "dsnu_pixel_e": 4.0,
}


@pytest.mark.parametrize("name", TRUTH)
def test_truth_is_within_the_errors(name: str) -> None:
    found = linear()[name]
    assert found is not None
    assert found.std_error is not None
    # A jackknife of a dozen levels knows its error to a quarter: 5 of them.
    assert abs(found.value - TRUTH[name]) < 5.0 * found.std_error
    assert found.std_error < 0.02 * TRUTH[name] or name.startswith("dark_current")


def test_saturation_is_a_level_of_the_sweep() -> None:
    found = linear()["saturation_photons"]
    assert found is not None
    assert found.value * EFFICIENCY in SATURATING_SIGNALS_E
    # The converter ends at 16 140 e-.
    assert 13_500.0 <= found.value * EFFICIENCY <= 16_140.0


def test_ratios_are_those_of_their_parts() -> None:
    found = {name: figure.value for name, figure in linear().items() if figure is not None}
    assert found["dynamic_range"] == pytest.approx(found["saturation_photons"] / found["threshold_photons"], rel=1e-12)
    assert found["snr_max"] == pytest.approx(found["saturation_e"] ** 0.5, rel=1e-12)


def test_a_linear_sensor_has_no_linearity_error() -> None:
    low, high = linear()["linearity_error_min"], linear()["linearity_error_max"]
    assert low is not None
    assert high is not None
    # Means of 2 x 25 600 pixels: 0.01 % at mid-scale, 0.03 % at 5 %; 4 sigma.
    assert -0.0012 < low.value <= 0.0 <= high.value < 0.0012


def test_a_bent_response_shows_in_the_linearity_error_and_in_a_low_gain() -> None:
    sensor = SyntheticSensor(shape=(160, 160), response=lambda dn: dn * (1.0 - 0.02 * (dn / 4035.0) ** 2))
    found = figures(levels(sensor, seed=4))
    gain, low = found["gain_dn_per_e"], found["linearity_error_min"]
    assert gain is not None
    assert low is not None
    # 0.1 u^2 weighted by signal^2 up to 0.7: 2.9 %; a smaller saturation level makes it 2.3 %. One sigma is 0.3 %.
    assert -0.04 < gain.value / 0.25 - 1.0 < -0.013
    assert low.value < -0.002


def test_without_photons_there_is_no_efficiency_and_all_else() -> None:
    found = figures(levels(SyntheticSensor(), seed=5, photons=False))
    assert {name for name, figure in found.items() if figure is None} >= {
        "responsivity_dn_per_photon",
        "quantum_efficiency",
        "threshold_photons",
        "saturation_photons",
    }
    assert found["saturation_e"] is not None
    assert found["linearity_error_max"] is not None


def test_saturation_that_is_not_reached_is_not_reported() -> None:
    sweep = SyntheticCamera(SyntheticSensor(), 6).sweep(signals_e=SIGNALS_E, exposures_s=EXPOSURES_S)
    found = figures(sweep)
    assert found["gain_dn_per_e"] is not None
    assert all(found[name] is None for name in ("saturation_e", "dynamic_range", "snr_max", "linearity_error_min"))


def test_two_dark_exposures_give_no_dark_current() -> None:
    sweep = levels(SyntheticSensor(), seed=7)
    few = [level for level in sweep if level.kind == "flat" or level.exposure_s in EXPOSURES_S[:2]]
    found = figures(few)
    assert found["dark_current_mean_e_per_s"] is None
    assert found["temporal_dark_noise_e"] is not None


def test_dark_noise_below_rounding_is_capped() -> None:
    found = figures(levels(SyntheticSensor(read_noise_e=0.4, dark_current_e_per_s=0.0, dsnu_e=0.0), seed=8))
    noise = found["temporal_dark_noise_dn"]
    assert noise is not None
    assert noise.value == pytest.approx(0.24**0.5, rel=1e-12)


def test_rows_and_columns_are_told_apart() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=(200, 160), prnu=0.0), 9)
    draws = np.random.default_rng(10)
    camera.response_map = (
        1.0
        + 0.02 * draws.standard_normal((200, 1))
        + 0.01 * draws.standard_normal((1, 160))
        + 0.005 * draws.standard_normal((200, 160))
    )
    found = figures(camera.sweep(signals_e=SIGNALS_E[:8], exposures_s=EXPOSURES_S[:8]))
    for name, truth in (("prnu_row", 0.02), ("prnu_column", 0.01), ("prnu_pixel", 0.005)):
        figure = found[name]
        assert figure is not None
        assert figure.std_error is not None
        assert abs(figure.value - truth) < 4.0 * figure.std_error


def test_every_name_has_a_place() -> None:
    assert set(linear()) == set(EMVA_SYMBOLS)
