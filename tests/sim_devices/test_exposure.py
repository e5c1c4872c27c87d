"""Moments of frames against numbers worked out by hand.

Sampling errors of n pixels: sqrt(variance / n) for the mean and variance * sqrt(2 / n) for the variance (normal law;
the excess kurtosis of these Poisson draws changes it by less than 1 %). Five of them are allowed.
"""

from dataclasses import replace

import numpy as np
import pytest

from sim_devices.exposure import FixedPattern, Shot, exposure_effects
from tests.sim_devices.camera_builders import LENS, SILENT, Turntable, camera_on, uniform_world

PIXELS = 160_000
SHOT = Shot(noise=np.random.default_rng(1), noise_seed=1, sequence=0, exposure_s=1e-3, axis_deg=0.0)


def frames_of(detector, *, subject, count=1, exposure_s=1e-3, gain_db=0.0):
    world = uniform_world()
    world.present(subject)
    camera = camera_on(world, detector)
    camera.configure(exposure_s=exposure_s, gain_db=gain_db)
    return [camera.take_frame(timeout_s=1.0).counts.astype(np.float64) for _ in range(count)]


def assert_moments(values, *, mean, variance):
    assert abs(values.mean() - mean) < 5 * np.sqrt(variance / PIXELS)
    assert abs(values.var() - variance) < 5 * variance * np.sqrt(2 / PIXELS)


def test_light_is_poisson():
    (frame,) = frames_of(SILENT, subject="flat")
    # 1976.893 electrons at 2 DN each over 100 DN: 100 + 3953.786, and 2^2 * 1976.893. Counts are whole: no 1/12.
    assert_moments(frame, mean=4053.786, variance=7907.572)


def test_few_electrons_are_poisson_too():
    (frame,) = frames_of(SILENT, subject="flat", exposure_s=1e-6)
    # 1.976893 electrons; excess kurtosis 1 / 1.977 makes the variance of a variance (2 + 0.506) / n.
    electrons = (frame - 100.0) / 2.0
    assert abs(electrons.mean() - 1.976893) < 5 * np.sqrt(1.976893 / PIXELS)
    assert abs(electrons.var() - 1.976893) < 5 * 1.976893 * np.sqrt(2.506 / PIXELS)
    assert np.mean(electrons == 0.0) == pytest.approx(0.138499, abs=5 * np.sqrt(0.1385 * 0.8615 / PIXELS))


def test_dark_electrons_grow_with_exposure_and_bring_shot_noise():
    detector = replace(SILENT, dark_current_e_per_s=3000.0, read_noise_e=5.0)
    (short,) = frames_of(detector, subject="dark", exposure_s=1e-3)
    (long,) = frames_of(detector, subject="dark", exposure_s=0.1)
    # 3 and 300 electrons: 2^2 * (3 + 25) + 1/12 and 2^2 * (300 + 25) + 1/12
    assert_moments(short, mean=106.0, variance=112.0833)
    assert_moments(long, mean=700.0, variance=1300.0833)


def test_light_dark_electrons_and_read_noise_together():
    detector = replace(SILENT, dark_current_e_per_s=3000.0, read_noise_e=5.0)
    (frame,) = frames_of(detector, subject="flat")
    # 1979.893 electrons: 100 + 3959.786; 4 * (1979.893 + 25) + 1/12
    assert_moments(frame, mean=4059.786, variance=8019.655)


def test_camera_gain_multiplies_electrons_and_not_the_black_level():
    detector = replace(SILENT, gain_dn_per_e=0.2, read_noise_e=5.0)
    (frame,) = frames_of(detector, subject="flat", gain_db=20.0)
    # 20 dB: 0.2 becomes 2 DN an electron.
    assert_moments(frame, mean=4053.786, variance=4 * (1976.893 + 25.0) + 1 / 12)


def test_rounding_adds_a_twelfth_to_the_variance():
    (frame,) = frames_of(replace(SILENT, read_noise_e=0.4), subject="dark")
    # 0.8 DN of noise is enough dither: what is left is of the order exp(-2 pi^2 0.64) = 3e-6.
    assert_moments(frame, mean=100.0, variance=0.64 + 1 / 12)


