"""Times of pictures by the clock of the camera: held against that of the host, by PTP, and where there is none."""

import re
from contextlib import ExitStack

import pytest

from drivers.cameras.aravis import CameraClock, Received, load_aravis
from drivers.cameras.bounded_camera import Asked
from drivers.cameras.gige import GigeCamera, GigeSetup, frame_of, open_aravis, read_gige_place
from drivers.cameras.samples import GENICAM
from drivers.errors import LimitError, ProtocolError
from drivers.interfaces import CameraSettings
from sim_devices.cameras.gige_server import ClockTruth, DeviceClock, lossy_network, serve_gige_camera
from tests.sim_devices.cameras.gige_port import gige_port, need_aravis
from tests.sim_devices.cameras.known_pictures import KnownPictures

S = 10**9
UTC_NS = 1_790_000_000 * S
QUESTION_NS = 100_000  # from a question to its answer
STAMP_STEP_NS = 1000  # of the time by which libaravis's device knows when it took a picture


class Features:
    """A camera with a clock of its own, of which it tells by such features as it has."""

    def __init__(self, *, hz=S, ppm=0.0, latch="GevTimestampControlLatch", ptp=None, says_hz=None):
        self.host_ns, self.ppm, self.hz = 0, ppm, hz
        self.start_ns = 5 * S
        self.latched, self.refuses, self.ptp = 0, False, ptp
        values = {"TimestampLatch": "TimestampLatchValue", "GevTimestampControlLatch": "GevTimestampValue"}
        self.texts = {latch: "", values[latch]: ""} if latch else {}
        self.numbers = {} if says_hz is None else {"GevTimestampTickFrequency": says_hz}
        self.switch = False

    def now_ns(self):
        return self.host_ns

    def utc_ns(self):
        return UTC_NS + self.host_ns

    def stamp_ns(self):
        """What a picture says that is taken now, as libaravis gives it."""
        if self.switch and self.ptp is not None:
            return self.utc_ns() + self.ptp["ahead_ns"]
        return self.start_ns + round(self.host_ns * (1.0 + self.ppm * 1e-6))

    def has(self, feature):
        if feature.startswith("Ptp"):
            return self.ptp is not None and feature != "PtpDataSetLatchValue"
        return feature in self.texts or feature in self.numbers

    def first_of(self, *features):
        return next(filter(self.has, features), None)

    def execute(self, feature):
        if self.refuses:
            raise ProtocolError(feature)
        self.host_ns += QUESTION_NS // 4
        if feature != "PtpDataSetLatch":
            self.latched = self.stamp_ns() * self.hz // S
        self.host_ns += 3 * QUESTION_NS // 4

    def whole(self, feature):
        self.host_ns += QUESTION_NS
        if feature == "PtpOffsetFromMaster":
            return self.ptp["offset_ns"]
        return self.numbers.get(feature, self.latched)

    def truth(self, feature):
        return self.switch

    def set_truth(self, feature, value):
        self.switch = value

    def text(self, feature):
        return self.ptp["state"]


def clock_of(camera, **options):
    return CameraClock(camera, now_ns=camera.now_ns, utc_ns=camera.utc_ns, **options)


def look_for(clock, camera, seconds):
    for _ in range(round(seconds * 10)):
        camera.host_ns += S // 10
        clock.look()


@pytest.mark.parametrize("latch", ["GevTimestampControlLatch", "TimestampLatch"])
@pytest.mark.parametrize(("hz", "says_hz"), [(S, None), (S, S), (36_858_974, 36_858_974), (S, 125_000_000)])
@pytest.mark.parametrize("ppm", [-80.0, 0.0, 80.0])
def test_a_stamp_is_a_time_within_the_error_that_is_told(latch, hz, says_hz, ppm):
    camera = Features(hz=hz, says_hz=says_hz, ppm=ppm, latch=latch)
    clock = clock_of(camera)
    assert clock.moment_of(camera.stamp_ns()) is None  # one look does not tell what it counts in
    for seconds in (0.1, 1.0, 20.0):
        look_for(clock, camera, seconds)
        camera.host_ns += S
        moment = clock.moment_of(camera.stamp_ns())
        assert abs(moment[0] - camera.host_ns) <= moment[1]
    assert moment[1] < QUESTION_NS
    told = re.fullmatch(r"\w+, read to 50 us, (\S+) ppm", clock.description())
    assert told is not None
    assert float(told[1]) == pytest.approx(ppm, abs=5.0)


