"""What each effect of the rendering changes, against numbers worked out by hand; five standard errors are allowed."""

import dataclasses

import numpy as np
import pytest

from sim_devices.exposure import (
    Detector,
    Lens,
    RenderingEffect,
    Shot,
    beam_wander,
    cosmic_hits,
    defocus,
    drift,
    fixed_pattern,
    point_spread,
    smear,
    vignetting,
)
from sim_devices.random_streams import Stream
from tests.sim_devices.camera_builders import ELECTRONS_OF_FLAT_IN_1_MS, SILENT, Turntable, camera_on, uniform_world


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


def test_flicker_of_a_frame_can_be_had_again():
    effect = drift(rate_per_frame=0.0, flicker_std=0.02)
    one, other = (effect.act(np.ones((1, 1)), shot(sequence=7)) for _ in range(2))
    assert one == other


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


def test_smear_grows_as_the_exposure_shrinks():
    short = smear(row_transfer_us=10.0).act(point(), shot(exposure_s=1e-4))
    assert short[0, 20] == pytest.approx(100.0, rel=1e-12)


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


def test_streams_of_one_frame_differ():
    frame = shot()
    one, other = frame.draws(Stream.DRIFT), frame.draws(Stream.COSMIC_HITS)
    assert one.standard_normal() != other.standard_normal()


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
    with pytest.raises(ValueError, match="it has to be"):
        make()
