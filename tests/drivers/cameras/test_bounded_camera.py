"""Calls that do not come back: the deadline holds, the camera is left to whoever hangs, and then opened anew."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from drivers import caller as caller_module
from drivers.cameras import bounded_camera
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.v4l2 import V4l2Camera, read_v4l2_place
from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally
from tests.drivers.cameras.fake_video import FakeVideo

# A call that is waited for takes PATIENCE_S, or for ever; the machine may be busy with other things for GRACE_S.
GRACE_S = 20.0
PATIENCE_S = 60.0


class HangingCamera:
    """A camera of which one call waits until a test lets it go on; cameras of one cable share what happened to it."""

    def __init__(self, cable):
        self._cable = cable
        cable.opened.append(self)
        self._wait("open")
        self._settings = CameraSettings(exposure_s=0.01, gain_db=0.0, width=2, height=1, bit_depth=12)
        self._taken = 0

    def _wait(self, what):
        if self._cable.hangs == what:
            assert self._cable.goes_on.wait(PATIENCE_S)

    def identify(self):
        return DeviceIdentity(model="hanging", serial_number=self._cable.serial_number, firmware="1")

    def configure(self, *, exposure_s, gain_db):
        self._wait("configure")
        self._settings = replace(self._settings, exposure_s=exposure_s * self._cable.exposure_factor, gain_db=gain_db)
        return self._settings

    def take_frame(self, *, timeout_s):
        self._wait("take_frame")
        self._taken += 1
        counts = np.zeros((1, 2), dtype=np.uint16)
        times = {"start_utc_ns": 0, "end_utc_ns": 0, "start_monotonic_ns": 0}
        return Frame(counts=counts, settings=self._settings, sequence=self._taken, **times)

    def tally(self):
        return FrameTally(accepted=self._taken)

    def facts(self):
        return CameraFacts(sample_format="Mono12", justified="right", linear=None)

    def features(self):
        self._wait("features")
        return {"Gain": "0"}

    def close(self):
        self._wait("close")
        self._cable.closed.append(self)


class Cable:
    """What happens to the cameras that are opened one after the other."""

    def __init__(self):
        self.hangs, self.serial_number, self.exposure_factor = "", "7", 1.0
        self.opened, self.closed = [], []
        self.goes_on = threading.Event()

    def let_go_on(self):
        self.hangs = ""
        self.goes_on.set()


@pytest.fixture
def cable():
    made = Cable()
    yield made
    made.let_go_on()


@pytest.fixture
def camera(cable, request):
    with BoundedCamera(lambda: HangingCamera(cable), name=request.node.name) as opened:
        opened.configure(exposure_s=0.02, gain_db=3.0)
        yield opened


def seconds_of(call):
    start_s = time.monotonic()
    with pytest.raises(DeviceTimeoutError, match="given up"):
        call()
    return time.monotonic() - start_s


def until(done):
    end_s = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def test_hands_on_what_it_is_asked_and_told(camera):
    assert camera.identify().serial_number == "7"
    assert camera.facts().sample_format == "Mono12"
    assert camera.features() == {"Gain": "0"}
    assert camera.take_frame(timeout_s=1.0).settings.gain_db == 3.0
    assert camera.tally().accepted == 1


def test_a_picture_that_hangs_ends_at_its_deadline(camera, cable):
    cable.hangs = "take_frame"
    assert seconds_of(lambda: camera.take_frame(timeout_s=0.2)) < 0.2 + GRACE_S


def test_while_the_call_has_not_ended_nothing_is_opened(camera, cable):
    cable.hangs = "take_frame"
    seconds_of(lambda: camera.take_frame(timeout_s=0.05))
    start_s = time.monotonic()
    with pytest.raises(NotConnectedError, match="has not ended yet"):
        camera.take_frame(timeout_s=0.1)
    assert time.monotonic() - start_s < 0.1 + GRACE_S
    assert len(cable.opened) == 1


def test_whoever_hangs_closes_the_camera_and_it_is_opened_anew_with_its_settings(camera, cable):
    numbers = [camera.take_frame(timeout_s=1.0).sequence for _ in range(3)]
    cable.hangs = "take_frame"
    seconds_of(lambda: camera.take_frame(timeout_s=0.05))
    cable.let_go_on()
    frame = camera.take_frame(timeout_s=PATIENCE_S)
    assert cable.closed == cable.opened[:1]
    assert (frame.settings.exposure_s, frame.settings.gain_db) == (0.02, 3.0)
    assert frame.sequence == numbers[-1] + 1
    assert (camera.tally().accepted, camera.tally().reopened) == (4, 1)


def test_another_camera_is_not_taken_for_it(camera, cable):
    cable.hangs = "take_frame"
    seconds_of(lambda: camera.take_frame(timeout_s=0.05))
    cable.serial_number = "8"
    cable.let_go_on()
    with pytest.raises(NotConnectedError, match="what came back"):
        camera.take_frame(timeout_s=PATIENCE_S)


def test_one_that_cannot_be_set_as_it_was_is_refused(camera, cable):
    cable.hangs = "take_frame"
    seconds_of(lambda: camera.take_frame(timeout_s=0.05))
    cable.exposure_factor = 2.0
    cable.let_go_on()
    with pytest.raises(LimitError, match="came back"):
        camera.take_frame(timeout_s=PATIENCE_S)


def test_closing_one_that_hangs_does_not_wait_for_it(camera, cable, monkeypatch):
    monkeypatch.setattr(bounded_camera, "_CLOSING_S", 0.1)
    cable.hangs = "close"
    start_s = time.monotonic()
    camera.close()
    assert time.monotonic() - start_s < 0.1 + GRACE_S
    cable.let_go_on()
    until(lambda: cable.closed)


def test_a_picture_that_is_interrupted_is_let_come_before_the_camera_is_closed(camera, cable, monkeypatch):
    def interrupted(caller, job, *, within_s):
        caller._jobs.put((job, caller_module._Answer()))
        raise KeyboardInterrupt

    monkeypatch.setattr(bounded_camera, "_CLOSING_S", 0.0)
    cable.hangs = "take_frame"
    with monkeypatch.context() as patched:
        patched.setattr(caller_module.Caller, "call", interrupted)
        with pytest.raises(KeyboardInterrupt):
            camera.take_frame(timeout_s=PATIENCE_S)
    threading.Timer(0.3, cable.let_go_on).start()
    camera.close()
    assert cable.closed == cable.opened


def test_the_next_one_to_open_it_waits_for_the_call_that_hangs(cable, request):
    first = BoundedCamera(lambda: HangingCamera(cable), name=request.node.name)
    cable.hangs = "take_frame"
    seconds_of(lambda: first.take_frame(timeout_s=0.05))
    first.close()
    threading.Timer(0.1, cable.let_go_on).start()
    with BoundedCamera(lambda: HangingCamera(cable), name=request.node.name) as second:
        assert second.take_frame(timeout_s=1.0).sequence == 1
    assert cable.opened[0] in cable.closed


def test_one_that_cannot_be_opened_says_so(request):
    def refuse():
        raise NotConnectedError("nothing is there")

    with pytest.raises(NotConnectedError, match="nothing is there"):
        BoundedCamera(refuse, name=request.node.name)


def test_a_request_to_a_video_device_that_never_returns_ends_in_time(request, monkeypatch):
    monkeypatch.setattr(bounded_camera, "_SETTING_S", 0.1)
    video, goes_on = FakeVideo(), threading.Event()
    answer = video.request

    def request_or_hang(number, content):
        if hangs.is_set():
            assert goes_on.wait(PATIENCE_S)
        answer(number, content)

    hangs = threading.Event()
    video.request = request_or_hang
    options = read_v4l2_place("/dev/fake")
    with BoundedCamera(lambda: V4l2Camera(video, options, now_ns=video.now_ns), name=request.node.name) as camera:
        hangs.set()
        start_s = time.monotonic()
        with pytest.raises(DeviceTimeoutError, match="given up"):
            camera.configure(exposure_s=0.001, gain_db=0.0)
        assert time.monotonic() - start_s < 0.1 + GRACE_S
        goes_on.set()
    until(lambda: video.closed)
