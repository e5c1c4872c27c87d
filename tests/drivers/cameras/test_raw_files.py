"""RAW files, against DNG files written here number by number."""

import numpy as np
import pytest

from drivers.cameras.raw_files import read_raw
from drivers.errors import LimitError, ProtocolError
from tests.drivers.cameras.dng import write_dng

COUNTS = np.random.default_rng(4).integers(200, 4096, (120, 160), dtype=np.uint16)


@pytest.fixture
def mosaic(tmp_path):
    path = tmp_path / "mosaic.dng"
    write_dng(path, COUNTS, black=(256, 257, 258, 259))
    return path


@pytest.mark.parametrize(
    ("plane", "row", "column", "black_level_dn"),
    [("red", 0, 0, 256.0), ("green-1", 0, 1, 257.0), ("green-2", 1, 0, 258.0), ("blue", 1, 1, 259.0)],
)
def test_a_colour_has_its_own_pixels_and_black_level(mosaic, plane, row, column, black_level_dn):
    picture = read_raw(mosaic, plane=plane)
    np.testing.assert_array_equal(picture.counts, COUNTS[row::2, column::2])
    assert picture.black_level_dn == black_level_dn


def test_all_colours_are_brought_to_one_black_level(mosaic):
    picture = read_raw(mosaic, plane="all")
    assert picture.black_level_dn == 259.0
    lifts = np.tile([[3, 2], [1, 0]], (60, 80))
    np.testing.assert_array_equal(picture.counts, np.minimum(COUNTS + lifts, 4095))


def test_saturated_samples_stay_saturated_where_black_levels_are_levelled(tmp_path):
    full = np.full((120, 160), 4095, dtype=np.uint16)
    write_dng(tmp_path / "a.dng", full, black=(256, 257, 258, 259))
    np.testing.assert_array_equal(read_raw(tmp_path / "a.dng", plane="all").counts, full)


@pytest.mark.parametrize(
    ("plane", "places", "black_level_dn"),
    [("green", [(0, 1), (1, 0)], 257.0 + 258.0), ("sum", [(0, 0), (0, 1), (1, 0), (1, 1)], 256.0 + 257 + 258 + 259)],
)
def test_colours_are_summed_with_their_black_and_white_levels(mosaic, plane, places, black_level_dn):
    picture = read_raw(mosaic, plane=plane)
    parts = np.array([COUNTS[row::2, column::2] for row, column in places], dtype=np.int64)
    expected = np.where((parts >= 4095).any(axis=0), len(places) * 4095, parts.sum(axis=0))
    np.testing.assert_array_equal(picture.counts, expected)
    assert picture.black_level_dn == black_level_dn
    assert picture.white_level_dn == len(places) * 4095


def test_the_whole_mosaic_comes_as_it_is(tmp_path):
    write_dng(tmp_path / "a.dng", COUNTS)
    np.testing.assert_array_equal(read_raw(tmp_path / "a.dng", plane="all").counts, COUNTS)


def test_a_camera_without_colours_needs_no_plane(tmp_path):
    write_dng(tmp_path / "a.dng", COUNTS, mosaic=False, black=(100,))
    picture = read_raw(tmp_path / "a.dng", plane=None)
    np.testing.assert_array_equal(picture.counts, COUNTS)
    assert picture.black_level_dn == 100.0


def test_a_mosaic_is_not_taken_for_grey(mosaic):
    with pytest.raises(LimitError, match="choose a plane"):
        read_raw(mosaic, plane=None)


def test_exposure_and_gain_are_told(mosaic):
    picture = read_raw(mosaic, plane="red")
    # LibRaw keeps exposures in single precision: 24 bits, 6e-8.
    assert picture.exposure_s == pytest.approx(1 / 125, rel=1e-7)
    assert picture.iso == 100.0
    assert (picture.white_level_dn, picture.bit_depth) == (4095, 12)


def test_an_exposure_that_is_not_told_is_none(tmp_path):
    write_dng(tmp_path / "a.dng", COUNTS, exposure=None)
    assert read_raw(tmp_path / "a.dng", plane="red").exposure_s is None


@pytest.mark.parametrize("content", [b"", b"II*\0junk", "cut"])
def test_a_damaged_file_is_refused(tmp_path, mosaic, content):
    path = tmp_path / "bad.dng"
    path.write_bytes(mosaic.read_bytes()[:3000] if content == "cut" else content)
    with pytest.raises(ProtocolError, match=r"bad\.dng"):
        read_raw(path, plane="red")


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(ProtocolError, match="no such file"):
        read_raw(tmp_path / "a.dng", plane="red")
