"""Cameras that libaravis reaches otherwise than over a network, tried on the one that it simulates within the program.

Its list of features is replaced for cameras with habits of their own.
"""

import ctypes

import numpy as np
import pytest

from drivers.cameras.aravis import load_aravis
from drivers.cameras.gige import find_usb3, open_aravis, open_usb3
from drivers.errors import LimitError, NotConnectedError
from tests.sim_devices.cameras.gige_port import need_aravis

PLACE = "Fake_1?width=512&height=512"
TIMEOUT_S = 5.0
EXPOSURE = "ExposureTimeAbs"
UNUSED_MEMORY = 0x410


@pytest.fixture(autouse=True)
def aravis():
    need_aravis()


@pytest.fixture
def features_of(tmp_path):
    """Give cameras that are opened from now on another list of features, made from the library's own."""
    library = ctypes.CDLL("libaravis-0.8.so.0")
    library.arv_fake_camera_new.restype = library.arv_fake_camera_get_genicam_xml.restype = ctypes.c_void_p
    library.arv_fake_camera_get_genicam_xml.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    size = ctypes.c_size_t()
    own = library.arv_fake_camera_get_genicam_xml(library.arv_fake_camera_new(b"probe"), ctypes.byref(size))
    xml = ctypes.string_at(own, size.value).rstrip(b"\0").decode()

    def change(edit):
        file = tmp_path / "features.xml"
        file.write_text(edit(xml), encoding="utf-8")
        library.arv_set_fake_camera_genicam_filename(str(file).encode())

    yield change
    library.arv_set_fake_camera_genicam_filename(None)


def added(xml, nodes, *names):
    """A list with more nodes, and their names in a category."""
    xml = xml.replace("</RegisterDescription>", f"{nodes}</RegisterDescription>")
    category = '<Category Name="AcquisitionControl" NameSpace="Custom">'
    assert category in xml
    return xml.replace(category, category + "".join(f"<pFeature>{name}</pFeature>" for name in names))


