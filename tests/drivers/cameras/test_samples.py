"""Samples out of bytes, against packers that go by the words of the standards, one bit at a time; planes."""

import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cameras.samples import (
    GENICAM,
    V4L2,
    bit_depth_of,
    needed_bytes,
    plane_size,
    polarized_format,
    take_plane,
    unpack,
)
from drivers.errors import LimitError, ProtocolError
from tests.clients.make_venvs import default_folder, make, python_of
from tests.drivers.cameras.bit_packers import as_csi_packed, as_gvsp_packed, as_stream_of_bits

BY_NAME = {fmt.name: fmt for fmt in (*GENICAM.values(), *V4L2.values())}


PACKERS = {
    "Mono10p": as_stream_of_bits,
    "Mono12p": as_stream_of_bits,
    "Mono14p": as_stream_of_bits,
    "Mono10Packed": as_gvsp_packed,
    "Mono12Packed": as_gvsp_packed,
    "PolarizeMono12p": as_stream_of_bits,
    "PolarizeMono12Packed": as_gvsp_packed,
    "Y10P": as_csi_packed,
    "Y12P": as_csi_packed,
    "Y14P": as_csi_packed,
    **{f"Bayer{cell}{bits}p": as_stream_of_bits for cell in ("BG", "GB", "GR", "RG") for bits in (10, 12, 14)},
    **{f"Bayer{cell}{bits}Packed": as_gvsp_packed for cell in ("BG", "GB", "GR", "RG") for bits in (10, 12)},
    **{f"p{cell}{bits}": as_csi_packed for cell in ("B", "G", "g", "R") for bits in ("AA", "CC", "EE")},
}


UNPACKED = sorted(set(BY_NAME) - set(PACKERS))


def packed(name, samples):
    fmt = BY_NAME[name]
    if name in PACKERS:
        return PACKERS[name](samples, fmt.bit_depth)
    end = "big" if name.endswith("_BE") else "little"
    return b"".join(int(sample).to_bytes(fmt.sample_bytes, end) for sample in samples)


@st.composite
def pictures(draw):
    name = draw(st.sampled_from(sorted(BY_NAME)))
    height, width = draw(st.integers(1, 5)), draw(st.integers(1, 9))
    top = 2 ** BY_NAME[name].bit_depth - 1
    samples = draw(st.lists(st.integers(0, top), min_size=height * width, max_size=height * width))
    return name, np.array(samples, dtype=np.uint16).reshape(height, width)


@given(pictures(), st.binary(max_size=9))
@settings(deadline=None, max_examples=300)
def test_what_was_packed_comes_back(picture, behind):
    name, counts = picture
    height, width = counts.shape
    unpacked = unpack(packed(name, counts.ravel()) + behind, pixel_format=BY_NAME[name], width=width, height=height)
    assert unpacked.dtype == np.uint16
    np.testing.assert_array_equal(unpacked, counts)


@given(pictures(), st.integers(0, 7))
@settings(deadline=None, max_examples=200)
def test_rows_with_padding_come_back(picture, padding):
    name, counts = picture
    rows = [packed(name, row) for row in counts]
    data = b"".join(row + b"\xa5" * padding for row in rows)
    height, width = counts.shape
    unpacked = unpack(data, pixel_format=BY_NAME[name], width=width, height=height, row_bytes=len(rows[0]) + padding)
    np.testing.assert_array_equal(unpacked, counts)


@given(pictures())
@settings(deadline=None, max_examples=200)
def test_one_byte_less_is_refused(picture):
    name, counts = picture
    height, width = counts.shape
    needed = needed_bytes(BY_NAME[name], samples=counts.size)
    data = packed(name, counts.ravel())[: needed - 1]
    with pytest.raises(ProtocolError, match="truncated"):
        unpack(data, pixel_format=BY_NAME[name], width=width, height=height)


