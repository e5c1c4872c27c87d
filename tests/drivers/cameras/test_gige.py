"""The GigE Vision driver against libaravis's own device: real packets, pictures known to the last bit."""

import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from drivers.cameras.aravis import load_aravis
from drivers.cameras.bounded_camera import BoundedCamera
from drivers.cameras.gige import GigeCamera, find_gige, open_gige, read_gige_place
from drivers.errors import LimitError, NotConnectedError, ProtocolError
from sim_devices.cameras import gige_server as registers
from sim_devices.cameras.gige_server import serve_gige_camera
from tests.sim_devices.cameras.gige_port import ADDRESS, gige_port
from tests.sim_devices.cameras.known_pictures import EXPOSURE, MARK, NUMBER, KnownPictures, assert_known

TIMEOUT_S = 10.0
PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXPOSURE_REGISTER = 0x120


@pytest.fixture
def source():
    return KnownPictures(width=64, height=48)


@pytest.fixture
def device(source):
    with gige_port(), serve_gige_camera(source, serial_number="T7") as served:
        yield served


@pytest.fixture
def open_camera(device):
    opened = []

    def open_with(options="") -> BoundedCamera:
        camera = open_gige(f"{ADDRESS}?{options}")
        opened.append(camera)
        return camera

    yield open_with
    for camera in opened:
        camera.close()


@pytest.mark.parametrize("name", ["Mono12", "Mono12Packed", "Mono12p"])
def test_pictures_come_bit_for_bit(open_camera, name):
    camera = open_camera(f"pixel_format={name}")
    assert_known(camera.take_frame(timeout_s=TIMEOUT_S).counts)


def test_the_best_format_is_taken_where_none_is_named(open_camera):
    assert open_camera().configure(exposure_s=0.01, gain_db=0.0).bit_depth == 12


def test_left_justified_samples_are_shifted_down(open_camera):
    camera = open_camera("pixel_format=Mono16&bit_depth=12&justified=left")
    frame = camera.take_frame(timeout_s=TIMEOUT_S)
    assert frame.settings.bit_depth == 12
    assert_known(frame.counts)


def test_wrong_justification_is_found(device):
    with pytest.raises(ProtocolError, match="justified"):
        open_gige(f"{ADDRESS}?pixel_format=Mono16&bit_depth=12&justified=right")


def test_what_is_automatic_or_bends_counts_is_switched_off_and_said_to_be(device, open_camera):
    assert device.read_register(registers.GAMMA) == 1
    assert open_camera().facts().linear is True
    assert device.read_register(registers.GAMMA) == 0
    assert device.read_register(registers.EXPOSURE_AUTO) == registers.EXPOSURE_AUTO_OFF
    assert device.read_register(registers.GAIN_AUTO) == registers.GAIN_AUTO_OFF


@pytest.mark.parametrize(("options", "expected"), [("", True), ("trigger=free&frame_rate_hz=25", False)])
def test_it_tells_whether_it_is_triggered(open_camera, options, expected):
    assert open_camera(options).facts().triggered is expected


def test_the_names_of_features_are_told(open_camera):
    camera = open_camera("pixel_format=Mono12")
    camera.configure(exposure_s=0.004, gain_db=3.0)
    features = camera.features()
    expected = {"PixelFormat": "Mono12", "ExposureTimeAbs": "4000", "GainRaw": "3", "ReverseX": "False"}
    assert features.items() >= expected.items()
    assert float(features["DeviceTemperature"]) == 28.5


@pytest.mark.parametrize("exposure_us", [29, 30, 31, 57, 1001])
def test_whole_microseconds_are_not_cut_short(open_camera, exposure_us):
    settings = open_camera().configure(exposure_s=exposure_us / 1e6, gain_db=0.0)
    assert settings.exposure_s == pytest.approx(exposure_us / 1e6, rel=1e-12)


def test_a_region_is_cut_out_of_the_picture(open_camera):
    counts = open_camera("width=3&height=2&offset_x=1").take_frame(timeout_s=TIMEOUT_S).counts
    assert counts.shape == (2, 3)
    assert counts[0, EXPOSURE[1] - 1] == 1000  # 10 ms, which stands one column to the left now


def test_a_mirrored_picture_is_one_that_was_asked_for(open_camera):
    camera = open_camera("reverse_x=1")
    assert_known(camera.take_frame(timeout_s=TIMEOUT_S).counts[:, ::-1])
    assert camera.features()["ReverseX"] == "True"


