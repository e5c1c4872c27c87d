"""Calls that do not come back: the deadline holds, the camera is left to whoever hangs, and then opened anew.

Time is the test's own: it stands still while threads work and goes on only while a call hangs, so that deadlines are
exact and no test depends on how busy the machine is.
"""

import threading
from dataclasses import replace

import numpy as np
import pytest

from drivers.caller import Caller
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.v4l2 import V4l2Camera, read_v4l2_place
from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError
from drivers.interfaces import CameraFacts, CameraSettings, DeviceIdentity, Frame, FrameTally
from tests.drivers.cameras.fake_video import FakeVideo

PATIENCE_S = 60.0  # of the true clock, for a thread that has work to do
GRACE_S, OPENING_S, SETTING_S, CLOSING_S = 0.3, 30.0, 5.0, 2.0  # what the driver promises


class Cable:
    """What happens to the cameras that are opened one after the other, and the time in which it does."""

    def __init__(self):
        self.hangs, self.serial_number, self.exposure_factor = "", "7", 1.0
        self.opened, self.closed = [], []
        self.now = 0.0
        self._later = []
        self._is_hanging, self._goes_on = threading.Event(), threading.Event()

    def now_s(self):
        return self.now

    def wait(self, event, timeout_s):
        end_s = self.now + timeout_s
        while not event.is_set():
            if not self._is_hanging.is_set():
                event.wait(0.001)
            elif self._later and self._later[0][0] <= end_s:
                self.now, act = self._later.pop(0)
                act()
            else:
                self.now = end_s
                return False
        return True

    def hang_if_told(self, what):
        if self.hangs == what:
            self._is_hanging.set()
            assert self._goes_on.wait(PATIENCE_S)

    def let_go_on(self):
        self.hangs = ""
        self._is_hanging.clear()
        self._goes_on.set()

    def let_go_on_at(self, time_s):
        self._later.append((time_s, self.let_go_on))

    def open(self, make, name):
        return BoundedCamera(make, name=name, now_s=self.now_s, make_caller=lambda calls: Caller(calls, wait=self.wait))


class HangingCamera:
    """A camera of which one call waits until a test lets it go on."""

    def __init__(self, cable):
        self._cable = cable
        cable.opened.append(self)
        cable.hang_if_told("open")
        self._settings = CameraSettings(exposure_s=0.01, gain_db=0.0, width=2, height=1, bit_depth=12)
        self._taken = 0

    def identify(self):
        return DeviceIdentity(model="hanging", serial_number=self._cable.serial_number, firmware="1")

    def configure(self, *, exposure_s, gain_db):
        self._cable.hang_if_told("configure")
        self._settings = replace(self._settings, exposure_s=exposure_s * self._cable.exposure_factor, gain_db=gain_db)
        return self._settings

    def take_frame(self, *, timeout_s):
        self._cable.hang_if_told("take_frame")
        self._taken += 1
        counts = np.zeros((1, 2), dtype=np.uint16)
        times = {"start_utc_ns": 0, "end_utc_ns": 0, "start_monotonic_ns": 0}
        return Frame(counts=counts, settings=self._settings, sequence=self._taken, **times)

    def tally(self):
        return FrameTally(accepted=self._taken)

    def facts(self):
        return CameraFacts(sample_format="Mono12", justified="right", linear=None)

    def features(self):
        self._cable.hang_if_told("features")
        return {"Gain": "0"}

    def close(self):
        self._cable.hang_if_told("close")
        self._cable.closed.append(self)


@pytest.fixture
def cable():
    made = Cable()
    yield made
    made.let_go_on()


@pytest.fixture
def camera(cable, request):
    with cable.open(lambda: HangingCamera(cable), request.node.name) as opened:
        opened.configure(exposure_s=0.02, gain_db=3.0)
        yield opened


def give_up(cable, call):
    """Let a call hang; return how long it took to be given up."""
    start_s = cable.now
    with pytest.raises(DeviceTimeoutError, match="opened again"):
        call()
    return cable.now - start_s


def test_hands_on_what_it_is_asked_and_told(camera):
    assert camera.identify().serial_number == "7"
    assert camera.facts().sample_format == "Mono12"
    assert camera.features() == {"Gain": "0"}
    assert camera.take_frame(timeout_s=1.0).settings.gain_db == 3.0
    assert camera.tally().accepted == 1


@pytest.mark.parametrize(
    ("what", "call", "deadline_s"),
    [
        ("take_frame", lambda camera: camera.take_frame(timeout_s=0.2), 0.2 + GRACE_S),
        ("configure", lambda camera: camera.configure(exposure_s=0.01, gain_db=0.0), SETTING_S),
        ("features", lambda camera: camera.features(), 3.0),
    ],
)
def test_a_call_that_hangs_ends_at_its_deadline(camera, cable, what, call, deadline_s):
    cable.hangs = what
    assert give_up(cable, lambda: call(camera)) == pytest.approx(deadline_s, abs=1e-9)


