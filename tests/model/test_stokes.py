"""Stokes parameters, directions and axes against plain cases that can be seen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import stokes as geometry
from model.stokes import analyzer_row, aolp_rad, dolp, rotate_frame

azimuths = st.floats(-10.0, 10.0)
zeniths = st.floats(0.0, np.pi)


def from_dolp(*, intensity, dolp_value, aolp_rad_value):
    along = [np.cos(2.0 * aolp_rad_value), np.sin(2.0 * aolp_rad_value)]
    return intensity * np.array([1.0, *np.multiply(dolp_value, along)])


@pytest.mark.parametrize(
    ("stokes", "angle_deg"),
    [((1, 1, 0), 0.0), ((1, 0, 1), 45.0), ((1, -1, 0), 90.0), ((1, 0, -1), 135.0), ((1, 1, -1e-300), 0.0)],
)
def test_angle_counts_from_horizontal_to_plus_45(stokes, angle_deg):
    np.testing.assert_allclose(aolp_rad(np.array(stokes, dtype=float)), np.deg2rad(angle_deg), atol=1e-15)


def test_angle_is_below_pi_for_a_tiny_negative_direction():
    assert aolp_rad([1.0, 1.0, -1e-17]) < np.pi


def test_dolp_above_one_is_kept():
    assert dolp([1.0, 3.0, 4.0]) == 5.0


@pytest.mark.parametrize(
    ("angle_deg", "row"),
    [(0, (0.5, 0.5, 0)), (45, (0.5, 0, 0.5)), (90, (0.5, -0.5, 0)), (135, (0.5, 0, -0.5)), (180, (0.5, 0.5, 0))],
)
def test_ideal_analyzer(angle_deg, row):
    np.testing.assert_allclose(analyzer_row(np.deg2rad(angle_deg)), row, atol=1e-15)


def test_real_analyzer_passes_its_transmittances():
    row = analyzer_row(0.3, 0.8, 0.1)
    along = from_dolp(intensity=1.0, dolp_value=1.0, aolp_rad_value=0.3)
    across = from_dolp(intensity=1.0, dolp_value=1.0, aolp_rad_value=0.3 + np.pi / 2)
    np.testing.assert_allclose([row @ along, row @ across], [0.8, 0.1], rtol=1e-14)


@settings(deadline=None)
@given(angle=st.floats(0.0, 3.1), turn=st.floats(-3.0, 3.0), degree=st.floats(0.01, 1.0))
def test_turned_axes_lower_the_angle_and_keep_the_degree(angle, turn, degree):
    turned = rotate_frame(from_dolp(intensity=2.0, dolp_value=degree, aolp_rad_value=angle), turn)
    np.testing.assert_allclose(dolp(turned), degree, rtol=1e-13)
    difference = aolp_rad(turned) - (angle - turn)
    np.testing.assert_allclose(np.sin(difference), 0.0, atol=1e-13)


@pytest.mark.parametrize(
    ("zenith_deg", "azimuth_deg", "vector"),
    [(0, 123, [0, 0, 1]), (90, 0, [0, 1, 0]), (90, 90, [1, 0, 0]), (90, 180, [0, -1, 0]), (180, 0, [0, 0, -1])],
)
def test_directions(zenith_deg, azimuth_deg, vector):
    actual = geometry.direction(zenith_rad=np.deg2rad(zenith_deg), azimuth_rad=np.deg2rad(azimuth_deg))
    np.testing.assert_allclose(actual, vector, atol=1e-15)


@given(zenith=zeniths, azimuth=azimuths, turn=st.floats(1e-9, 3.0))
@settings(deadline=None, max_examples=50)
def test_angle_between_directions(zenith, azimuth, turn):
    first = geometry.direction(zenith_rad=zenith, azimuth_rad=azimuth)
    second = geometry.direction(zenith_rad=zenith + turn, azimuth_rad=azimuth)
    # Components round by 1e-16, and so does the angle, however small.
    assert geometry.angle_between_rad(first, second) == pytest.approx(turn, abs=1e-15)


def test_opposite_directions():
    up = np.array([0.0, 0.0, 1.0])
    assert geometry.angle_between_rad(up, -up) == np.pi
    assert geometry.angle_between_rad(up, up) == 0.0


@pytest.mark.parametrize("to_target", [True, False])
@given(zenith=st.floats(0.01, 3.1), azimuth=azimuths)
@settings(deadline=None, max_examples=30)
def test_horizontal_axis_is_up_cross_travel(to_target, zenith, azimuth):
    point = geometry.direction(zenith_rad=zenith, azimuth_rad=azimuth)
    travel = -point if to_target else point
    across = np.cross([0.0, 0.0, 1.0], travel)
    axis = geometry.horizontal_axis(azimuth, travels_to_target=to_target)
    # The cross product's length is sin(zenith) > 0.01, so its direction holds 1e-14.
    np.testing.assert_allclose(axis, across / np.linalg.norm(across), atol=1e-13)


def test_a_camera_in_the_south_sees_east_on_its_right():
    np.testing.assert_allclose(geometry.horizontal_axis(np.pi, travels_to_target=False), [1, 0, 0], atol=1e-15)


def test_axis_rotation_is_counter_clockwise_as_seen():
    # Looking north (light travels south): right is east, up is up; from right to up is counter-clockwise.
    south = np.array([0.0, -1.0, 0.0])
    angle = geometry.axis_rotation_rad([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], travel=south)
    assert angle == pytest.approx(np.pi / 2)


@given(turn=st.floats(-3.1, 3.1), polarization=st.floats(0.0, 3.1))
@settings(deadline=None, max_examples=30)
def test_axis_rotation_is_what_stokes_rotation_takes(turn, polarization):
    travel, right = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    new = np.cos(turn) * right + np.sin(turn) * np.array([0.0, 0.0, 1.0])
    light = [1.0, np.cos(2 * polarization), np.sin(2 * polarization)]
    seen = rotate_frame(light, geometry.axis_rotation_rad(right, new, travel=travel))
    # The light stands at `polarization` from the old axis, hence at polarization - turn from the new one.
    assert np.sin(aolp_rad(seen) - (polarization - turn)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: dolp([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), "not positive in 1 of 2"),
        (lambda: dolp([1.0, 0.0]), "allowed is"),
        *((lambda taus=taus: analyzer_row(0.0, *taus), "tau_perp") for taus in ((0.5, 0.6), (1.1, 0.0), (0.5, -0.1))),
        (lambda: analyzer_row(0.0, np.nan, 0.0), "tau_perpendicular"),
        (lambda: geometry.direction(zenith_rad=[0.0, np.nan], azimuth_rad=0.0), "finite"),
        (lambda: geometry.horizontal_axis([0.0, np.nan], travels_to_target=True), "finite"),
    ],
)
def test_what_has_no_meaning_is_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()
