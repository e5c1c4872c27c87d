"""The V4L2 driver against answers to its requests; the kernel's own test device has its suite in ``tests/vm``."""

import errno

import numpy as np
import pytest

from drivers.cameras import v4l2
from drivers.cameras.v4l2 import V4l2Camera, find_v4l2, read_v4l2_place, sample_format
from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from tests.drivers.cameras.fake_video import AUTOGAIN, EXPOSURE_AUTO, FakeVideo, Shot

MS = 1_000_000


def camera_on(video, options=""):
    chosen = read_v4l2_place(f"/dev/fake?{options}")
    return V4l2Camera(video, chosen, now_ns=video.now_ns, utc_ns=lambda: 10**18 + video.now)


@pytest.fixture
def video():
    return FakeVideo()


def test_everything_automatic_is_off_when_it_is_open(video):
    camera_on(video)
    assert video.controls[EXPOSURE_AUTO] == 1  # "manual"
    assert video.controls[AUTOGAIN] == 0


def test_what_may_bend_counts_is_told_as_it_was_found(video):
    gamma = 0x00980910
    video.controls[gamma] = 2
    camera = camera_on(video)
    assert camera.features()[f"control {gamma:#x}"] == "2 (as found)"
    assert camera.facts().linear is None


def test_an_automatic_that_stays_on_is_refused(video):
    video.stubborn.add(AUTOGAIN)
    with pytest.raises(LimitError, match="0x980912"):
        camera_on(video)


def test_an_automatic_that_comes_on_again_is_refused(video):
    camera = camera_on(video)
    video.controls[AUTOGAIN] = 1
    video.shots = [Shot(0, 50 * MS)]
    with pytest.raises(LimitError, match="again"):
        camera.take_frame(timeout_s=1.0)


def test_exposure_goes_in_steps_of_100_us(video):
    settings = camera_on(video).configure(exposure_s=0.0031, gain_db=0.0)
    assert video.controls[v4l2.EXPOSURE_ABSOLUTE] == 31
    assert settings.exposure_s == pytest.approx(0.0031, rel=1e-12)


@pytest.mark.parametrize("exposure_s", [0.0, 1e-5, 2.0, float("nan")])
def test_exposure_out_of_range_is_refused_and_changes_nothing(video, exposure_s):
    camera = camera_on(video)
    before = dict(video.controls)
    with pytest.raises(LimitError, match="exposure_s"):
        camera.configure(exposure_s=exposure_s, gain_db=0.0)
    assert video.controls == before


def test_gain_is_converted_by_its_step(video):
    settings = camera_on(video, "gain_step_db=0.5").configure(exposure_s=0.01, gain_db=6.0)
    assert video.controls[v4l2.GAIN] == 10 + 12
    assert settings.gain_db == 6.0


def test_gain_of_an_unknown_step_is_the_smallest(video):
    camera = camera_on(video)
    assert video.controls[v4l2.GAIN] == 10
    with pytest.raises(LimitError, match="gain_step_db"):
        camera.configure(exposure_s=0.01, gain_db=6.0)


def test_a_picture_that_ended_an_exposure_too_early_is_passed_over(video):
    camera = camera_on(video)
    video.now = 100 * MS
    # Exposed for 10 ms: the first began at 99 ms, the second at 110 ms.
    video.shots = [Shot(0, 109 * MS), Shot(1, 120 * MS)]
    frame = camera.take_frame(timeout_s=1.0)
    assert (frame.sequence, frame.start_monotonic_ns) == (1, 110 * MS)
    assert frame.start_utc_ns == 10**18 + 110 * MS
    assert camera.tally().too_old == 1


def test_a_stamp_of_the_start_is_taken_as_it_is(video):
    camera = camera_on(video)
    video.now = 100 * MS
    video.shots = [Shot(0, 105 * MS, flags=v4l2.MONOTONIC | v4l2.AT_START_OF_EXPOSURE)]
    frame = camera.take_frame(timeout_s=1.0)
    assert (frame.start_monotonic_ns, frame.start_uncertainty_s, frame.start_source) == (105 * MS, 1e-6, "driver")


def test_a_stamp_of_the_end_leaves_the_start_open_by_the_time_between_two_pictures(video):
    camera = camera_on(video)
    video.shots = [Shot(0, 50 * MS), Shot(1, 100 * MS), Shot(4, 220 * MS)]
    assert [camera.take_frame(timeout_s=1.0).start_uncertainty_s for _ in range(3)] == [None, 0.05, 0.04]


