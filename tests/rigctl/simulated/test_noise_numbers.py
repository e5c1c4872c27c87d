"""The numbers on which simulated noise hangs, where steps are left out and sessions are gone on with."""

import pytest

from rigctl.rig.simulated_parts import FreshNoise, NoiseNumbers, number_after
from rigctl.runs.folder import read_run
from rigctl.runs.records import RunEvent
from rigctl.runs.writer import RunWriter
from rigctl.session.take import take_session
from tests.rigctl.example_files import small_rig, small_session
from tests.sim_devices.camera_builders import small_camera


@pytest.fixture
def run(tmp_path):
    """A session of a simulated rig, whole."""
    take_session(small_rig(tmp_path), small_session(), tmp_path / "run", files={})
    return tmp_path / "run"


def metered(next_camera_frame):
    return RunEvent(event="metered", facts={"round": 0, "exposure_s": 0.01, "next_camera_frame": next_camera_frame})


def test_steps_that_are_left_out_use_up_their_numbers():
    camera = small_camera()
    noise = NoiseNumbers(camera, None)
    assert not noise.begin_step(0)
    camera.take_frame(timeout_s=1.0)
    assert not noise.begin_step(1)
    camera.take_frame(timeout_s=1.0)
    assert noise.begin_step(5)
    assert camera.next_sequence == 5


def test_a_run_that_is_not_there_yet_begins_with_the_first_number(tmp_path):
    camera = small_camera()
    assert not NoiseNumbers(camera, tmp_path / "none").begin_step(3)
    assert camera.next_sequence == 0


def test_a_step_that_is_taken_again_has_its_number_again(run):
    camera = small_camera()
    assert NoiseNumbers(camera, run).begin_step(3)
    assert camera.next_sequence == read_run(run).frames[3].camera_frame


def test_numbers_that_metering_used_up_are_not_used_again(run):
    frames = read_run(run).frames
    assert number_after(frames, [], 4) == 4
    assert number_after(frames, [metered(None), metered(9)], 4) == 9
    assert number_after([], [metered(9)], 0) == 9


def test_noise_over_the_network_is_drawn_anew_after_each_beginning(run):
    first, second = small_camera(), small_camera()
    assert not FreshNoise(first, run).begin_step(2)
    assert first.next_sequence == 0
    with RunWriter.append(run) as writer:
        writer.event("resumed")
    noise = FreshNoise(second, run)
    assert not noise.begin_step(2)
    begun = second.next_sequence
    assert begun > 1_000_000
    noise.begin_step(3)
    assert second.next_sequence == begun