def switch(name, address):
    return (
        f'<Boolean Name="{name}"><pValue>{name}Register</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>'
        f'<IntReg Name="{name}Register"><Address>{address:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


@pytest.mark.parametrize(("pixel_format", "top"), [("Mono8", 255), ("Mono16", 65535)])
def test_a_ramp_comes_whole(pixel_format, top):
    with open_aravis(f"{PLACE}&pixel_format={pixel_format}") as camera:
        counts = camera.take_frame(timeout_s=TIMEOUT_S).counts.astype(int)
    assert counts.shape == (512, 512)
    assert counts.max() <= top
    # The library draws diagonals: what lies one to the right and one up is alike.
    assert (counts[1:, :-1] == counts[:-1, 1:]).mean() > 0.99
    assert len(np.unique(counts)) > 200


def test_pictures_are_taken_when_they_are_asked_for():
    with open_aravis(PLACE) as camera:
        numbers = [camera.take_frame(timeout_s=TIMEOUT_S).sequence for _ in range(4)]
        assert np.diff(numbers).tolist() == [1, 1, 1]
        assert camera.facts().triggered


def test_its_packets_are_not_counted_as_it_sends_none():
    with open_aravis(PLACE) as camera:
        camera.take_frame(timeout_s=TIMEOUT_S)
        assert (camera.tally().packets, camera.tally().packets_lost) == (0, 0)


@pytest.mark.parametrize("place", ["Fake_9", "SERIAL"])
def test_a_camera_that_is_not_there_is_named(place):
    with pytest.raises(NotConnectedError, match=place):
        open_aravis(place)


def test_a_usb_camera_that_is_not_there_says_what_it_needs():
    with pytest.raises(NotConnectedError, match="USB 3 port"):
        open_usb3("12345")


def test_the_one_that_is_simulated_is_no_usb_camera():
    with open_aravis(PLACE):
        assert list(find_usb3()) == []


def test_a_wrong_option_is_refused_before_anything_is_opened():
    with pytest.raises(LimitError, match="retakes"):
        open_usb3("1?retakes=many")


def exposure_node(xml, node):
    """A list with another node for the exposure; its name in the list of what can be set goes with it."""
    start = xml.index(f'<Float Name="{EXPOSURE}"')
    end = xml.index("</Float>", start) + len("</Float>")
    return xml[:start] + node + xml[end:]


def whole(name, least, most):
    return f'<Integer Name="{name}"><pValue>{EXPOSURE}Register</pValue><Min>{least}</Min><Max>{most}</Max></Integer>'


def test_an_exposure_that_is_a_whole_number_is_set_and_read(features_of):
    features_of(lambda xml: exposure_node(xml, whole(EXPOSURE, 10, 10**6)))
    with open_aravis(PLACE) as camera:
        assert camera.configure(exposure_s=0.0034567, gain_db=0.0).exposure_s == 0.003457
        with pytest.raises(LimitError, match="ExposureTimeAbs"):
            camera.configure(exposure_s=2.0, gain_db=0.0)
        assert camera.take_frame(timeout_s=TIMEOUT_S).settings.exposure_s == 0.003457


def counted(xml, *, unit_us=None):
    """A list with an exposure that counts steps, and perhaps says of what."""
    xml = exposure_node(xml, whole("ExposureTimeRaw", 1, 10**5))
    xml = xml.replace(f"<pFeature>{EXPOSURE}<", "<pFeature>ExposureTimeRaw<")
    if unit_us is None:
        return xml
    return added(xml, f'<Float Name="ExposureTimeBaseAbs"><Value>{unit_us}</Value></Float>', "ExposureTimeBaseAbs")


def test_an_exposure_in_steps_is_in_the_unit_that_the_camera_tells(features_of):
    features_of(lambda xml: counted(xml, unit_us=20.0))
    with open_aravis(PLACE) as camera:
        assert camera.configure(exposure_s=0.003, gain_db=0.0).exposure_s == 0.003
        assert camera.features()["ExposureTimeRaw"] == "150"
        with pytest.raises(LimitError, match="in steps of 20 us"):
            camera.configure(exposure_s=3.0, gain_db=0.0)


def test_an_exposure_in_steps_of_nothing_is_refused_until_the_unit_is_stated(features_of):
    features_of(counted)
    with pytest.raises(LimitError, match="exposure_step_us"):
        open_aravis(PLACE)
    with open_aravis(f"{PLACE}&exposure_step_us=10") as camera:
        assert camera.configure(exposure_s=0.003, gain_db=0.0).exposure_s == 0.003
        assert camera.features()["ExposureTimeRaw"] == "300"


def test_what_some_send_behind_their_pixels_is_switched_off(features_of):
    features_of(lambda xml: added(xml, switch("ChunkModeActive", UNUSED_MEMORY), "ChunkModeActive"))
    with open_aravis(PLACE) as camera:
        assert camera.features()["ChunkModeActive"] == "False"
        assert camera.take_frame(timeout_s=TIMEOUT_S).counts.shape == (512, 512)


def limited(name):
    return (
        f'<Integer Name="{name}"><pValue>{name}Register</pValue><Min>1000000</Min><Max>400000000</Max></Integer>'
        f'<IntReg Name="{name}Register"><Address>{UNUSED_MEMORY:#x}</Address><Length>4</Length>'
        "<AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


@pytest.mark.parametrize("name", ["DeviceLinkThroughputLimit", "StreamBytesPerSecond"])
def test_cameras_that_share_a_line_take_what_is_stated(features_of, name):
    features_of(lambda xml: added(xml, limited(name), name))
    with open_aravis(f"{PLACE}&bandwidth_mb_per_s=62.5") as camera:
        assert camera.features()[name] == "62500000"
    with pytest.raises(LimitError, match=name):
        open_aravis(f"{PLACE}&bandwidth_mb_per_s=1000")


def test_one_without_a_limit_says_so():
    with pytest.raises(LimitError, match="bandwidth cannot be set"):
        open_aravis(f"{PLACE}&bandwidth_mb_per_s=60")


def test_the_library_is_told_apart_from_the_device_by_its_words():
    with pytest.raises(LimitError, match="NoSuchFormat"):
        open_aravis(f"{PLACE}&pixel_format=NoSuchFormat")
    assert load_aravis().call("get_n_devices") >= 0
