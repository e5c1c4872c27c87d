"""What is special about the simulated GigE camera; all else is seen through the driver's own tests."""

import pytest

from drivers.errors import NotConnectedError
from sim_devices.cameras import gige_server as registers
from sim_devices.cameras.gige_server import serve_gige_camera
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port
from tests.sim_devices.cameras.known_pictures import KnownPictures


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


def test_a_list_of_features_of_another_library_is_refused():
    with pytest.raises(ValueError, match=r"libaravis 0\.8"):
        registers.extended("<RegisterDescription></RegisterDescription>")