@pytest.mark.parametrize(
    ("plane", "places", "bits"),
    [("blue", [(1, 1)], 12), ("green", [(0, 1), (1, 0)], 13), ("sum", [(0, 0), (0, 1), (1, 0), (1, 1)], 14)],
)
def test_a_plane_is_taken_of_a_mosaic(source, open_camera, plane, places, bits):
    frame = open_camera(f"pixel_format=BayerRG12&plane={plane}").take_frame(timeout_s=TIMEOUT_S)
    assert (frame.settings.width, frame.settings.height, frame.settings.bit_depth) == (32, 24, bits)
    mosaic = source.last_counts.astype(np.int64)
    parts = np.array([mosaic[row::2, column::2] for row, column in places])
    saturated = (parts == 4095).any(axis=0)
    np.testing.assert_array_equal(frame.counts, np.where(saturated, 2**bits - 1, parts.sum(axis=0)))


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("pixel_format=Mono99", "Mono99"),
        ("width=9999", "9999"),
        ("width=40&offset_x=30", "offset 30"),
        ("binning=2", "Binning"),
        ("reverse_y=1", "ReverseY"),
        ("pixel_format=Mono12&bit_depth=10", "bit_depth"),
        ("black_level_dn=3", "black level"),
        ("colour=1", "allowed are"),
        ("pixel_format=BayerRG12", "plane="),
        ("pixel_format=Mono12&plane=red", "plane="),
        ("pixel_format=BayerRG12&plane=red&reverse_x=1", "no mirroring"),
        ("pixel_format=BayerRG12&plane=red&offset_x=1&width=8", "even offsets"),
    ],
)
def test_what_the_camera_cannot_do_is_refused(device, options, problem):
    with pytest.raises(LimitError, match=problem):
        open_gige(f"{ADDRESS}?{options}")


def test_gain_between_two_steps_is_refused(open_camera):
    with pytest.raises(LimitError, match="steps of 1 dB"):
        open_camera().configure(exposure_s=0.01, gain_db=1.5)


def test_is_found_and_opened_by_serial_number_and_by_name(device):
    assert dict(find_gige())[f"gige:{ADDRESS}"].serial_number == "T7"
    for place in ("T7", "Aravis-Fake-T7"):
        with open_gige(place) as camera:
            assert (camera.identify().model, camera.identify().serial_number) == ("Aravis Fake", "T7")


def test_a_serial_number_that_does_not_answer_is_said_so_with_those_that_do(device):
    with pytest.raises(NotConnectedError, match="T7"):
        open_gige("T8")


def test_settings_that_changed_behind_its_back_are_restored_before_a_picture_is_accepted(device, open_camera):
    camera = open_camera()
    camera.configure(exposure_s=0.02, gain_db=0.0)
    device.write_register(EXPOSURE_REGISTER, 1234)
    frame = camera.take_frame(timeout_s=TIMEOUT_S)
    assert frame.counts[EXPOSURE] == 2000
    assert camera.tally().reopened == 1


def assert_of_after(source, frame, turn, *, period_s):
    """A picture is of after the mark was set, unless the device held it back for longer than a driver can know."""
    held_s = (frame.end_utc_ns - source.made_utc_ns[frame.counts[NUMBER]]) / 1e9
    assert frame.counts[MARK] == turn or held_s > frame.settings.exposure_s + period_s


def test_a_running_camera_gives_no_picture_of_before(source, open_camera):
    # The host is busy until more pictures have come than there are buffers; then the polarizer is turned.
    camera = open_camera("trigger=free&frame_rate_hz=100")
    camera.configure(exposure_s=0.002, gain_db=0.0)
    for turn in range(1, 11):
        source.await_pictures(10)
        source.mark = turn
        assert_of_after(source, camera.take_frame(timeout_s=TIMEOUT_S), turn, period_s=0.01)
    assert camera.tally().accepted == 11


def test_a_picture_whose_exposure_had_begun_is_not_accepted(source, open_camera):
    # Here one is always under way: exposures of 30 ms in periods of 40 ms.
    camera = open_camera("trigger=free&frame_rate_hz=25")
    camera.configure(exposure_s=0.03, gain_db=0.0)
    for turn in range(1, 6):
        source.await_pictures(1)
        source.mark = turn
        assert_of_after(source, camera.take_frame(timeout_s=TIMEOUT_S), turn, period_s=0.04)
    assert camera.tally().too_old >= 5


def test_numbers_go_on_where_the_camera_begins_anew_at_one(device):
    # The device begins at 65401 and goes from 65535 to 1, at 1000 pictures a second.
    options = read_gige_place(f"{ADDRESS}?trigger=free&frame_rate_hz=1000")
    with GigeCamera(load_aravis(), options) as camera:
        camera.configure(exposure_s=0.0001, gain_db=0.0)
        numbers = [camera.take_frame(timeout_s=TIMEOUT_S).sequence]
        while camera._numbers.last_id > 60000 and len(numbers) < 200:
            numbers.append(camera.take_frame(timeout_s=TIMEOUT_S).sequence)
        assert camera._numbers.last_id < 100
    assert (np.diff(numbers) > 0).all()
    assert numbers[-1] - numbers[0] < 300


def test_two_programs_cannot_have_one_camera(open_camera):
    open_camera()
    with pytest.raises(NotConnectedError, match="another program controls"):
        open_gige(ADDRESS)


def test_without_the_library_its_package_is_named(monkeypatch):
    monkeypatch.setenv("ARAVIS_LIBRARY", "/nowhere/libaravis.so")
    with pytest.raises(NotConnectedError, match=r"apt install libaravis-0\.8-0"):
        open_gige(ADDRESS)


@pytest.mark.parametrize("group", ["rigctl.cameras", "rigctl.camera_finders"])
def test_what_the_project_registers_is_there(group):
    for place in PROJECT["entry-points"][group].values():
        module, _, name = place.partition(":")
        assert callable(getattr(import_module(module), name))
