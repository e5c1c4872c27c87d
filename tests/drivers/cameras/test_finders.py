"""Cameras that are found without being disturbed, through the entry points that plug-ins have too."""

import errno
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from drivers.cameras import v4l2
from drivers.cameras.gige import find_gige
from drivers.cameras.v4l2 import find_v4l2
from drivers.errors import NotConnectedError
from sim_devices.cameras.gige_server import serve_gige_camera
from tests.drivers.cameras.fake_video import FakeVideo
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port
from tests.sim_devices.cameras.known_pictures import KnownPictures

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


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


def found(*videos):
    nodes = {f"/dev/fake{index}": video for index, video in enumerate(videos)}
    return list(find_v4l2(nodes, open_node=nodes.__getitem__))


def test_a_served_gige_camera_is_found():
    with gige_port(), serve_gige_camera(KnownPictures(width=64, height=48), serial_number="F5"):
        identities = dict(find_gige())
        assert identities[f"gige:{ADDRESS}"].serial_number == "F5"


@pytest.mark.parametrize(
    ("letters", "address"),
    [
        (("YUYV", "GREY", "Y12 ", "Y16 "), "v4l2:/dev/fake?pixel_format=Y12"),
        (("YUYV", "RG12"), "v4l2:/dev/fake?pixel_format=RG12&plane=green-1"),
        (("YUYV", "MJPG"), "v4l2:/dev/fake"),
    ],
)
def test_a_video_device_is_found_with_its_best_format(letters, address):
    ((told, identity),) = found(OfferingVideo(*letters))
    assert told == address
    assert identity.serial_number == "usb-1"


def test_a_device_that_has_no_counts_says_so():
    ((_, identity),) = found(OfferingVideo("YUYV", "MJPG"))
    assert "YUYV, MJPG: no counts" in identity.model


def test_what_is_no_camera_is_left_out():
    assert found(OfferingVideo("Y12 ", can=0x4)) == []


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
    found(video)
    assert video.closed


@pytest.mark.parametrize("group", ["rigctl.cameras", "rigctl.camera_finders"])
def test_what_the_project_registers_is_there(group):
    for place in PROJECT["entry-points"][group].values():
        module, _, name = place.partition(":")
        assert callable(getattr(import_module(module), name))