@pytest.mark.parametrize(
    ("name", "data", "counts"),
    [
        # Worked by hand from 0xABC and 0x123.
        ("Mono12Packed", bytes([0xAB, 0x3C, 0x12]), [0xABC, 0x123]),
        ("Mono12p", bytes([0xBC, 0x3A, 0x12]), [0xABC, 0x123]),
        ("Y12P", bytes([0xAB, 0x12, 0x3C]), [0xABC, 0x123]),
        # 0x2A5 = 10 1010 0101 and 0x13C = 01 0011 1100.
        ("Mono10Packed", bytes([0xA9, 0x01, 0x4F]), [0x2A5, 0x13C]),
        ("BayerRG10Packed", bytes([0xA9, 0x01, 0x4F]), [0x2A5, 0x13C]),
        ("Y16_BE", bytes([0xAB, 0xCD, 0x01, 0x23]), [0xABCD, 0x0123]),
        # 0x2BCD = 10 1011 1100 1101 and 0x1234 = 01 0010 0011 0100, in a stream of bits from the lowest on.
        ("Mono14p", bytes([0xCD, 0x2B, 0x8D, 0x04]), [0x2BCD, 0x1234]),
        # High parts 0xAF and 0x48, then 00 1101 and 11 0100 from the lowest bit on.
        ("Y14P", bytes([0xAF, 0x48, 0x00, 0x00, 0x0D, 0x0D, 0x00]), [0x2BCD, 0x1234]),
    ],
)
def test_bits_stand_where_the_standards_have_them(name, data, counts):
    np.testing.assert_array_equal(unpack(data, pixel_format=BY_NAME[name], width=2, height=1), [counts])


@pytest.mark.parametrize(
    ("name", "grey"), [("PolarizeMono12p", "Mono12p"), ("Polarized8", "Mono8"), ("PolarizedMono16", "Mono16")]
)
def test_samples_behind_polarizers_stand_as_grey_ones(name, grey):
    found = polarized_format(name)
    assert found == replace(BY_NAME[grey], name=name, is_polarized=True)


@pytest.mark.parametrize(
    "name", ["PolarizedDolp_Mono8", "PolarizedAngles_0d_45d_90d_135d_Mono8", "Mono8", "Polarized9"]
)
def test_computed_pictures_and_grey_ones_are_not_behind_polarizers(name):
    assert polarized_format(name) is None


def test_wrong_byte_order_is_found_by_the_bits_that_should_be_empty():
    with pytest.raises(ProtocolError, match="byte_order"):
        unpack(b"\x0a\xbc\x01\x23", pixel_format=BY_NAME["Mono12"], width=2, height=1)


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("justified", ["right", "left"])
@pytest.mark.parametrize("bits", [9, 10, 12, 14, 16])
def test_mono16_has_as_many_valid_bits_as_are_stated(bits, justified, order):
    counts = [0, 1, 2**bits - 1, 0x155 & (2**bits - 1), 2 ** (bits - 1)]
    shift = 16 - bits if justified == "left" else 0
    data = b"".join((count << shift).to_bytes(2, order) for count in counts)
    fmt = replace(BY_NAME["Mono16"], bit_depth=bits, justified=justified, byte_order=order)
    np.testing.assert_array_equal(unpack(data, pixel_format=fmt, width=5, height=1), [counts])


def test_right_justified_samples_are_not_taken_for_left_justified_ones():
    fmt = replace(BY_NAME["Mono16"], bit_depth=12, justified="left")
    with pytest.raises(ProtocolError, match="left-justified"):
        unpack(b"\xbc\x0a", pixel_format=fmt, width=1, height=1)


@pytest.mark.parametrize("name", sorted(BY_NAME))
def test_the_counts_are_no_window_onto_the_buffer(name):
    data = bytearray(packed(name, [1, 2, 3, 4]))
    counts = unpack(memoryview(data), pixel_format=BY_NAME[name], width=4, height=1)
    data[:] = b"\xff" * len(data)
    np.testing.assert_array_equal(counts, [[1, 2, 3, 4]])


CELLS = ("RGGB", "BGGR", "GRBG", "GBRG")


FULL = 4095