@pytest.mark.parametrize(("black_level_dn", "count"), [(64.4, 64), (64.6, 65)])
def test_samples_are_rounded_to_the_nearest(black_level_dn, count):
    (frame,) = frames_of(replace(SILENT, black_level_dn=black_level_dn), subject="dark")
    assert np.all(frame == count)


def test_bits_end_where_they_end():
    (frame,) = frames_of(replace(SILENT, bit_depth=10), subject="flat")
    assert np.all(frame == 1023)


def test_full_well_ends_below_the_last_count():
    (frame,) = frames_of(replace(SILENT, full_well_e=1000.0), subject="flat")
    # 1976 electrons less 20 standard deviations are still more than 1000.
    assert np.all(frame == 2100)


def test_noise_below_black_is_cut_at_zero_and_does_not_wrap():
    (frame,) = frames_of(replace(SILENT, black_level_dn=0.0, read_noise_e=5.0), subject="dark")
    # 10 DN of noise: P(z < 0.05) = 0.51994 rounds to 0 or falls below; 8 standard deviations are 80 DN.
    assert np.mean(frame == 0) == pytest.approx(0.51994, abs=5 * 0.5 / np.sqrt(PIXELS))
    assert frame.max() < 80


def test_prnu_scales_light_and_drops_out_between_frames():
    first, second = frames_of(replace(SILENT, prnu=0.05), subject="flat", count=2)
    # In one frame 4 * (1976.893 + (0.05 * 1976.893)^2); between two, shot noise twice.
    assert_moments(first, mean=4053.786, variance=4 * (1976.893 + 9770.265))
    assert_moments(first - second, mean=0.0, variance=8 * 1976.893)


def test_prnu_does_not_show_in_the_dark():
    (frame,) = frames_of(replace(SILENT, prnu=0.05), subject="dark")
    assert np.all(frame == 100)


def test_dsnu_is_an_offset_that_drops_out_between_frames():
    detector = replace(SILENT, dsnu_e=20.0, read_noise_e=1.0)
    first, second = frames_of(detector, subject="dark", count=2)
    # In one frame 4 * (400 + 1) + 1/12. Between two twice 4 * 1 + 1/12.
    assert_moments(first, mean=100.0, variance=1604.0833)
    assert_moments(first - second, mean=0.0, variance=8.1667)


def test_fixed_pattern_is_common_to_all_angles():
    stage = Turntable()
    camera = camera_on(uniform_world(stage=stage), replace(SILENT, prnu=0.05, dsnu_e=20.0))
    camera.configure(exposure_s=1e-3, gain_db=0.0)
    first = camera.take_frame(timeout_s=1.0).counts.astype(np.float64)
    stage.angle_deg = 90.0
    second = camera.take_frame(timeout_s=1.0).counts.astype(np.float64)
    # Unpolarised light: shot noise and rounding twice, nothing of 4 * (9770 + 400) DN^2 of pattern.
    assert_moments(first - second, mean=0.0, variance=8 * 1976.893 + 2 / 12)


def effects_of(detector):
    pattern = FixedPattern(
        response=np.ones((1, 1)) if detector.prnu > 0 else None,
        offset_e=np.ones((1, 1)) if detector.dsnu_e > 0 else None,
    )
    return exposure_effects(lens=LENS, detector=detector, pattern=pattern, exposure_s=1e-3, gain_db=0.0)


@pytest.mark.parametrize(
    "effect",
    [
        {"prnu": 0.01},
        {"dsnu_e": 1.0},
        {"read_noise_e": 1.0},
        {"dark_current_e_per_s": 1.0},
        {"black_level_dn": 64.0},
    ],
)
def test_effect_that_is_not_there_is_not_called(effect):
    bare = replace(SILENT, black_level_dn=0.0)
    assert len(effects_of(replace(bare, **effect))) == len(effects_of(bare)) + 1


def test_radiance_is_left_as_it_was():
    radiance = np.full((2, 3), 0.02)
    picture = radiance
    for effect in effects_of(replace(SILENT, read_noise_e=1.0)):
        picture = effect(picture, SHOT)
    np.testing.assert_array_equal(radiance, 0.02)
