"""Lens, detector and effects on a picture, against numbers worked out by hand.

Sampling errors of n pixels: sqrt(variance / n) for the mean and variance * sqrt(2 / n) for the variance (normal law;
the excess kurtosis of these Poisson draws changes it by less than 1 %). Five of them are allowed.
"""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from sim_devices.exposure import (
    Detector,
    FixedPattern,
    Lens,
    RenderingEffect,
    Shot,
    beam_wander,
    cosmic_hits,
    defocus,
    draw_fixed_pattern,
    drift,
    electrons_per_radiance_s,
    exposure_effects,
    fixed_pattern,
    point_spread,
    smear,
    vignetting,
)
from tests.sim_devices.camera_builders import (
    ELECTRONS_OF_FLAT_IN_1_MS,
    LENS,
    SILENT,
    Turntable,
    camera_on,
    uniform_world,
)

PIXELS = 160_000


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


def drawn(detector, seed=1):
    return draw_fixed_pattern(detector, generator=np.random.default_rng(seed))


def test_electrons_of_a_wide_lens_by_hand():
    # See camera_builders for the arithmetic; 12 digits were kept.
    assert electrons_per_radiance_s(LENS, SILENT) == pytest.approx(98844647.6619, rel=1e-12)


def test_fixed_pattern_has_the_spread_and_expectation_that_were_asked_for():
    pattern = drawn(replace(SILENT, prnu=0.02, dsnu_e=3.0))
    count = 160_000
    assert abs(pattern.response.mean() - 1.0) < 5 * 0.02 / np.sqrt(count)
    assert abs(pattern.response.std() - 0.02) < 5 * 0.02 / np.sqrt(2 * count)
    assert abs(pattern.offset_e.mean()) < 5 * 3.0 / np.sqrt(count)
    assert abs(pattern.offset_e.std() - 3.0) < 5 * 3.0 / np.sqrt(2 * count)


def test_response_and_offset_are_independent():
    pattern = drawn(replace(SILENT, prnu=0.02, dsnu_e=3.0))
    correlation = np.corrcoef(pattern.response.ravel(), pattern.offset_e.ravel())[0, 1]
    assert abs(correlation) < 5 / np.sqrt(160_000)


def test_offset_does_not_depend_on_whether_there_is_prnu():
    with_prnu = drawn(replace(SILENT, prnu=0.02, dsnu_e=3.0))
    without = drawn(replace(SILENT, dsnu_e=3.0))
    np.testing.assert_array_equal(with_prnu.offset_e, without.offset_e)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("width", 0),
        ("height", 0),
        ("pixel_pitch_m", 0.0),
        ("effective_wavelength_m", -5e-7),
        ("quantum_efficiency", 0.0),
        ("quantum_efficiency", 1.01),
        ("gain_dn_per_e", 0.0),
        ("gain_dn_per_e", float("inf")),
        ("read_noise_e", -1.0),
        ("read_noise_e", float("nan")),
        ("dark_current_e_per_s", -1.0),
        ("black_level_dn", -1.0),
        ("prnu", -0.01),
        ("prnu", 0.11),
        ("dsnu_e", -1.0),
        ("full_well_e", 0.0),
        ("bit_depth", 0),
        ("bit_depth", 17),
    ],
)
def test_detector_that_cannot_be_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is {value}; it must be"):
        Detector(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [("focal_length_m", 0.0), ("aperture_diameter_m", -0.01), ("transmittance", 0.0), ("transmittance", 1.1)],
)
def test_lens_that_cannot_be_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} is {value}; it must be"):
        Lens(**{name: value})


def shot(*, sequence=0, axis_deg=0.0, exposure_s=1e-3):
    return Shot(
        noise=np.random.default_rng(0), noise_seed=5, sequence=sequence, exposure_s=exposure_s, axis_deg=axis_deg
    )


def point(*, height=41, width=41, row=20, column=20):
    picture = np.zeros((height, width))
    picture[row, column] = 1000.0
    return picture


def centre(picture):
    rows, columns = np.indices(picture.shape)
    return (columns * picture).sum() / picture.sum(), (rows * picture).sum() / picture.sum()


def test_drift_compounds_from_frame_to_frame():
    effect = drift(rate_per_frame=0.01, flicker_std=0.0)
    picture = effect.act(np.full((2, 2), 100.0), shot(sequence=3))
    np.testing.assert_allclose(picture, 100.0 * np.exp(0.03), rtol=1e-15)


def test_flicker_has_its_deviation_and_no_memory():
    effect = drift(rate_per_frame=0.0, flicker_std=0.02)
    levels = np.log([effect.act(np.ones((1, 1)), shot(sequence=k))[0, 0] for k in range(2000)])
    assert abs(levels.std() - 0.02) < 5 * 0.02 / np.sqrt(2 * levels.size)
    assert abs(np.corrcoef(levels[1:], levels[:-1])[0, 1]) < 5 / np.sqrt(levels.size)