def test_a_clock_that_stands_still_is_none():
    camera = Features(ppm=-1e6)
    clock = clock_of(camera)
    look_for(clock, camera, 2.0)
    assert (clock.moment_of(camera.stamp_ns()), clock.description()) == (None, None)


def test_a_clock_that_was_set_is_learned_anew():
    camera = Features()
    clock = clock_of(camera)
    look_for(clock, camera, 6.0)
    camera.start_ns = 0
    look_for(clock, camera, 6.0)
    moment = clock.moment_of(camera.stamp_ns())
    assert abs(moment[0] - camera.host_ns) <= moment[1] < S // 1000


def test_it_is_looked_at_each_ten_seconds_once_it_is_known():
    camera = Features()
    clock = clock_of(camera)
    look_for(clock, camera, 40.0)
    before_ns = camera.host_ns
    look_for(clock, camera, 60.0)
    looks = (camera.host_ns - before_ns - 60 * S) / QUESTION_NS / 6  # three times two questions each
    assert 5 <= looks <= 7


@pytest.mark.parametrize("camera", [Features(latch=None), Features()], ids=["none", "refused"])
def test_a_camera_without_a_clock_tells_none(camera):
    camera.refuses = True
    clock = clock_of(camera)
    look_for(clock, camera, 1.0)
    assert (clock.moment_of(S), clock.description()) == (None, None)


def ptp_clock(**state):
    camera = Features(ptp={"state": "Slave", "offset_ns": -250, "ahead_ns": 37 * S} | state)
    clock = clock_of(camera, ptp=True)
    look_for(clock, camera, 2.0)
    return clock


