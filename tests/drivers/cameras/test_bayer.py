"""Planes of a mosaic, against samples picked one by one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cameras.samples import bit_depth_of, plane_size, take_plane
from drivers.errors import LimitError

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


def test_a_sum_over_an_odd_size_has_whole_cells_only():
    counts = np.ones((5, 7), dtype=np.uint16)
    total = take_plane(counts, cell="RGGB", plane="sum", saturation_dn=FULL, saturated_as_dn=2**14 - 1)
    assert total.shape[::-1] == plane_size(width=7, height=5, cell="RGGB", plane="sum") == (3, 2)


@pytest.mark.parametrize(("plane", "bits"), [("red", 12), ("green", 13), ("sum", 14)])
def test_a_sum_has_more_bits(plane, bits):
    assert bit_depth_of(plane, bit_depth=12) == bits


def test_a_sum_of_more_than_sixteen_bits_is_refused():
    with pytest.raises(LimitError, match="18"):
        bit_depth_of("sum", bit_depth=16)