def test_point_spread_keeps_the_light_and_has_its_width():
    blurred = point_spread(sigma_px=1.5).act(point(), shot())
    assert blurred.sum() == pytest.approx(1000.0, rel=1e-12)
    columns = np.arange(41) - 20.0
    # A Gaussian sampled on pixels and cut at four deviations: its variance is 0.2 % below sigma^2.
    assert (blurred.sum(axis=0) @ columns**2) / 1000.0 == pytest.approx(2.25, rel=4e-3)


F_2 = {
    "lens": Lens(focal_length_m=0.05, aperture_diameter_m=0.025),
    "detector": dataclasses.replace(SILENT, pixel_pitch_m=5e-6),
}


@pytest.mark.parametrize("defocus_um", [120.0, -120.0])
def test_out_of_focus_a_point_is_an_even_disk_as_wide_as_the_cone_of_light(defocus_um):
    # At f/2 the cone is 60 um wide 120 um from its tip: 12 pixels of 5 um, on either side.
    blurred = defocus(F_2["lens"], F_2["detector"], defocus_m=lambda: defocus_um * 1e-6).act(point(), shot())
    assert blurred.sum() == pytest.approx(1000.0, rel=1e-12)
    columns = np.arange(41) - 20.0
    # An even disk has a variance of r^2 / 4 along either axis, and linear interpolation adds 1/6.
    for along in (0, 1):
        assert (blurred.sum(axis=along) @ columns**2) / 1000.0 == pytest.approx(36.0 / 4.0 + 1.0 / 6.0, rel=0.01)
    np.testing.assert_allclose(blurred[20, :13], 0.0, atol=1e-9)
    assert blurred[20, 20] == pytest.approx(1000.0 / (np.pi * 36.0), rel=0.03)


def test_the_lens_is_turned_while_the_camera_runs_and_in_the_focus_nothing_is_blurred():
    places_m = iter((0.0, 1e-4, 0.0))
    effect = defocus(F_2["lens"], F_2["detector"], defocus_m=lambda: next(places_m))
    sharp, blurred, again = (effect.act(point(), shot()) for _ in range(3))
    np.testing.assert_array_equal(sharp, point())
    np.testing.assert_array_equal(again, point())
    assert blurred.max() < 20.0


def test_even_light_has_no_focus():
    effect = defocus(F_2["lens"], F_2["detector"], defocus_m=lambda: 3e-4)
    np.testing.assert_allclose(effect.act(np.full((30, 40), 7.0), shot()), 7.0, rtol=1e-12)
    assert effect.act(np.zeros((3, 3)), shot()).min() == 0.0


@pytest.mark.parametrize(("axis_deg", "right", "up"), [(0.0, 3.0, 0.0), (90.0, 0.0, 3.0), (180.0, -3.0, 0.0)])
def test_beam_wander_goes_round_once_in_a_whole_turn(axis_deg, right, up):
    moved = beam_wander(radius_px=3.0, phase_deg=0.0).act(point(), shot(axis_deg=axis_deg))
    x, y = centre(moved)
    assert x - 20.0 == pytest.approx(right, abs=1e-9)
    assert 20.0 - y == pytest.approx(up, abs=1e-9)


def test_beam_wander_makes_no_light_negative():
    moved = beam_wander(radius_px=1.3, phase_deg=20.0).act(point(), shot())
    assert moved.min() >= 0.0


def test_vignetting_falls_with_the_fourth_power_of_the_cosine():
    lens = Lens(focal_length_m=0.01, aperture_diameter_m=0.005, transmittance=1.0)
    detector = Detector(width=201, height=101, pixel_pitch_m=1e-4)
    seen = vignetting(lens, detector).act(np.ones((101, 201)), shot())
    # Corner: 100 and 50 pixels of 0.1 mm before 10 mm: tan^2 = 1 + 0.25, cos^2 = 1 / 2.25.
    assert seen[0, 0] == pytest.approx(1.0 / 2.25**2, rel=1e-12)
    assert seen[50, 100] == 1.0
    np.testing.assert_allclose(seen, seen[::-1, ::-1], rtol=1e-12)


def test_smear_adds_the_column_by_the_time_of_its_transfer():
    # 10 us a row in an exposure of 1 ms: a hundredth of the column's sum everywhere in it, nothing beside it.
    smeared = smear(row_transfer_us=10.0).act(point(), shot())
    assert smeared[0, 20] == pytest.approx(10.0, rel=1e-12)
    assert smeared[20, 20] == pytest.approx(1010.0, rel=1e-12)
    assert np.count_nonzero(smeared) == 41