def test_a_camera_that_hangs_while_it_is_opened_is_given_up_and_closed_once_it_goes_on(cable, request):
    cable.hangs = "open"
    name = request.node.name
    waited_s = give_up(cable, lambda: cable.open(lambda: HangingCamera(cable), name))
    assert waited_s == pytest.approx(OPENING_S + GRACE_S)
    cable.let_go_on()
    with cable.open(lambda: HangingCamera(cable), name):
        assert cable.closed == cable.opened[:1]


def test_while_the_call_has_not_ended_nothing_is_opened(camera, cable):
    cable.hangs = "take_frame"
    give_up(cable, lambda: camera.take_frame(timeout_s=0.05))
    start_s = cable.now
    with pytest.raises(NotConnectedError, match="has not ended yet"):
        camera.take_frame(timeout_s=0.1)
    assert cable.now - start_s == pytest.approx(0.1)
    assert len(cable.opened) == 1


def test_whoever_hangs_closes_the_camera_and_it_is_opened_anew_with_its_settings(camera, cable):
    numbers = [camera.take_frame(timeout_s=1.0).sequence for _ in range(3)]
    cable.hangs = "take_frame"
    give_up(cable, lambda: camera.take_frame(timeout_s=0.05))
    cable.let_go_on_at(cable.now + 3.0)
    frame = camera.take_frame(timeout_s=5.0)
    assert cable.closed == cable.opened[:1]
    assert (frame.settings.exposure_s, frame.settings.gain_db) == (0.02, 3.0)
    assert frame.sequence == numbers[-1] + 1
    assert (camera.tally().accepted, camera.tally().reopened) == (4, 1)


@pytest.mark.parametrize(
    ("change", "kind", "told"),
    [
        ({"serial_number": "8"}, NotConnectedError, "after opening it again it is"),
        ({"exposure_factor": 2.0}, LimitError, "after opening it again it has"),
    ],
)
def test_what_comes_back_as_another_or_with_other_settings_is_refused(camera, cable, change, kind, told):
    cable.hangs = "take_frame"
    give_up(cable, lambda: camera.take_frame(timeout_s=0.05))
    vars(cable).update(change)
    cable.let_go_on()
    with pytest.raises(kind, match=told):
        camera.take_frame(timeout_s=1.0)


def test_closing_one_that_hangs_does_not_wait_for_it(camera, cable):
    cable.hangs = "close"
    camera.close()
    assert cable.now == pytest.approx(CLOSING_S)
    assert cable.closed == []


def test_a_picture_that_is_interrupted_is_let_come_before_the_camera_is_closed(camera, cable, monkeypatch):
    def interrupted(caller, job, *, within_s):
        caller._put(job)
        raise KeyboardInterrupt

    cable.hangs = "take_frame"
    with monkeypatch.context() as patched:
        patched.setattr(Caller, "call", interrupted)
        with pytest.raises(KeyboardInterrupt):
            camera.take_frame(timeout_s=10.0)
    cable.let_go_on_at(10.0 + GRACE_S + CLOSING_S)
    camera.close()
    assert cable.closed == cable.opened


def test_the_next_one_to_open_it_waits_for_the_call_that_hangs(cable, request):
    first = cable.open(lambda: HangingCamera(cable), request.node.name)
    cable.hangs = "take_frame"
    give_up(cable, lambda: first.take_frame(timeout_s=0.05))
    first.close()
    cable.let_go_on_at(cable.now + OPENING_S)
    with cable.open(lambda: HangingCamera(cable), request.node.name) as second:
        assert second.take_frame(timeout_s=1.0).sequence == 1
    assert cable.opened[0] in cable.closed


def test_one_that_cannot_be_opened_says_so(cable, request):
    def refuse():
        raise NotConnectedError("nothing is there")

    with pytest.raises(NotConnectedError, match="nothing is there"):
        cable.open(refuse, request.node.name)


def test_a_request_to_a_video_device_that_never_returns_ends_in_time(cable, request):
    video = FakeVideo()
    answer = video.request

    def request_or_hang(number, content):
        cable.hang_if_told("request")
        answer(number, content)

    video.request = request_or_hang
    options = read_v4l2_place("/dev/fake")
    with cable.open(lambda: V4l2Camera(video, options, now_ns=video.now_ns), request.node.name) as camera:
        cable.hangs = "request"
        assert give_up(cable, lambda: camera.configure(exposure_s=0.001, gain_db=0.0)) == pytest.approx(SETTING_S)
