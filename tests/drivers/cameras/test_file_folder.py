"""A folder as a camera: what counts as a picture of now, and what is refused."""

import os
import time

import cv2
import numpy as np
import pytest

from drivers.cameras.file_folder import FolderCamera, open_folder
from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from tests.drivers.cameras.other_program import save


class Program:
    """Does its next piece of work whenever the camera pauses; its clock goes on by that pause."""

    def __init__(self, *pieces):
        self._pieces = list(pieces)
        self.now = 0.0

    def now_s(self):
        return self.now

    def sleep(self, duration_s):
        self.now += duration_s
        if self._pieces:
            self._pieces.pop(0)()


@pytest.fixture
def folder(tmp_path):
    save(tmp_path, 0)
    return tmp_path


def camera_with(folder, *pieces, **options):
    program = Program(*pieces)
    return FolderCamera(folder, **{"plane": "red", **options}, now_s=program.now_s, sleep=program.sleep)


def later(path, seconds):
    """Date a file from now on by so much: the camera reads clocks of the system, not of the test."""
    moment = time.time() + seconds
    os.utime(path, (moment, moment))


def saved_later(folder, number, exposure=None):
    save(folder, number, exposure)
    later(folder / f"{number:06d}.dng", 1.0)


def test_the_next_file_is_the_picture(folder):
    camera = camera_with(folder, lambda: saved_later(folder, 5))
    expected = np.random.default_rng(5).integers(200, 4096, (48, 64), dtype=np.uint16)[0::2, 0::2]
    np.testing.assert_array_equal(camera.take_frame(timeout_s=1.0).counts, expected)


def test_a_file_of_an_exposure_that_had_begun_is_passed_over(folder):
    def half_way():
        save(folder, 1)
        later(folder / "000001.dng", 0.3)

    camera = camera_with(folder, half_way)
    camera.configure(exposure_s=0.5, gain_db=0.0)
    with pytest.raises(DeviceTimeoutError, match="no new picture"):
        camera.take_frame(timeout_s=1.0)
    assert camera.tally().too_old == 1


def test_a_file_that_still_grows_is_waited_for(folder):
    def grow():
        whole = folder / "000009.dng"
        save(folder, 9)
        content = whole.read_bytes()
        whole.write_bytes(content[:3000])
        later(whole, 1.0)
        grow.rest = lambda: (whole.write_bytes(content), later(whole, 1.0))

    camera = camera_with(folder, grow, lambda: grow.rest())
    assert camera.take_frame(timeout_s=1.0).counts.shape == (24, 32)


def test_a_file_that_stays_damaged_is_an_error(folder):
    def damage():
        (folder / "bad.dng").write_bytes(b"II*\0junk")
        later(folder / "bad.dng", 1.0)

    with pytest.raises(ProtocolError, match=r"bad\.dng"):
        camera_with(folder, damage).take_frame(timeout_s=1.0)


def test_a_picture_larger_than_any_sensor_is_not_decoded(tmp_path):
    _, png = cv2.imencode(".png", np.full((4, 4), 9, np.uint16))
    bomb = bytearray(png.tobytes())
    bomb[16:24] = (60_000).to_bytes(4, "big") * 2
    (tmp_path / "bomb.png").write_bytes(bomb)
    with pytest.raises(ProtocolError, match="would take 7200 MB"):
        FolderCamera(tmp_path, bit_depth=12)


def test_another_exposure_than_was_wanted_is_refused(folder):
    camera = camera_with(folder, lambda: saved_later(folder, 1, exposure=(1, 50)))
    camera.configure(exposure_s=0.01, gain_db=0.0)
    with pytest.raises(LimitError, match=r"exposed 0\.02 s"):
        camera.take_frame(timeout_s=1.0)


def test_another_size_than_before_is_refused(folder):
    def small():
        assert cv2.imwrite(str(folder / "a.png"), np.full((5, 5), 7, np.uint16))
        later(folder / "a.png", 1.0)

    with pytest.raises(ProtocolError, match="5 x 5"):
        camera_with(folder, small, bit_depth=12).take_frame(timeout_s=1.0)


def test_an_empty_folder_does_not_tell_the_size(tmp_path):
    with pytest.raises(NotConnectedError, match="take one first"):
        open_folder(str(tmp_path))


def test_a_folder_that_is_not_there_is_said_so(tmp_path):
    with pytest.raises(NotConnectedError, match="no such folder"):
        open_folder(str(tmp_path / "nowhere"))


def png(path, counts):
    assert cv2.imwrite(str(path), counts)


TWELVE_BITS = np.random.default_rng(8).integers(0, 4096, (48, 64), dtype=np.uint16)


def test_left_justified_samples_are_shifted_down(tmp_path):
    png(tmp_path / "0.png", TWELVE_BITS << 4)

    def save_next():
        png(tmp_path / "1.png", TWELVE_BITS << 4)
        later(tmp_path / "1.png", 1.0)

    camera = camera_with(tmp_path, save_next, bit_depth=12, justified="left")
    frame = camera.take_frame(timeout_s=1.0)
    np.testing.assert_array_equal(frame.counts, TWELVE_BITS)
    assert (frame.settings.bit_depth, camera.facts().justified) == (12, "left")


def test_samples_at_the_other_end_than_stated_are_refused(tmp_path):
    png(tmp_path / "0.png", TWELVE_BITS << 4)
    with pytest.raises(ProtocolError, match="bit_depth=12&justified=left"):
        camera_with(tmp_path, bit_depth=16)
    png(tmp_path / "0.png", TWELVE_BITS)
    with pytest.raises(ProtocolError, match="not left-justified"):
        camera_with(tmp_path, bit_depth=12, justified="left")


def test_a_picture_of_few_values_may_be_of_even_ones(tmp_path):
    png(tmp_path / "0.png", TWELVE_BITS & 0xC)
    assert open_folder(f"{tmp_path}?bit_depth=12").facts().justified == "right"


def test_a_file_that_is_filled_after_it_has_its_length_is_waited_for(tmp_path):
    png(tmp_path / "0.png", TWELVE_BITS)
    path = tmp_path / "1.tif"

    def filled(rows):
        def write():
            partly = TWELVE_BITS.copy()
            partly[rows:] = 0
            # Not compressed: of one length however much is in it.
            assert cv2.imwrite(str(path), partly, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
            later(path, 1.0 + rows / 100.0)

        return write

    camera = camera_with(tmp_path, *map(filled, (10, 20, 30, 40, 48)), bit_depth=12)
    np.testing.assert_array_equal(camera.take_frame(timeout_s=1.0).counts, TWELVE_BITS)
