"""Cameras that die, hang and come back, networks that lose packets: no wrong picture, no endless wait."""

import threading

import pytest

from benchmarks.trials.stale_frames import driver_score, first_come_score, running_rig
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.gige import open_gige
from drivers.errors import DeviceError, LimitError, NotConnectedError, ProtocolError
from sim_devices.cameras.gige_server import GigeFaults, lossy_network, serve_behind_network, serve_gige_camera
from tests.sim_devices.cameras.camera_process import camera_process
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port
from tests.sim_devices.cameras.known_pictures import EXPOSURE, KnownPictures, assert_known

EXPOSURE_S = 0.02


MARK_OF_EXPOSURE = 2000


@pytest.fixture
def process():
    with gige_port(), camera_process() as running:
        yield running


@pytest.fixture
def camera(process):
    with open_gige(f"{ADDRESS}?pixel_format=Mono12Packed") as opened:
        opened.configure(exposure_s=EXPOSURE_S, gain_db=3.0)
        assert opened.take_frame(timeout_s=5.0).counts[EXPOSURE] == MARK_OF_EXPOSURE
        yield opened


def assert_error(camera, kind):
    """A picture of a silent camera is an error; that it ends at its deadline is what a BoundedCamera promises."""
    assert isinstance(camera, BoundedCamera)
    with pytest.raises(kind, match=ADDRESS):
        camera.take_frame(timeout_s=1.0)


@pytest.mark.slow
def test_a_killed_camera_is_an_error_and_used_again_with_all_settings(process, camera):
    process.kill()
    assert_error(camera, DeviceError)
    assert_error(camera, NotConnectedError)
    process.start()
    frame = camera.take_frame(timeout_s=60.0)
    assert_known(frame.counts)
    assert frame.counts[EXPOSURE] == MARK_OF_EXPOSURE
    assert frame.settings.gain_db == 3.0
    assert camera.tally().reopened == 1


@pytest.mark.slow
def test_a_camera_that_hangs_is_an_error_and_used_again_once_it_goes_on(process, camera):
    process.hang()
    assert_error(camera, DeviceError)
    waker = threading.Timer(2.0, process.go_on)  # in all longer than the library asks for
    waker.start()
    frame = camera.take_frame(timeout_s=60.0)
    waker.join()
    assert_known(frame.counts)
    assert frame.counts[EXPOSURE] == MARK_OF_EXPOSURE


@pytest.fixture
def take_with_loss():
    """Take pictures of 626 packets each from a camera that loses some of them."""

    def take(*, lost_share, pictures, options=""):
        with (
            gige_port(),
            serve_gige_camera(KnownPictures()) as device,
            open_gige(f"{ADDRESS}?pixel_format=Mono12&{options}") as camera,
        ):
            device.lose_packets(lost_share)
            for _ in range(pictures):
                assert_known(camera.take_frame(timeout_s=60.0).counts)
            return camera.tally()

    return take


def test_every_accepted_picture_is_whole_though_packets_are_lost(take_with_loss):
    tally = take_with_loss(lost_share=1e-3, pictures=10)
    assert tally.accepted == 11
    # Each try of 626 packets is whole with p = 0.999^626 = 0.53; that ten come at once, 0.53^10 = 0.002.
    assert tally.damaged + tally.never_came >= 1


@pytest.mark.parametrize("lost_share", [0.01, 0.05])
def test_lost_packets_come_when_they_are_asked_for_again(lost_share):
    pictures = 10
    faults = GigeFaults(lost_share=lost_share)
    with (
        gige_port(),
        serve_behind_network(KnownPictures(), faults=faults) as place,
        open_gige(f"{place}?pixel_format=Mono12") as camera,
    ):
        for _ in range(pictures):
            assert_known(camera.take_frame(timeout_s=60.0).counts)
        tally = camera.tally()
    # 626 packets a picture: at least the share that was asked for is lost, to five standard deviations; a busy machine
    # loses packets of its own beside it.
    deviation = (lost_share * (1.0 - lost_share) / tally.packets) ** 0.5
    assert tally.packets >= 626 * pictures
    assert tally.packets_lost / tally.packets > lost_share - 5.0 * deviation
    assert tally.packets_resent >= 0.9 * tally.packets_lost


def test_a_network_that_damages_all_pictures_is_an_error_with_what_was_measured(take_with_loss):
    with pytest.raises(ProtocolError, match=r"loses \d.*none of them again.*packets of 1500 bytes, MTU.*interface lo"):
        # At 3 % a picture is whole with p = 0.97^626 = 5e-9; the driver's first one came before.
        take_with_loss(lost_share=0.03, pictures=1, options="retakes=6")


@pytest.mark.parametrize(("largest_bytes", "found"), [(None, 9000), (1500, 1500)])
def test_the_largest_packets_that_pass_are_found_by_pictures(largest_bytes, found):
    with (
        gige_port(),
        serve_gige_camera(KnownPictures()) as device,
        lossy_network(camera=device.address, largest_bytes=largest_bytes),
        open_gige("127.0.0.2?pixel_format=Mono12&packet_size=probe") as camera,
    ):
        assert camera.features()["GevSCPSPacketSize"] == str(found)
        assert_known(camera.take_frame(timeout_s=5.0).counts)


def test_a_camera_without_a_limit_shares_its_line_by_pauses_between_packets():
    # 1500 bytes take 12 us of a gigabit line, and 12.71 us at 118 MB/s. The device pauses for 1 us at most.
    with gige_port(), serve_gige_camera(KnownPictures()):
        with open_gige(f"{ADDRESS}?bandwidth_mb_per_s=118") as camera:
            assert camera.features()["GevSCPD"] == "712 ns"
            assert_known(camera.take_frame(timeout_s=5.0).counts)
        with pytest.raises(LimitError, match="packet delay"):
            open_gige(f"{ADDRESS}?bandwidth_mb_per_s=60")


BUSY_S = 0.3  # six pictures at 20 a second


@pytest.fixture
def stage():
    with gige_port(), running_rig(speed=20.0, width=64, height=48) as opened:
        yield opened


@pytest.mark.slow
def test_no_picture_of_the_old_angle_is_accepted(stage):
    score = driver_score(stage, turns=10, busy_s=BUSY_S)
    assert (score.turns, score.wrong) == (10, 0)


def test_whoever_takes_the_first_picture_takes_one_of_the_old_angle(stage):
    # So that the test above tests something.
    assert first_come_score(stage, turns=3, busy_s=BUSY_S).wrong == 3
