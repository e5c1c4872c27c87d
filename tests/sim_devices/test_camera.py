from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import DeviceTimeoutError, LimitError
from sim_devices.truth_log import TruthLog, read_truth
from tests.sim_devices.camera_builders import (
    SILENT,
    SMALL,
    FixedClock,
    Turntable,
    camera_on,
    small_camera,
    uniform_world,
)


def counts_of(camera, count=1):
    return [camera.take_frame(timeout_s=1.0).counts for _ in range(count)]


def test_identity_says_that_it_is_a_simulation_and_which():
    identity = small_camera(pattern_seed=42).identify()
    assert "simulated" in identity.model
    assert "42" in identity.serial_number


def test_numbers_that_are_left_out_change_no_later_noise():
    whole, gone_on = small_camera(), small_camera()
    gone_on.go_on_from(2)
    assert gone_on.next_sequence == 2
    np.testing.assert_array_equal(counts_of(gone_on)[0], counts_of(whole, 3)[2])


def test_frames_of_one_camera_have_independent_noise():
    camera = camera_on(uniform_world(), replace(SILENT, read_noise_e=5.0))
    first, second = counts_of(camera, 2)
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 5 / np.sqrt(first.size)


def test_other_noise_seed_gives_independent_noise_and_the_same_pattern():
    world = uniform_world()
    world.present("dark")
    detector = replace(SILENT, read_noise_e=5.0, dsnu_e=5.0)
    (first,), (second,) = (counts_of(camera_on(world, detector, noise_seed=seed)) for seed in (1, 2))
    # Pattern and noise have the same variance: correlation 1/2, its sampling error (1 - 1/4) / sqrt(n).
    correlation = np.corrcoef(first.ravel(), second.ravel())[0, 1]
    assert abs(correlation - 0.5) < 5 * 0.75 / np.sqrt(first.size)


def test_other_pattern_seed_is_another_camera():
    world = uniform_world()
    world.present("dark")
    detector = replace(SILENT, dsnu_e=5.0)
    (first,), (second,) = (counts_of(camera_on(world, detector, pattern_seed=seed)) for seed in (1, 2))
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 5 / np.sqrt(first.size)


def test_a_frame_can_be_had_again_without_those_before_it():
    third = counts_of(small_camera(), 3)[2]
    resumed = small_camera(first_sequence=2).take_frame(timeout_s=1.0)
    assert resumed.sequence == 2
    np.testing.assert_array_equal(resumed.counts, third)


def test_what_was_seen_before_does_not_change_a_frame():
    stage = Turntable()
    world = uniform_world(stokes=(0.04, 0.03, 0.0), width=20, height=10, stage=stage)
    camera = camera_on(world, SMALL)
    (at_0,) = counts_of(camera)
    stage.angle_deg = 90.0
    (at_90,) = counts_of(camera)
    (at_90_alone,) = counts_of(camera_on(world, SMALL, first_sequence=1))
    np.testing.assert_array_equal(at_90_alone, at_90)
    assert at_90.mean() < at_0.mean()


def test_polarizer_angle_of_a_frame_is_where_the_stage_stands():
    stage = Turntable()
    camera = camera_on(uniform_world(stokes=(0.04, 0.0, 0.04), stage=stage), SILENT)
    camera.configure(exposure_s=1e-3, gain_db=0.0)
    means = {}
    for angle_deg in (0.0, 45.0, 90.0, 135.0):
        stage.angle_deg = angle_deg
        means[angle_deg] = counts_of(camera)[0].mean() - 100.0
    # Pure +45 light: 0.04 W m^-2 sr^-1 or 3953.786 electrons at 45, half of them at 0 and 90, none at 135.
    # 2 DN an electron, shot noise 2 sqrt(N), 160 000 pixels, 5 standard errors.
    assert means[45.0] == pytest.approx(7907.572, abs=5 * 2 * np.sqrt(3953.786 / 160_000))
    assert means[0.0] == pytest.approx(3953.786, abs=5 * 2 * np.sqrt(1976.893 / 160_000))
    assert means[90.0] == pytest.approx(3953.786, abs=5 * 2 * np.sqrt(1976.893 / 160_000))
    assert means[135.0] == 0.0


def test_exposure_is_taken_in_whole_microseconds():
    assert small_camera().configure(exposure_s=30.4e-6, gain_db=6.0).exposure_s == 30e-6


@pytest.mark.parametrize(
    ("exposure_s", "gain_db", "message"),
    [(61.0, 0.0, r"exposure_s is 61\.0 s"), (0.01, 25.0, r"gain_db is 25\.0 dB"), (0.01, -1.0, "gain_db")],
)
def test_setting_outside_of_its_range_is_named(exposure_s, gain_db, message):
    with pytest.raises(LimitError, match=message):
        small_camera().configure(exposure_s=exposure_s, gain_db=gain_db)