@pytest.mark.parametrize("flags", [0, v4l2.MONOTONIC])
def test_a_stamp_of_the_time_of_day_is_found_out_by_its_size(video, flags):
    camera = camera_on(video)
    video.now = 100 * MS
    # The clock went on to the second one only, which is when the first is looked at, too.
    stamps = (10**18 + 109 * MS, 10**18 + 120 * MS)
    video.wait = lambda timeout_s: bool(video.shots) and not setattr(video, "now", 125 * MS)
    video.shots = [Shot(number, stamp, flags=flags) for number, stamp in enumerate(stamps)]
    frame = camera.take_frame(timeout_s=1.0)
    assert (frame.sequence, frame.start_monotonic_ns, frame.start_utc_ns) == (1, 110 * MS, 10**18 + 110 * MS)


def test_a_time_of_day_that_was_set_meanwhile_tells_no_age(video):
    hour_ns, off_ns = 3600 * 10**9, [0]
    chosen = read_v4l2_place("/dev/fake?")
    camera = V4l2Camera(video, chosen, now_ns=video.now_ns, utc_ns=lambda: 10**18 + video.now + off_ns[0])
    video.now = 100 * MS
    video.shots = [Shot(0, 10**18 + hour_ns, flags=0)]

    def set_clock(timeout_s):
        off_ns[0], video.now = hour_ns, video.now + 50 * MS
        return bool(video.shots)

    video.wait = set_clock
    with pytest.raises(DeviceTimeoutError):
        camera.take_frame(timeout_s=1.0)
    assert camera.tally().too_old == 1


def test_another_clock_is_refused(video):
    camera = camera_on(video)
    video.shots = [Shot(0, 50 * MS, flags=0)]
    with pytest.raises(ProtocolError, match="monotonic"):
        camera.take_frame(timeout_s=1.0)


@pytest.mark.parametrize("bad", [{"flags": v4l2.MONOTONIC | v4l2.DAMAGED}, {"bytesused": 15}])
def test_a_damaged_picture_is_counted_and_the_next_one_taken(video, bad):
    camera = camera_on(video)
    video.shots = [Shot(0, 50 * MS, **bad), Shot(1, 60 * MS)]
    assert camera.take_frame(timeout_s=1.0).sequence == 1
    assert camera.tally().damaged == 1


def test_too_many_damaged_pictures_are_an_error(video):
    camera = camera_on(video, "retakes=2")
    video.shots = [Shot(n, (50 + n) * MS, bytesused=3) for n in range(3)]
    with pytest.raises(ProtocolError, match="3 damaged"):
        camera.take_frame(timeout_s=1.0)


def test_gaps_in_the_numbers_are_counted(video):
    camera = camera_on(video)
    video.shots = [Shot(2, 50 * MS), Shot(6, 90 * MS)]
    camera.take_frame(timeout_s=1.0)
    camera.take_frame(timeout_s=1.0)
    assert camera.tally().never_came == 3


def test_no_picture_is_a_timeout(video):
    camera = camera_on(video)
    with pytest.raises(DeviceTimeoutError, match="no new picture"):
        camera.take_frame(timeout_s=0.5)
    assert video.now == 500 * MS


def test_another_size_than_asked_for_is_refused(video):
    video.offered = (640, 480)
    with pytest.raises(LimitError, match="640 x 480"):
        camera_on(video, "width=782&height=582")


@pytest.mark.parametrize(
    ("number", "kind"),
    [(errno.ENODEV, NotConnectedError), (errno.EIO, ProtocolError), (errno.EBUSY, NotConnectedError)],
)
def test_what_the_kernel_refuses_is_told_apart(video, number, kind):
    camera = camera_on(video)
    video.shots = [Shot(0, 50 * MS)]
    video.broken = number
    with pytest.raises(kind, match="/dev/fake"):
        camera.take_frame(timeout_s=1.0)


def test_it_stops_when_it_is_closed_even_if_it_was_unplugged(video):
    camera = camera_on(video)
    video.broken = errno.ENODEV
    camera.close()
    assert video.closed