def picked(counts, cell, wanted):
    """The samples of a colour, one by one; green-1 is the green beside red."""
    red_row = cell.index("R") // 2
    letter = {"red": "R", "blue": "B"}.get(wanted, "G")
    row_of = {"green-1": red_row, "green-2": 1 - red_row}.get(wanted)
    found = [
        [int(counts[y, x]) for x in range(counts.shape[1]) if cell[2 * (y % 2) + x % 2] == letter]
        for y in range(counts.shape[0])
        if row_of is None or y % 2 == row_of
    ]
    return np.array([row for row in found if row])


@settings(deadline=None, max_examples=50)
@given(
    st.sampled_from(CELLS), st.sampled_from(["red", "green-1", "green-2", "blue"]), st.integers(2, 7), st.integers(2, 7)
)
def test_a_colour_has_its_own_samples_whatever_the_size(cell, plane, height, width):
    counts = np.arange(height * width, dtype=np.uint16).reshape(height, width)
    taken = take_plane(counts, cell=cell, plane=plane, saturation_dn=FULL, saturated_as_dn=FULL)
    np.testing.assert_array_equal(taken, picked(counts, cell, plane))
    assert taken.shape[::-1] == plane_size(width=width, height=height, cell=cell, plane=plane)


@pytest.mark.parametrize("cell", CELLS)
def test_the_sum_is_of_all_four_and_the_green_one_of_two(cell):
    counts = np.random.default_rng(1).integers(0, FULL, (6, 8), dtype=np.uint16)
    parts = {name: picked(counts, cell, name) for name in ("red", "green-1", "green-2", "blue")}
    total = take_plane(counts, cell=cell, plane="sum", saturation_dn=FULL, saturated_as_dn=4 * FULL + 3)
    np.testing.assert_array_equal(total, sum(parts.values()))
    green = take_plane(counts, cell=cell, plane="green", saturation_dn=FULL, saturated_as_dn=2 * FULL + 1)
    np.testing.assert_array_equal(green, parts["green-1"] + parts["green-2"])


def test_one_saturated_sample_saturates_its_sum_and_no_other():
    counts = np.zeros((4, 4), dtype=np.uint16)
    counts[0, 3] = FULL
    total = take_plane(counts, cell="RGGB", plane="sum", saturation_dn=FULL, saturated_as_dn=2**14 - 1)
    np.testing.assert_array_equal(total, [[0, 2**14 - 1], [0, 0]])


def test_a_sum_of_more_than_sixteen_bits_is_refused():
    with pytest.raises(LimitError, match="18"):
        bit_depth_of("sum", bit_depth=16)


VMBPY = "vmbpy==1.2.3"
WIDTH, HEIGHT = 782, 582
PLAIN = {10: 0x01100003, 12: 0x01100005}
CODES = (0x010C0006, 0x010C0047, 0x010A0046)  # Mono12Packed, Mono12p, Mono10p


def unpacked_by_vimba(python, data, code):
    script = Path(__file__).with_name("vimba_unpack.py")
    arguments = [hex(code), hex(PLAIN[GENICAM[code].bit_depth]), str(WIDTH), str(HEIGHT)]
    done = subprocess.run([python, script, *arguments], input=data, stdout=subprocess.PIPE, check=True)
    return np.frombuffer(done.stdout, "<u2")


def test_random_bytes_become_the_counts_that_a_makers_converter_finds():
    # One test for all formats: tests that run at the same time must not both make the environment.
    if os.environ.get("RIGCTL_CLIENTS") != "1":
        pytest.skip(f"set RIGCTL_CLIENTS=1, which lets this test install {VMBPY} into an environment of its own")
    make(VMBPY, default_folder())
    python = python_of(VMBPY, default_folder())
    for code in CODES:
        data = np.random.default_rng(5).bytes(needed_bytes(GENICAM[code], samples=WIDTH * HEIGHT))
        ours = unpack(data, pixel_format=GENICAM[code], width=WIDTH, height=HEIGHT)
        np.testing.assert_array_equal(ours.ravel(), unpacked_by_vimba(python, data, code), GENICAM[code].name)
