"""The simulated GigE camera: bytes by hand from the standard, and its power. The driver's tests see its pictures."""

import queue
import threading

import numpy as np
import pytest

from drivers.errors import NotConnectedError
from sim_devices.cameras import gige_server as registers
from sim_devices.cameras.gige_server import FORMATS, FaultyPower, GigeFaults, bytes_of, serve_gige_camera
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port
from tests.sim_devices.cameras.known_pictures import KnownPictures

PAIR = np.array([[0xABC, 0x123]], dtype=np.uint16)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Mono8", "ab12"),
        ("Mono10", "af024800"),
        ("Mono12", "bc0a2301"),
        ("Mono16", "c0ab3012"),
        ("Mono12Packed", "ab3c12"),
        ("Mono12p", "bc3a12"),
    ],
)
def test_two_samples_of_12_bits(name, expected):
    assert bytes_of(PAIR, bit_depth=12, pixel_format=FORMATS[name]).hex() == expected


@pytest.mark.parametrize(("name", "expected"), [("Mono12Packed", "ab0c"), ("Mono12p", "bc0a")])
def test_the_last_of_an_odd_number_has_two_bytes(name, expected):
    assert bytes_of(PAIR[:, :1], bit_depth=12, pixel_format=FORMATS[name]).hex() == expected


def test_a_format_that_it_does_not_send_is_refused():
    with pytest.raises(ValueError, match="0x02180014"):
        bytes_of(PAIR, bit_depth=12, pixel_format=0x02180014)


TIMEOUT_S = 10.0


class Told:
    """What was done to the camera, in order."""

    def __init__(self, faults):
        self._done = queue.SimpleQueue()
        self.power = FaultyPower(
            faults,
            power_down=lambda: self._done.put("down"),
            power_up=lambda: self._done.put("up"),
            forget=lambda: self._done.put("forget"),
            cut=lambda: self._done.put("cut"),
        )

    def take(self, pictures):
        for _ in range(pictures):
            self.power.before_picture()
            self.power.after_picture()

    def next(self):
        return self._done.get(timeout=TIMEOUT_S)

    def is_all(self):
        return self._done.empty()


def test_it_dies_at_its_picture_and_stays_so():
    told = Told(GigeFaults(die=3))
    with told.power:
        told.take(2)
        assert told.is_all()
        told.take(2)  # one more is counted before the power goes
        # The picture itself is not sent, however slow the machine is to let the power go.
        assert [told.next(), told.next()] == ["cut", "down"]
    assert told.is_all()


def test_it_restarts_again_and_again():
    told = Told(GigeFaults(restart=2, off_s=0.0))
    with told.power:
        for _ in range(3):
            told.take(2)
            assert [told.next(), told.next(), told.next()] == ["cut", "down", "up"]
    assert told.is_all()


def test_it_forgets_after_its_picture_and_once():
    told = Told(GigeFaults(forget=2))
    with told.power:
        told.take(5)
    assert told.next() == "forget"
    assert told.is_all()


def test_a_hang_ends_where_nobody_serves_it_any_more():
    told = Told(GigeFaults(hang=1, hang_s=3600.0))
    with told.power:
        picture = threading.Thread(target=told.take, args=(1,))
        picture.start()
        assert picture.is_alive()
    picture.join(TIMEOUT_S)
    assert not picture.is_alive()


def test_it_powers_up_with_everything_automatic_and_its_whole_sensor():
    with gige_port(), serve_gige_camera(KnownPictures(width=64, height=48)) as device:
        assert device.read_register(registers.EXPOSURE_AUTO) == registers.EXPOSURE_AUTO_CONTINUOUS
        assert device.read_register(registers.GAIN_AUTO) == registers.GAIN_AUTO_CONTINUOUS
        assert (device.read_register(registers.WIDTH), device.read_register(registers.HEIGHT)) == (64, 48)


def test_one_address_serves_one_camera():
    with gige_port(), serve_gige_camera(KnownPictures(width=64, height=48)):
        second = serve_gige_camera(KnownPictures(width=64, height=48), address=ADDRESS)
        with pytest.raises(NotConnectedError, match="port 3956"), second:
            pass
