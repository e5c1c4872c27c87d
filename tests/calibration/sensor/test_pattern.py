"""Fixed patterns that were put there: spectrograms, histograms, defects, and the DSNU and PRNU of all other pixels."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.sensor.levels import LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise
from calibration.sensor.pattern import Defect, FixedPattern, fixed_pattern, pattern_flags, spectrogram
from tests.calibration.sensor.synthetic_sensor import EXPOSURES_S, SIGNALS_E, SyntheticCamera, SyntheticSensor

SHAPE = (120, 160)
N_PIXELS = SHAPE[0] * SHAPE[1]
N_FRAMES = 16
NOISE_DN = 4.0


def level(
    *, mean_dn: float, pattern: NDArray[np.float64], seed: int, n: int = N_FRAMES, noise: object = NOISE_DN
) -> LevelStatistics:
    draws = np.random.default_rng(seed)
    frames = [
        np.rint(mean_dn + pattern + np.asarray(noise) * draws.standard_normal(SHAPE)).astype(np.uint16)
        for _ in range(n)
    ]
    return level_statistics(frames, kind="flat" if mean_dn > 500.0 else "dark", exposure_s=0.01, keep_picture=True)


def found(
    dark_pattern: object = 0.0, flat_pattern: object = 0.0, *, n: int = N_FRAMES, noise: object = 4.0
) -> FixedPattern:
    blank = np.zeros(SHAPE)
    dark = level(mean_dn=60.0, pattern=blank + np.asarray(dark_pattern), seed=1, n=n, noise=noise)
    flat = level(mean_dn=1060.0, pattern=blank + np.asarray(dark_pattern) + np.asarray(flat_pattern), seed=2, n=n)
    pattern = fixed_pattern(dark, flat)
    assert pattern is not None
    return pattern


@cache
def clean() -> FixedPattern:
    return found(5.0 * np.random.default_rng(3).standard_normal(SHAPE))


def test_independent_pixels_have_a_level_spectrum() -> None:
    # Pattern of 5 DN, and 4 DN of noise over 16 frames; rounding adds nothing that shows.
    expected = np.hypot(5.0, NOISE_DN / 4.0)
    # Mean power over 120 rows: an error of 1 / sqrt(120) of a power, half of it of the amplitude; 5 sigma, 80 of them.
    np.testing.assert_allclose(clean().dark_rows.amplitude, expected, rtol=5.0 * 0.5 / np.sqrt(120.0))


def test_the_power_of_all_frequencies_is_the_variance() -> None:
    picture = np.random.default_rng(4).standard_normal((40, 50)).astype(np.float32)
    spectrum = spectrogram(picture, along=1)
    power = np.square(spectrum.amplitude)
    # Parseval: each frequency but the last of an even number stands for two; the first, of rows' means, is left out.
    of_rows = float(np.square(picture.mean(axis=1) - picture.mean()).mean())
    total = (2.0 * power.sum() - power[-1]) / 50.0
    # Single precision of the picture: 1e-7.
    assert total + of_rows == pytest.approx(float(picture.var()), rel=1e-5)


def test_a_sine_stands_at_its_frequency() -> None:
    x = np.arange(SHAPE[1])
    striped = found(5.0 * np.sin(2.0 * np.pi * 0.25 * x))
    spectrum = striped.dark_rows
    peak = int(np.argmax(spectrum.amplitude))
    assert spectrum.frequency_per_pixel[peak] == pytest.approx(0.25)
    # A sine of amplitude a has a^2 / 4 times the number of pixels of a line in its frequency.
    assert spectrum.amplitude[peak] == pytest.approx(0.5 * 5.0 * np.sqrt(SHAPE[1]), rel=0.05)


def speckled() -> NDArray[np.float64]:
    dark = 2.0 * np.random.default_rng(7).standard_normal(SHAPE)
    dark[5::20, 5::20] += 100.0
    return dark


COLUMNS = np.broadcast_to(5.0 * np.random.default_rng(5).standard_normal((1, SHAPE[1])), SHAPE)


@pytest.mark.parametrize(
    ("pattern", "n_frames", "names"),
    [
        (5.0 * np.random.default_rng(3).standard_normal(SHAPE), N_FRAMES, set()),
        (COLUMNS, N_FRAMES, set()),  # columns of their own are not periodic
        (5.0 * np.sin(2.0 * np.pi * 0.25 * np.arange(SHAPE[1])), N_FRAMES, {"periodic_pattern"}),
        (speckled(), N_FRAMES, {"defect_pixels"}),
        (0.0, 4, {"short_stack"}),
    ],
    ids=["good", "columns", "sine", "defects", "short stack"],
)
def test_flags_of_a_fixed_pattern(pattern: object, n_frames: int, names: set[str]) -> None:
    assert {flag.name for flag in pattern_flags(found(pattern, n=n_frames))} == names


def test_a_good_pattern_and_noise_below_a_count_have_no_defects() -> None:
    assert clean().defects.n_defect == 0
    assert not clean().defects.mask.any()
    # Most pixels never change, some by one count.
    assert found(np.full(SHAPE, 0.3), noise=0.15).defects.n_defect == 0


def test_each_defect_is_found_by_its_kind() -> None:
    dark, flat, noise = np.zeros(SHAPE), np.zeros(SHAPE), np.full(SHAPE, NOISE_DN)
    dark += 2.0 * np.random.default_rng(6).standard_normal(SHAPE)
    dark[10, 20] += 40.0
    dark[30, 40] -= 40.0
    flat[50, 60] += 60.0
    flat[70, 80] -= 60.0
    noise[90, 100] = 5.0 * NOISE_DN
    defects = found(dark, flat, noise=noise).defects
    for (y, x), kind in {
        (10, 20): Defect.HOT,
        (30, 40): Defect.COLD,
        (50, 60): Defect.BRIGHT,
        (70, 80): Defect.WEAK,
        (90, 100): Defect.NOISY,
    }.items():
        assert defects.mask[y, x] & kind.value
    assert defects.counts["bright"] == defects.counts["weak"] == 1
    # The noisy pixel may look hot, cold or jumping too; no other does.
    assert defects.n_defect == 5


def test_a_line_sensor_has_one_spectrum() -> None:
    row = np.random.default_rng(8).standard_normal((1, 64)).astype(np.float32)
    assert spectrogram(row, along=1).amplitude.shape == (32,)
    assert spectrogram(row, along=0).amplitude.size == 0
    assert spectrogram(row, along=0).median == 0.0


@pytest.mark.parametrize("name", ["dark_histogram", "response_histogram"])
def test_a_histogram_counts_each_pixel_once(name: str) -> None:
    histogram = getattr(clean(), name)
    assert histogram.counts.sum() == N_PIXELS
    assert histogram.at_least[0] == N_PIXELS
    assert np.all(np.diff(histogram.at_least) <= 0)
    assert np.all(np.diff(histogram.reach) >= 0)


def test_the_width_of_a_histogram_is_that_of_the_pixels() -> None:
    # Against the mean of 24 others, a pixel deviates by sqrt(25 / 24) of its own deviation. Quartiles of 19 200 normal
    # draws: 1.2 / sqrt(2 N) = 0.6 %; 4 sigma.
    expected = np.hypot(5.0, NOISE_DN / 4.0) * np.sqrt(25.0 / 24.0)
    assert clean().dark_histogram.sigma == pytest.approx(expected, rel=0.025)
    assert clean().dark_histogram.normal_counts.sum() == pytest.approx(N_PIXELS, rel=0.01)


def test_levels_without_pictures_have_no_maps() -> None:
    frames = [np.full((4, 4), value, dtype=np.uint16) for value in (60, 61)]
    dark = level_statistics(frames, kind="dark", exposure_s=0.01)
    assert fixed_pattern(dark, dark) is None


Frame = NDArray[np.uint16]
DEFECT_SHAPE = (96, 96)
# 9 of 9216 pixels, about a thousandth.
PLACES = (slice(5, None, 32), slice(7, None, 32))
DSNU_E, PRNU = 4.0, 0.01


def hot(frame: Frame) -> Frame:
    changed = frame.copy()
    changed[PLACES] = np.minimum(changed[PLACES] + np.uint16(300), np.uint16(4095))
    return changed


def dead(frame: Frame) -> Frame:
    changed = frame.copy()
    # A tenth of the light, and what noise it has.
    changed[PLACES] = np.rint(60.0 + (changed[PLACES] - 60.0) / 10.0).astype(np.uint16)
    return changed


@cache
def calibration(kind: str) -> NoiseCalibration:
    camera = SyntheticCamera(SyntheticSensor(shape=DEFECT_SHAPE, dsnu_e=DSNU_E, prnu=PRNU), 41)
    change = {"hot": hot, "dead": dead, "none": np.copy}[kind]
    levels: list[LevelStatistics] = []
    for index, (light_e, exposure_s) in enumerate(zip(SIGNALS_E, EXPOSURES_S, strict=True)):
        for level_kind, electrons in (("flat", light_e), ("dark", 0.0)):
            frames = camera.frames(16 if index == 6 else 2, light_e=electrons, exposure_s=exposure_s)
            levels.append(
                level_statistics(
                    map(change, frames), kind="flat" if level_kind == "flat" else "dark", exposure_s=exposure_s
                )
            )
    return calibrate_noise(levels, bit_depth=12)


@pytest.mark.parametrize("kind", ["hot", "dead", "none"])
@pytest.mark.parametrize(("name", "truth"), [("dsnu_e", DSNU_E), ("prnu", PRNU), ("gain_dn_per_e", 0.25)])
def test_the_others_are_as_they_are_without_defects(kind: str, name: str, truth: float) -> None:
    found = getattr(calibration(kind), name)
    # Of 300 DN in a thousandth of the pixels the DSNU would be 38 e-, of dead ones the PRNU 3 %.
    assert abs(found.value - truth) < 4.0 * found.std_error
    assert found.std_error < 0.03 * truth


@pytest.mark.parametrize(("kind", "stack"), [("hot", "dark"), ("dead", "flat")])
def test_they_are_counted_and_named(kind: str, stack: str) -> None:
    flag = next(flag for flag in calibration(kind).flags if flag.name == "defect_pixels")
    assert f"9 in the {stack} stack" in flag.message
    assert not flag.refuses


def test_a_sensor_without_defects_has_none() -> None:
    found = calibration("none")
    assert {level.ordinary.left_out for level in (*found.flats, *found.darks)} == {0}
    assert "defect_pixels" not in {flag.name for flag in found.flags}


def test_the_standards_own_numbers_hold_them() -> None:
    figure = calibration("hot").emva1288["dsnu_e"]
    assert figure is not None
    # 300 DN, 1200 e-, in 9 of 9216 pixels.
    assert figure.value == pytest.approx(np.hypot(DSNU_E, 1200.0 * np.sqrt(9.0 / 9216.0)), rel=0.05)


def test_a_dark_corner_is_no_defect() -> None:
    camera = SyntheticCamera(SyntheticSensor(shape=DEFECT_SHAPE), 42)
    camera.response_map[:20, :20] *= 0.7
    level = camera.level(16, kind="flat", light_e=8000.0, exposure_s=0.008)
    # 4 % of the pixels: shading, which the smooth part of the pattern shows.
    assert level.ordinary.left_out == 0
