"""What every camera promises, simulated or of glass and metal (`--camera ADDRESS`)."""

import json
import time
from dataclasses import asdict

import numpy as np
import pytest

from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError
from drivers.interfaces import ReportingCamera
from tests.contracts.cameras_under_test import CAMERAS, camera_at

EXPOSURE_S = 0.002
TIMEOUT_S = 5.0


def pytest_generate_tests(metafunc):
    if "camera" in metafunc.fixturenames:
        given = metafunc.config.getoption("--camera")
        metafunc.parametrize("camera", [given] if given else sorted(CAMERAS), indirect=True)


@pytest.fixture
def camera(request):
    with CAMERAS[request.param]() if request.param in CAMERAS else camera_at(request.param) as opened:
        opened.configure(exposure_s=EXPOSURE_S, gain_db=0.0)
        yield opened


def test_says_which_device_it_is(camera):
    identity = camera.identify()
    assert identity.model
    assert identity.serial_number


def test_settings_read_back_are_close_to_what_was_asked(camera):
    settings = camera.configure(exposure_s=0.003, gain_db=0.0)
    # Cameras count exposure in lines or ticks; 1 % is more than any of these at 3 ms.
    assert settings.exposure_s == pytest.approx(0.003, rel=0.01)
    assert settings.gain_db == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("exposure_s", [0.0, -0.001, float("nan"), float("inf")])
def test_exposure_that_no_camera_has_is_refused(camera, exposure_s):
    with pytest.raises(LimitError):
        camera.configure(exposure_s=exposure_s, gain_db=0.0)


@pytest.mark.parametrize("gain_db", [float("nan"), 1000.0])
def test_gain_that_no_camera_has_is_refused(camera, gain_db):
    with pytest.raises(LimitError):
        camera.configure(exposure_s=EXPOSURE_S, gain_db=gain_db)


def test_refused_settings_change_nothing(camera):
    before = camera.take_frame(timeout_s=TIMEOUT_S).settings
    with pytest.raises(LimitError):
        camera.configure(exposure_s=0.003, gain_db=1000.0)
    assert camera.take_frame(timeout_s=TIMEOUT_S).settings == before


def test_frame_carries_the_settings_that_it_was_taken_with(camera):
    settings = camera.configure(exposure_s=0.003, gain_db=0.0)
    assert camera.take_frame(timeout_s=TIMEOUT_S).settings == settings


def test_counts_have_the_size_and_depth_that_the_settings_say(camera):
    frame = camera.take_frame(timeout_s=TIMEOUT_S)
    assert frame.counts.dtype == np.uint16
    assert frame.counts.shape == (frame.settings.height, frame.settings.width)
    assert frame.counts.max() <= 2**frame.settings.bit_depth - 1


def test_numbers_grow(camera):
    # Not by one: a camera that runs by itself goes on counting meanwhile.
    first, second, third = (camera.take_frame(timeout_s=TIMEOUT_S).sequence for _ in range(3))
    assert first < second < third


def test_exposure_began_after_the_call(camera):
    called_ns = time.monotonic_ns()
    assert camera.take_frame(timeout_s=TIMEOUT_S).start_monotonic_ns >= called_ns


def test_end_is_start_and_exposure(camera):
    frame = camera.take_frame(timeout_s=TIMEOUT_S)
    # Exposures are known to a microsecond or better, which is 1000 ns.
    assert frame.end_utc_ns - frame.start_utc_ns == pytest.approx(frame.settings.exposure_s * 1e9, abs=1000)


def test_exposures_do_not_overlap(camera):
    first, second = (camera.take_frame(timeout_s=TIMEOUT_S) for _ in range(2))
    assert second.start_monotonic_ns - first.start_monotonic_ns >= EXPOSURE_S * 0.99e9


def test_frame_stays_as_it_was_when_the_next_is_taken(camera):
    first = camera.take_frame(timeout_s=TIMEOUT_S)
    kept = first.counts.copy()
    camera.take_frame(timeout_s=TIMEOUT_S)
    np.testing.assert_array_equal(first.counts, kept)


def test_frame_that_cannot_come_in_time_is_a_timeout(camera):
    camera.configure(exposure_s=0.5, gain_db=0.0)
    with pytest.raises(DeviceTimeoutError):
        camera.take_frame(timeout_s=0.01)


def test_what_it_counts_grows_with_every_frame(camera):
    if not isinstance(camera, ReportingCamera):
        pytest.skip("counts nothing, as a plug-in's camera may; our own are all held to it below")
    before = camera.tally().accepted
    camera.take_frame(timeout_s=TIMEOUT_S)
    assert camera.tally().accepted == before + 1


def test_how_its_counts_come_about_is_json(camera):
    if not isinstance(camera, ReportingCamera):
        pytest.skip("does not tell, as a plug-in's camera may not; our own are all held to it below")
    told = asdict(camera.facts()) | {"features": camera.features()}
    as_json = {name: list(value) if isinstance(value, tuple) else value for name, value in told.items()}
    assert json.loads(json.dumps(told)) == as_json
    assert told["sample_format"]


def test_our_own_cameras_tell_of_themselves(request, camera):
    assert isinstance(camera, ReportingCamera) or request.config.getoption("--camera")


def test_closed_camera_says_so_and_may_be_closed_twice(camera):
    camera.close()
    camera.close()
    with pytest.raises(NotConnectedError):
        camera.take_frame(timeout_s=TIMEOUT_S)
    with pytest.raises(NotConnectedError):
        camera.configure(exposure_s=EXPOSURE_S, gain_db=0.0)


def test_leaving_the_context_closes_it(camera):
    with camera:
        pass
    with pytest.raises(NotConnectedError):
        camera.take_frame(timeout_s=TIMEOUT_S)
