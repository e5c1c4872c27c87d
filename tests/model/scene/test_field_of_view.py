import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import stokes as geometry
from model.scene.field import FieldPart, off_axis, part_of_picture, tiles, whole_field
from model.scene.panel import View

SQUARE = FieldPart(
    left_rad=-np.radians(7.5), right_rad=np.radians(7.5), bottom_rad=-np.radians(7.5), top_rad=np.radians(7.5)
)
AXIS = View(zenith_rad=np.radians(40.0), azimuth_rad=np.radians(30.0), height_m=3000.0)
angle = st.floats(-0.3, 0.3)


def toward(view):
    return geometry.direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)


def test_up_in_the_picture_is_farther_off():
    above = off_axis(AXIS, right=0.0, up=np.tan(np.radians(7.5)))
    assert np.degrees(above.zenith_rad) == pytest.approx(47.5)
    assert above.azimuth_rad == pytest.approx(AXIS.azimuth_rad)
    assert above.roll_rad == pytest.approx(0.0, abs=1e-12)


def test_right_in_the_picture_sees_the_camera_farther_to_the_left():
    # The camera stands in the north and looks south: right is west. From a point in the west the camera is in the east.
    north = View(zenith_rad=np.radians(40.0), azimuth_rad=0.0)
    right = off_axis(north, right=0.1, up=0.0)
    assert 0.0 < right.azimuth_rad < 0.3


@settings(deadline=None, max_examples=40)
@given(right=angle, up=angle, roll=st.floats(-3.0, 3.0))
def test_the_angle_from_the_axis_is_that_of_the_tangents(right, up, roll):
    axis = View(zenith_rad=0.6, azimuth_rad=2.0, roll_rad=roll)
    found = geometry.angle_between_rad(toward(axis), toward(off_axis(axis, right=right, up=up)))
    assert float(found) == pytest.approx(np.arctan(np.hypot(right, up)), abs=1e-12)


@settings(deadline=None, max_examples=40)
@given(right=angle, up=angle, roll=st.floats(-3.0, 3.0))
def test_the_frame_of_a_tile_is_the_cameras_own(right, up, roll):
    axis = View(zenith_rad=0.6, azimuth_rad=2.0, roll_rad=roll)
    tile = off_axis(axis, right=right, up=up)
    level = geometry.horizontal_axis(axis.azimuth_rad, travels_to_target=False)
    camera_right = np.cos(roll) * level + np.sin(roll) * np.cross(toward(axis), level)
    own = geometry.horizontal_axis(tile.azimuth_rad, travels_to_target=False)
    tile_right = np.cos(tile.roll_rad) * own + np.sin(tile.roll_rad) * np.cross(toward(tile), own)
    across = camera_right - (camera_right @ toward(tile)) * toward(tile)
    np.testing.assert_allclose(tile_right, across / np.linalg.norm(across), atol=1e-9)


def test_a_camera_straight_above_keeps_its_right():
    axis = View(zenith_rad=0.0, azimuth_rad=0.0)
    assert off_axis(axis, right=0.0, up=0.0).roll_rad == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("rule", ["gauss-legendre", "midpoint"])
def test_weights_sum_to_one(rule):
    found = tiles(SQUARE, AXIS, per_side=5, rule=rule)
    assert len(found) == 25
    assert sum(tile.weight for tile in found) == pytest.approx(1.0)
    assert all(tile.view.height_m == 3000.0 for tile in found)


def test_gauss_tiles_average_a_smooth_function_better_than_midpoints():
    def mean(per_side, rule):
        found = tiles(SQUARE, AXIS, per_side=per_side, rule=rule)
        return sum(tile.weight * np.exp(4.0 * tile.view.zenith_rad) for tile in found)

    exact = mean(24, "gauss-legendre")
    assert mean(5, "gauss-legendre") == pytest.approx(exact, rel=1e-9)
    # The midpoint rule errs as h^2 / 24 f''; here f'' = 16 f over a side of 0.26 rad, twice: 2e-3 at 5 tiles.
    assert 5e-4 < abs(mean(5, "midpoint") / exact - 1.0) < 4e-3


def test_a_field_above_the_horizon_is_refused():
    with pytest.raises(ValueError, match="above the horizon"):
        tiles(SQUARE, View(zenith_rad=np.radians(84.0), azimuth_rad=0.0), per_side=5)


def test_edges_in_the_wrong_order_are_refused():
    with pytest.raises(ValueError, match="left and right"):
        FieldPart(left_rad=0.1, right_rad=-0.1, bottom_rad=-0.1, top_rad=0.1)


@pytest.mark.parametrize(("per_side", "rule", "word"), [(0, "midpoint", "0 tiles"), (3, "simpson", "rule")])
def test_rules_that_do_not_exist_are_refused(per_side, rule, word):
    with pytest.raises(ValueError, match=word):
        tiles(SQUARE, AXIS, per_side=per_side, rule=rule)


def test_a_rectangle_of_the_picture_and_its_angles():
    part = part_of_picture(
        left_pixel=-0.5,
        right_pixel=49.5,
        top_pixel=-0.5,
        bottom_pixel=39.5,
        picture=(100, 80),
        pixel_pitch_m=1e-5,
        focal_length_m=1e-3,
    )
    # The top left quarter: half of 100 and of 80 pixels, a hundredth of the focal length each.
    assert np.tan([part.left_rad, part.right_rad]) == pytest.approx([-0.5, 0.0], abs=1e-12)
    assert np.tan([part.bottom_rad, part.top_rad]) == pytest.approx([0.0, 0.4], abs=1e-12)


def test_the_whole_field_is_even_about_the_axis():
    part = whole_field(width_rad=0.4, height_rad=0.2)
    assert (part.left_rad, part.right_rad, part.bottom_rad, part.top_rad) == (-0.2, 0.2, -0.1, 0.1)


def test_few_tiles_do_for_a_field_that_reaches_far_off_the_axis():
    overhead = View(zenith_rad=0.0, azimuth_rad=0.0, height_m=3000.0)
    wide = whole_field(width_rad=np.radians(169.0), height_rad=np.radians(60.0))

    def mean(per_side):
        found = tiles(wide, overhead, per_side=per_side)
        return sum(tile.weight * np.cos(tile.view.zenith_rad) for tile in found)

    assert mean(6) == pytest.approx(mean(40), rel=3e-3)
    assert sum(tile.weight for tile in tiles(wide, overhead, per_side=3)) == pytest.approx(1.0, rel=1e-14)