@pytest.mark.parametrize(
    ("letters", "cell"),
    [
        ("RG12", "RGGB"),
        ("BG12", "BGGR"),
        ("GB10", "GBRG"),
        ("BA10", "GRBG"),
        ("BA81", "BGGR"),
        ("BYR2", "BGGR"),
        ("pgAA", "GRBG"),
    ],
)
def test_the_cell_of_a_mosaic_is_the_one_of_the_formats_name(letters, cell):
    assert sample_format(read_v4l2_place(f"/dev/fake?pixel_format={letters}&plane=red")).cell == cell


def test_the_big_end_first_has_a_number_of_its_own():
    assert v4l2.fourcc("Y16_BE") == v4l2.fourcc("Y16 ") | 1 << 31
    assert [v4l2.letters_of(v4l2.fourcc(letters)) for letters in ("Y16_BE", "Y16 ", "RG12")] == [
        "Y16_BE",
        "Y16 ",
        "RG12",
    ]
    assert sample_format(read_v4l2_place("/dev/fake?pixel_format=Y16_BE")).byte_order == "big"


def test_colours_are_summed(video):
    camera = camera_on(video, "pixel_format=RG12&plane=sum")
    video.shots = [Shot(7, 50 * MS)]
    frame = camera.take_frame(timeout_s=1.0)
    assert frame.settings.bit_depth == 14
    assert frame.counts.shape == (frame.settings.height, frame.settings.width) == (1, 2)
    np.testing.assert_array_equal(frame.counts, 4 * 7)


def test_a_sum_that_does_not_fit_is_refused_at_once(video):
    with pytest.raises(LimitError, match="true bit_depth"):
        camera_on(video, "pixel_format=RG16&plane=sum")


def test_a_bayer_format_needs_a_colour():
    with pytest.raises(LimitError, match="plane="):
        read_v4l2_place("/dev/fake?pixel_format=RG12")


def test_bits_of_a_format_that_has_them_all_cannot_be_others():
    with pytest.raises(LimitError, match="bit_depth"):
        sample_format(read_v4l2_place("/dev/fake?pixel_format=Y12&bit_depth=10"))


class OfferingVideo(FakeVideo):
    """A video device that offers these formats."""

    def __init__(self, *letters, can=v4l2.CAN_CAPTURE | v4l2.CAN_STREAM):
        super().__init__()
        self._letters, self._can = letters, can

    def request(self, number, content):
        if number == v4l2.ENUM_FMT:
            if content.index >= len(self._letters):
                raise OSError(errno.EINVAL, "no more")
            content.pixelformat = v4l2.fourcc(self._letters[content.index])
            return
        super().request(number, content)
        if number == v4l2.QUERYCAP:
            content.capabilities = self._can


def found_of(*videos):
    nodes = {f"/dev/fake{index}": video for index, video in enumerate(videos)}
    return list(find_v4l2(nodes, open_node=nodes.__getitem__))


@pytest.mark.parametrize(
    ("letters", "address"),
    [
        (("YUYV", "GREY", "Y12 ", "Y16 "), "v4l2:/dev/fake?pixel_format=Y12"),
        (("YUYV", "RG12"), "v4l2:/dev/fake?pixel_format=RG12&plane=green-1"),
        (("YUYV", "MJPG"), "v4l2:/dev/fake"),
    ],
)
def test_a_video_device_is_found_with_its_best_format(letters, address):
    ((told, identity),) = found_of(OfferingVideo(*letters))
    assert told == address
    assert identity.serial_number == "usb-1"


def test_a_device_that_has_no_counts_says_so():
    ((_, identity),) = found_of(OfferingVideo("YUYV", "MJPG"))
    assert "YUYV, MJPG: no counts" in identity.model


def test_what_is_no_camera_is_left_out():
    assert found_of(OfferingVideo("Y12 ", can=0x4)) == []


def test_devices_behind_one_that_may_not_be_asked_are_found_all_the_same():
    def opened(path):
        if path == "/dev/first":
            raise NotConnectedError("/dev/first: join its group")
        return OfferingVideo("GREY")

    finder = find_v4l2(["/dev/first", "/dev/second"], open_node=opened)
    assert next(finder)[0].startswith("v4l2:/dev/")
    with pytest.raises(NotConnectedError, match="join its group"):
        next(finder)


def test_every_asked_device_is_closed():
    video = OfferingVideo("GREY")
    found_of(video)
    assert video.closed
