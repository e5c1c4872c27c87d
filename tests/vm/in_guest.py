"""The V4L2 driver against a real device of the kernel. Run inside the virtual machine, where /dev/video0 is `vivid`."""

import ctypes
import fcntl

import numpy as np
import pytest

from drivers.cameras import v4l2
from drivers.cameras.v4l2 import find_v4l2, open_v4l2
from drivers.errors import DeviceError, LimitError

DEVICE = "/dev/video0"
OPTIONS = "width=640&height=360&exposure_control=none"
TIMEOUT_S = 20.0

AUTOGAIN = 0x00980912
GREY_RAMP = 20


def set_control(control, value):
    with open(DEVICE, "rb") as node:  # noqa: PTH123
        fcntl.ioctl(node, v4l2.S_CTRL, v4l2.Control(id=control, value=value))


def controls_by_name():
    """Walk through all controls, as the kernel numbers them."""
    found, following = {}, 0x80000000
    with open(DEVICE, "rb") as node:  # noqa: PTH123
        control = v4l2.QueryControl(id=following)
        while True:
            try:
                fcntl.ioctl(node, v4l2.QUERYCTRL, control)
            except OSError:
                return found
            found[control.name.decode()] = control.id
            control = v4l2.QueryControl(id=control.id | following)


@pytest.fixture(scope="module")
def named():
    return controls_by_name()


def test_structures_are_as_long_as_the_kernels():
    sizes = [ctypes.sizeof(kind) for kind in (v4l2.Format, v4l2.Buffer, v4l2.RequestBuffers, v4l2.QueryControl)]
    assert sizes == [208, 88, 20, 68]


@pytest.mark.parametrize("name", ["GREY", "Y10", "Y12", "Y16"])
def test_the_grey_ramp_has_its_counts(named, name):
    set_control(named["Test Pattern"], GREY_RAMP)
    set_control(named["OSD Text Mode"], 2)
    with open_v4l2(f"{DEVICE}?pixel_format={name}&{OPTIONS}") as camera:
        frame = camera.take_frame(timeout_s=TIMEOUT_S)
    bits = frame.settings.bit_depth
    assert frame.counts.shape == (360, 640)
    # vivid computes eight bits and shifts them up: all counts are multiples, and the ramp goes nearly all the way.
    assert not (frame.counts & (2 ** (bits - 8) - 1)).any()
    assert int(np.ptp(frame.counts)) >= 0.8 * 2**bits
    assert (np.diff(frame.counts[180].astype(int)) >= 0).all()


def test_it_is_found_with_a_format_to_measure_in():
    addresses = [address for address, _ in find_v4l2()]
    assert f"v4l2:{DEVICE}?pixel_format=Y12" in addresses


@pytest.mark.parametrize(("plane", "bits"), [("red", 12), ("green", 13), ("sum", 14)])
def test_planes_of_a_mosaic_have_their_size_and_bits(plane, bits):
    with open_v4l2(f"{DEVICE}?pixel_format=RG12&plane={plane}&{OPTIONS}") as camera:
        frame = camera.take_frame(timeout_s=TIMEOUT_S)
    assert frame.counts.shape == (180, 320)
    assert frame.settings.bit_depth == bits
    assert int(frame.counts.max()) < 2**bits


def test_the_automatic_gain_is_switched_off(named):
    set_control(AUTOGAIN, 1)
    with open_v4l2(f"{DEVICE}?pixel_format=Y12&{OPTIONS}") as camera:
        assert camera.features()["Gain, Automatic"] == "0"


def test_an_automatic_that_comes_on_again_is_found():
    with open_v4l2(f"{DEVICE}?pixel_format=Y12&{OPTIONS}") as camera:
        set_control(AUTOGAIN, 1)
        with pytest.raises(LimitError, match="Automatic"):
            camera.take_frame(timeout_s=TIMEOUT_S)


def test_a_size_that_it_does_not_have_is_refused():
    with pytest.raises(LimitError, match="640 x 480"):
        open_v4l2(f"{DEVICE}?pixel_format=Y12&width=782&height=582&exposure_control=none")


def test_an_exposure_that_it_does_not_have_is_said_so():
    with pytest.raises(LimitError, match="exposure_control=none"):
        open_v4l2(f"{DEVICE}?pixel_format=Y12")


def test_lost_pictures_are_counted(named):
    with open_v4l2(f"{DEVICE}?pixel_format=Y12&{OPTIONS}") as camera:
        set_control(named["Percentage of Dropped Buffers"], 60)
        try:
            for _ in range(10):
                camera.take_frame(timeout_s=TIMEOUT_S)
        finally:
            set_control(named["Percentage of Dropped Buffers"], 0)
        # That none of ten is dropped: 0.4^10 = 1e-4.
        assert camera.tally().never_came > 0


def test_a_device_that_fails_is_an_error(named):
    with open_v4l2(f"{DEVICE}?pixel_format=Y12&{OPTIONS}") as camera:
        set_control(named["Inject Fatal Streaming Error"], 1)
        with pytest.raises(DeviceError):
            take_three(camera)


def take_three(camera):
    for _ in range(3):
        camera.take_frame(timeout_s=3.0)


def test_damaged_pictures_are_counted_and_not_accepted(named):
    with open_v4l2(f"{DEVICE}?pixel_format=Y12&{OPTIONS}") as camera:
        for _ in range(5):
            # The next buffer is marked as damaged; it may still be one of before the call.
            set_control(named["Inject V4L2_BUF_FLAG_ERROR"], 1)
            camera.take_frame(timeout_s=TIMEOUT_S)
        assert camera.tally().accepted == 5
        # The last mark may still wait for its buffer: one that was being filled when it was asked for is not marked.
        assert camera.tally().damaged + camera.tally().too_old >= 4