def test_time_stamps_come_from_the_clock():
    clock = FixedClock()
    camera = small_camera(utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns)
    camera.configure(exposure_s=2e-6, gain_db=0.0)
    clock.now_ns = 70_000
    frame = camera.take_frame(timeout_s=1.0)
    assert frame.start_monotonic_ns == 70_000
    assert frame.start_utc_ns == 1_000_070_000
    assert frame.end_utc_ns == 1_000_072_000


def test_exposures_do_not_overlap_on_a_clock_that_stands():
    clock = FixedClock()
    camera = small_camera(utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns)
    camera.configure(exposure_s=2e-6, gain_db=0.0)
    first, second = camera.take_frame(timeout_s=1.0), camera.take_frame(timeout_s=1.0)
    assert second.start_utc_ns == first.end_utc_ns
    assert second.start_monotonic_ns == first.start_monotonic_ns + 2000


def test_lost_frame_times_out_and_its_number_is_missing():
    camera = small_camera(faults={1: "lost"})
    undisturbed = counts_of(small_camera(), 3)
    camera.take_frame(timeout_s=1.0)
    with pytest.raises(DeviceTimeoutError, match="frame 1 did not come"):
        camera.take_frame(timeout_s=1.0)
    after = camera.take_frame(timeout_s=1.0)
    assert after.sequence == 2
    np.testing.assert_array_equal(after.counts, undisturbed[2])


def test_repeated_frame_has_old_counts_under_a_new_number():
    camera = small_camera(faults={1: "repeated"})
    first, second, third = (camera.take_frame(timeout_s=1.0) for _ in range(3))
    assert (first.sequence, second.sequence) == (0, 1)
    assert second.start_utc_ns > first.start_utc_ns
    np.testing.assert_array_equal(second.counts, first.counts)
    assert not np.array_equal(third.counts, second.counts)


def test_frame_belongs_to_who_took_it():
    camera = small_camera(faults={1: "repeated"})
    first = camera.take_frame(timeout_s=1.0)
    kept = first.counts.copy()
    first.counts[...] = 0
    np.testing.assert_array_equal(camera.take_frame(timeout_s=1.0).counts, kept)


def test_black_frame_is_zero_even_below_the_black_level():
    first, second = counts_of(small_camera(faults={1: "black"}), 2)
    assert np.all(first > 0)
    assert np.all(second == 0)


def test_exposure_that_outlasts_the_wait_uses_no_number_up():
    camera = small_camera()
    camera.configure(exposure_s=2.0, gain_db=0.0)
    with pytest.raises(DeviceTimeoutError, match=r"exposure of 2\.0 s"):
        camera.take_frame(timeout_s=1.0)
    assert camera.take_frame(timeout_s=3.0).sequence == 0


@pytest.mark.parametrize("name", ["pattern_seed", "noise_seed", "first_sequence"])
def test_negative_number_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} is -1"):
        small_camera(**{name: -1})


def test_every_exposure_is_noted_with_its_number_and_fault(tmp_path):
    log = TruthLog(tmp_path / "truth.jsonl")
    camera = small_camera(truth=log, faults={1: "lost"})
    camera.configure(exposure_s=0.002, gain_db=6.0)
    first = camera.take_frame(timeout_s=1.0)
    with pytest.raises(DeviceTimeoutError):
        camera.take_frame(timeout_s=1.0)
    noted = read_truth(tmp_path / "truth.jsonl")
    assert [(frame.sequence, frame.fault) for frame in noted] == [(0, None), (1, "lost")]
    assert noted[0].start_utc_ns == first.start_utc_ns
    assert (noted[0].exposure_s, noted[0].gain_db, noted[0].subject) == (0.002, 6.0, "scene")


def test_the_log_grows_from_session_to_session(tmp_path):
    for _ in range(2):
        small_camera(truth=TruthLog(tmp_path / "truth.jsonl")).take_frame(timeout_s=1.0)
    assert len(read_truth(tmp_path / "truth.jsonl")) == 2


def test_a_line_that_is_no_frame_is_refused(tmp_path):
    (tmp_path / "truth.jsonl").write_text('{"sequence": 1}\n')
    with pytest.raises(ValueError, match="not a frame"):
        read_truth(tmp_path / "truth.jsonl")


def test_a_file_that_is_no_log_is_not_added_to(tmp_path):
    (tmp_path / "session.toml").write_text("mine")
    with pytest.raises(FileExistsError, match="not a log of exposures"):
        TruthLog(tmp_path / "session.toml")
    assert (tmp_path / "session.toml").read_text() == "mine"