@pytest.mark.parametrize("ahead_s", [0, 37])
def test_a_master_gives_utc_or_tai(ahead_s):
    clock = ptp_clock(ahead_ns=ahead_s * S + S // 10)
    assert (clock.ptp.ahead_s, clock.ptp.offset_ns) == (ahead_s, 250)
    assert clock.ptp.host_behind_ns == pytest.approx(S // 10, abs=QUESTION_NS)
    assert "Slave, 250 ns from its master; this machine is" in clock.description()


@pytest.mark.parametrize(
    "state", [{"state": "Listening"}, {"state": "Master"}, {"ahead_ns": -UTC_NS}, {"ahead_ns": 20 * S}]
)
def test_a_clock_that_follows_no_master_of_the_time_of_day_is_not_utc(state):
    clock = ptp_clock(**state)
    assert clock.ptp is None
    assert clock.description() is not None


def test_a_camera_that_cannot_follow_a_master_is_refused():
    with pytest.raises(LimitError, match="ptp=1"):
        clock_of(Features(), ptp=True)


EXPOSURE_NS = 20_000_000
MONO12 = 0x01100005
SETUP = GigeSetup(
    pixel_format=GENICAM[MONO12],
    pixel_format_code=MONO12,
    sent_width=2,
    sent_height=1,
    width=2,
    height=1,
    bit_depth=12,
    plane=None,
    linear=True,
    exposure_feature="ExposureTime",
    exposure_step_us=1.0,
    gain_feature=None,
    gain_step_db=None,
)


def frame_with(stamp_after_ns, *, arrives_after_ns, camera=None, exposure_ns=EXPOSURE_NS, **more):
    """A frame that was asked for now, stamped and come in so much later."""
    camera = Features() if camera is None else camera
    clock = clock_of(camera)
    look_for(clock, camera, 6.0)
    asked = Asked(utc_ns=camera.utc_ns(), monotonic_ns=camera.now_ns())
    camera.host_ns += stamp_after_ns
    stamp_ns = camera.stamp_ns()
    settings = CameraSettings(exposure_s=exposure_ns / 1e9, gain_db=0.0, width=2, height=1, bit_depth=12)
    received = Received(
        first_packet_utc_ns=asked.utc_ns + arrives_after_ns,
        data=bytes(4),
        width=2,
        height=1,
        pixel_format_code=MONO12,
        frame_id=1,
        stamp_ns=stamp_ns,
    )
    more = {"free_period_s": None} | more
    frame = frame_of(received, setup=SETUP, settings=settings, sequence=1, asked=asked, clock=clock, **more)
    return frame, frame.start_monotonic_ns - asked.monotonic_ns


@pytest.mark.parametrize("stamp_ms", [0.3, 20.3])
def test_the_beginning_is_found_whether_it_or_the_end_is_stamped(stamp_ms):
    frame, after_ns = frame_with(round(stamp_ms * 1e6), arrives_after_ns=25_000_000)
    assert frame.start_source == "camera clock"
    assert abs(after_ns - 300_000) <= frame.start_uncertainty_s * 1e9 <= 1.5 * QUESTION_NS


def test_what_may_be_both_is_known_to_half_an_exposure_more():
    frame, after_ns = frame_with(5_000_000, arrives_after_ns=25_000_000, exposure_ns=2_000_000)
    assert after_ns == pytest.approx(4_000_000, abs=QUESTION_NS)
    assert 1e-3 <= frame.start_uncertainty_s <= 1.1e-3


@pytest.mark.parametrize("stamp_ms", [-50, 60])
def test_a_stamp_that_cannot_be_is_not_believed(stamp_ms):
    frame, after_ns = frame_with(stamp_ms * 10**6, arrives_after_ns=25_000_000)
    assert (frame.start_source, after_ns, frame.start_uncertainty_s) == ("trigger", 0, 0.005)


def test_a_camera_that_runs_by_itself_began_up_to_a_period_earlier():
    frame, after_ns = frame_with(0, arrives_after_ns=90_000_000, camera=Features(latch=None), free_period_s=0.05)
    assert (frame.start_source, after_ns, frame.start_uncertainty_s) == ("arrival", 70_000_000, 0.05)


@pytest.fixture
def served():
    """Open the camera of a clock, behind the network that answers for it."""
    with ExitStack() as opened:

        def serve(truth, options=""):
            clock = DeviceClock(truth)
            opened.enter_context(gige_port())
            device = opened.enter_context(serve_gige_camera(KnownPictures(width=64, height=48), clock=clock))
            opened.enter_context(lossy_network(camera=device.address, clock=clock))
            return opened.enter_context(GigeCamera(load_aravis(), read_gige_place(f"127.0.0.2?{options}"))), clock

        yield serve


def starts_off_ns(camera, clock, *, pictures):
    """By how much starts are off, and how much is stated, once the clock is known."""
    found = []
    for _ in range(pictures):
        frame = camera.take_frame(timeout_s=10.0)
        found.append((frame.start_utc_ns - clock.stamped_utc_ns, frame.start_uncertainty_s * 1e9, frame.start_source))
    return found[2:]


@pytest.mark.parametrize("drift_ppm", [-90.0, 40.0])
def test_starts_are_right_by_a_clock_that_drifts(served, drift_ppm):
    camera, clock = served(ClockTruth(drift_ppm=drift_ppm, tick_hz=36_858_974))
    camera.configure(exposure_s=0.02, gain_db=0.0)
    found = starts_off_ns(camera, clock, pictures=9)
    assert "camera clock" in {source for _, _, source in found}
    assert all(abs(off_ns) <= stated_ns + STAMP_STEP_NS for off_ns, stated_ns, _ in found)
    assert min(stated_ns for _, stated_ns, _ in found) < 0.005 * S


def test_starts_are_right_by_ptp(served):
    camera, clock = served(ClockTruth(has_ptp=True, ptp_offset_ns=2000), "ptp=1")
    camera.configure(exposure_s=0.1, gain_db=0.0)
    # A computer that is busy with other work reads the clock too slowly to believe some of the stamps.
    found = []
    while "ptp" not in {source for _, _, source in found}:
        assert len(found) < 200
        found += starts_off_ns(camera, clock, pictures=9)
    assert all(abs(off_ns) <= stated_ns + STAMP_STEP_NS for off_ns, stated_ns, _ in found)


def test_without_a_clock_a_start_lies_between_trigger_and_first_packet():
    need_aravis()
    with open_aravis("Fake_1?width=64&height=64") as camera:
        frame = camera.take_frame(timeout_s=5.0)
    assert frame.start_source == "trigger"
    assert 0.0 <= frame.start_uncertainty_s < 5.0
