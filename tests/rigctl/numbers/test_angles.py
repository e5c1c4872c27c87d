"""Angles that come back to themselves."""

import numpy as np
import pytest

from rigctl.base.numbers import wrapped


@pytest.mark.parametrize(
    ("angle", "turn", "expected"),
    [(350.0, 360.0, -10.0), (-190.0, 360.0, 170.0), (180.0, 360.0, -180.0), (90.0, 180.0, -90.0), (179.0, 180.0, -1.0)],
)
def test_an_angle_is_brought_into_half_a_turn_about_zero(angle, turn, expected):
    assert wrapped(angle, turn=turn) == expected


def test_arrays_are_wrapped_element_by_element():
    np.testing.assert_array_equal(wrapped(np.array([350.0, 10.0]), turn=360.0), [-10.0, 10.0])
