"""Directions, azimuths and Stokes axes against plain cases that can be seen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import stokes as geometry
from model.stokes import aolp_rad, rotate_frame

azimuths = st.floats(-10.0, 10.0)
zeniths = st.floats(0.0, np.pi)


@pytest.mark.parametrize(
    ("zenith_deg", "azimuth_deg", "vector"),
    [(0, 123, [0, 0, 1]), (90, 0, [0, 1, 0]), (90, 90, [1, 0, 0]), (90, 180, [0, -1, 0]), (180, 0, [0, 0, -1])],
)
def test_directions(zenith_deg: float, azimuth_deg: float, vector: list) -> None:
    actual = geometry.direction(zenith_rad=np.deg2rad(zenith_deg), azimuth_rad=np.deg2rad(azimuth_deg))
    np.testing.assert_allclose(actual, vector, atol=1e-15)


@given(zenith=zeniths, azimuth=azimuths, turn=st.floats(1e-9, 3.0))
@settings(deadline=None, max_examples=50)
def test_angle_between_directions(zenith: float, azimuth: float, turn: float) -> None:
    first = geometry.direction(zenith_rad=zenith, azimuth_rad=azimuth)
    second = geometry.direction(zenith_rad=zenith + turn, azimuth_rad=azimuth)
    # Components round by 1e-16, and so does the angle, however small.
    assert geometry.angle_between_rad(first, second) == pytest.approx(turn, abs=1e-15)


def test_opposite_directions() -> None:
    up = np.array([0.0, 0.0, 1.0])
    assert geometry.angle_between_rad(up, -up) == np.pi
    assert geometry.angle_between_rad(up, up) == 0.0


@pytest.mark.parametrize("to_target", [True, False])
@given(zenith=st.floats(0.01, 3.1), azimuth=azimuths)
@settings(deadline=None, max_examples=30)
def test_horizontal_axis_is_up_cross_travel(to_target: bool, zenith: float, azimuth: float) -> None:
    point = geometry.direction(zenith_rad=zenith, azimuth_rad=azimuth)
    travel = -point if to_target else point
    across = np.cross([0.0, 0.0, 1.0], travel)
    axis = geometry.horizontal_axis(azimuth, travels_to_target=to_target)
    # The cross product's length is sin(zenith) > 0.01, so its direction holds 1e-14.
    np.testing.assert_allclose(axis, across / np.linalg.norm(across), atol=1e-13)


def test_a_camera_in_the_south_sees_east_on_its_right() -> None:
    np.testing.assert_allclose(geometry.horizontal_axis(np.pi, travels_to_target=False), [1, 0, 0], atol=1e-15)


def test_axis_rotation_is_counter_clockwise_as_seen() -> None:
    # Looking north (light travels south): right is east, up is up; from right to up is counter-clockwise.
    south = np.array([0.0, -1.0, 0.0])
    angle = geometry.axis_rotation_rad([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], travel=south)
    assert angle == pytest.approx(np.pi / 2)


@given(turn=st.floats(-3.1, 3.1), polarization=st.floats(0.0, 3.1))
@settings(deadline=None, max_examples=30)
def test_axis_rotation_is_what_stokes_rotation_takes(turn: float, polarization: float) -> None:
    travel, right = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    new = np.cos(turn) * right + np.sin(turn) * np.array([0.0, 0.0, 1.0])
    light = [1.0, np.cos(2 * polarization), np.sin(2 * polarization)]
    seen = rotate_frame(light, geometry.axis_rotation_rad(right, new, travel=travel))
    # The light stands at `polarization` from the old axis, hence at polarization - turn from the new one.
    assert np.sin(aolp_rad(seen) - (polarization - turn)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "call",
    [
        lambda bad: geometry.direction(zenith_rad=bad, azimuth_rad=0.0),
        lambda bad: geometry.horizontal_axis(bad, travels_to_target=True),
    ],
)
def test_angles_must_be_finite(call: object) -> None:
    with pytest.raises(ValueError, match="finite"):
        call([0.0, np.nan])