def test_cosmic_hits_have_their_rate_and_charge():
    effect = cosmic_hits(rate_per_s=50.0, mean_e=400.0)
    frames = [effect.act(np.zeros((50, 50)), shot(sequence=k, exposure_s=1.0)) for k in range(200)]
    # A Poisson sum of 10 000 exponential charges: mean n m, variance 2 n m^2.
    total = sum(frame.sum() for frame in frames)
    assert abs(total - 10_000 * 400.0) < 5 * np.sqrt(2 * 10_000) * 400.0
    hit = sum(np.count_nonzero(frame) for frame in frames)
    # 50 hits on 2500 pixels: half a hit a frame falls on another, and 0.13 % leave no whole electron.
    assert abs(hit - 10_000) < 5 * np.sqrt(10_000) + 0.5 * 200 + 13


def test_column_offset_is_that_of_the_camera_and_not_of_the_frame():
    effect = fixed_pattern(column_offset_e=8.0, width=4000, pattern_seed=3)
    one, other = (effect.act(np.zeros((3, 4000)), shot(sequence=k)) for k in (0, 1))
    np.testing.assert_array_equal(one, other)
    assert np.all(one == one[0])
    assert abs(one[0].std() - 8.0) < 5 * 8.0 / np.sqrt(2 * 4000)
    another = fixed_pattern(column_offset_e=8.0, width=4000, pattern_seed=4).act(np.zeros((1, 4000)), shot())
    assert abs(np.corrcoef(one[0], another[0])[0, 1]) < 5 / np.sqrt(4000)


def frame_of(*rendering, detector=SILENT, stage=None):
    world = uniform_world(stage=stage)
    world.present("flat")
    camera = camera_on(world, detector, rendering=rendering)
    camera.configure(exposure_s=1e-3, gain_db=0.0)
    return camera.take_frame(timeout_s=1.0).counts.astype(np.float64)


def test_hits_leave_the_noise_of_the_rest_as_it_was():
    bare, hit = frame_of(), frame_of(cosmic_hits(rate_per_s=20_000.0, mean_e=500.0))
    changed = bare != hit
    # 20 hits in 1 ms; every other pixel drew the same shot noise.
    assert 1 <= np.count_nonzero(changed) <= 60
    assert np.all(hit[changed] > bare[changed])


def test_column_offset_is_added_after_the_draw_of_electrons():
    detector = dataclasses.replace(SILENT, gain_dn_per_e=2.0)
    seen = frame_of(fixed_pattern(column_offset_e=10.0, width=400, pattern_seed=3), detector=detector)
    apart = seen - frame_of(detector=detector)
    # 2 DN an electron, rounded: each column by one whole number, or by two neighbouring ones at a half.
    assert np.all(apart.max(axis=0) - apart.min(axis=0) <= 1.0)
    assert abs(apart[0].std() - 20.0) < 5 * 20.0 / np.sqrt(2 * 400)


def test_drifted_light_has_the_shot_noise_of_what_it_became():
    def act(picture, _):
        picture *= 0.25
        return picture

    seen = frame_of(RenderingEffect(name="quarter", place="light", act=act))
    electrons = (seen - 100.0) / 2.0
    expected = 0.25 * ELECTRONS_OF_FLAT_IN_1_MS
    assert abs(electrons.mean() - expected) < 5 * np.sqrt(expected / seen.size)
    assert abs(electrons.var() - expected) < 5 * expected * np.sqrt(2.0 / seen.size)


def test_camera_tells_the_effects_where_the_polarizer_is():
    told = []
    stage = Turntable()
    stage.angle_deg = 225.0

    def act(picture, frame):
        told.append((frame.axis_deg, frame.sequence, frame.exposure_s))
        return picture

    frame_of(RenderingEffect(name="spy", place="charge", act=act), stage=stage)
    assert told == [(225.0, 0, 1e-3)]


def test_effects_of_one_place_act_in_the_order_of_the_list():
    order = []

    def spy(name):
        def act(picture, _):
            order.append(name)
            return picture

        return RenderingEffect(name=name, place="light", act=act)

    frame_of(spy("first"), spy("second"))
    assert order == ["first", "second"]


@pytest.mark.parametrize(
    "make",
    [
        lambda: drift(rate_per_frame=np.nan, flicker_std=0.0),
        lambda: drift(rate_per_frame=0.0, flicker_std=-0.1),
        lambda: beam_wander(radius_px=-1.0, phase_deg=0.0),
        lambda: point_spread(sigma_px=-1.0),
        lambda: smear(row_transfer_us=-1.0),
        lambda: cosmic_hits(rate_per_s=-1.0, mean_e=1.0),
        lambda: fixed_pattern(column_offset_e=-1.0, width=4, pattern_seed=0),
    ],
)
def test_number_outside_of_its_range_is_refused(make):
    with pytest.raises(ValueError, match="allowed is"):
        make()
