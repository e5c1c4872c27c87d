"""Light over a field of view: tiles, mean and covariance over them, falloff, surroundings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import stokes as geometry
from model.accuracy.chain import evaluate
from model.effects.effect import ALL, Effect
from model.scene.field import (
    BACKSCATTER,
    FieldLight,
    FieldPart,
    cosine_fourth,
    forward_scattered,
    light_over_field,
    lights_over_tiles,
    off_axis,
    part_of_picture,
    tiles,
    whole_field,
)
from model.scene.panel import ApertureLight, Rules, View
from tests.model.effects.scenes import COARSE, panel_scene

AXIS = View(zenith_rad=np.radians(40.0), azimuth_rad=0.0, height_m=3000.0)
NO_TEXTURE, NOTHING = np.zeros((3, 3)), np.zeros(3)
angle = st.floats(-0.3, 0.3)


def field(half_deg):
    return whole_field(width_rad=np.radians(2.0 * half_deg), height_rad=np.radians(2.0 * half_deg))


def toward(view):
    return geometry.direction(zenith_rad=view.zenith_rad, azimuth_rad=view.azimuth_rad)


def test_up_in_the_picture_is_farther_off_and_right_sees_the_camera_farther_to_the_left():
    above = off_axis(AXIS, right=0.0, up=np.tan(np.radians(7.5)))
    assert np.degrees(above.zenith_rad) == pytest.approx(47.5)
    assert above.azimuth_rad == pytest.approx(AXIS.azimuth_rad)
    assert above.roll_rad == pytest.approx(0.0, abs=1e-12)
    # The camera stands in the north and looks south: right is west. From a point in the west the camera is in the east.
    assert 0.0 < off_axis(AXIS, right=0.1, up=0.0).azimuth_rad < 0.3
    overhead = View(zenith_rad=0.0, azimuth_rad=0.0)
    assert off_axis(overhead, right=0.0, up=0.0).roll_rad == pytest.approx(0.0, abs=1e-12)


@settings(deadline=None, max_examples=40)
@given(right=angle, up=angle, roll=st.floats(-3.0, 3.0))
def test_a_tile_stands_by_its_tangents_and_keeps_the_frame_of_the_camera(right, up, roll):
    axis = View(zenith_rad=0.6, azimuth_rad=2.0, roll_rad=roll)
    tile = off_axis(axis, right=right, up=up)
    apart = geometry.angle_between_rad(toward(axis), toward(tile))
    assert float(apart) == pytest.approx(np.arctan(np.hypot(right, up)), abs=1e-12)
    level = geometry.horizontal_axis(axis.azimuth_rad, travels_to_target=False)
    camera_right = np.cos(roll) * level + np.sin(roll) * np.cross(toward(axis), level)
    own = geometry.horizontal_axis(tile.azimuth_rad, travels_to_target=False)
    tile_right = np.cos(tile.roll_rad) * own + np.sin(tile.roll_rad) * np.cross(toward(tile), own)
    across = camera_right - (camera_right @ toward(tile)) * toward(tile)
    np.testing.assert_allclose(tile_right, across / np.linalg.norm(across), atol=1e-9)


@pytest.mark.parametrize("rule", ["gauss-legendre", "midpoint"])
def test_weights_sum_to_one(rule):
    found = tiles(field(7.5), AXIS, per_side=5, rule=rule)
    assert len(found) == 25
    assert sum(tile.weight for tile in found) == pytest.approx(1.0)
    assert all(tile.view.height_m == 3000.0 for tile in found)


def test_gauss_tiles_average_a_smooth_function_better_than_midpoints():
    def mean(per_side, rule):
        found = tiles(field(7.5), AXIS, per_side=per_side, rule=rule)
        return sum(tile.weight * np.exp(4.0 * tile.view.zenith_rad) for tile in found)

    exact = mean(24, "gauss-legendre")
    assert mean(5, "gauss-legendre") == pytest.approx(exact, rel=1e-9)
    # The midpoint rule errs as h^2 / 24 f''; here f'' = 16 f over a side of 0.26 rad, twice: 2e-3 at 5 tiles.
    assert 5e-4 < abs(mean(5, "midpoint") / exact - 1.0) < 4e-3


def test_few_tiles_do_for_a_field_that_reaches_far_off_the_axis():
    overhead = View(zenith_rad=0.0, azimuth_rad=0.0, height_m=3000.0)
    wide = whole_field(width_rad=np.radians(169.0), height_rad=np.radians(60.0))

    def mean(per_side):
        found = tiles(wide, overhead, per_side=per_side)
        return sum(tile.weight * np.cos(tile.view.zenith_rad) for tile in found)

    assert mean(6) == pytest.approx(mean(40), rel=3e-3)
    assert sum(tile.weight for tile in tiles(wide, overhead, per_side=3)) == pytest.approx(1.0, rel=1e-14)


def test_a_rectangle_of_the_picture_and_the_whole_field_by_their_angles():
    edges = {"left_pixel": -0.5, "right_pixel": 49.5, "top_pixel": -0.5, "bottom_pixel": 39.5}
    part = part_of_picture(**edges, picture=(100, 80), pixel_pitch_m=1e-5, focal_length_m=1e-3)
    # The top left quarter: half of 100 and of 80 pixels, a hundredth of the focal length each.
    found = np.tan([part.left_rad, part.right_rad, part.bottom_rad, part.top_rad])
    assert found == pytest.approx([-0.5, 0.0, 0.0, 0.4], abs=1e-12)
    whole = whole_field(width_rad=0.4, height_rad=0.2)
    assert (whole.left_rad, whole.right_rad, whole.bottom_rad, whole.top_rad) == (-0.2, 0.2, -0.1, 0.1)


def made(total, path=NOTHING):
    return ApertureLight(
        reflected_sun=np.asarray(total, dtype=float),
        reflected_sky=NOTHING,
        path=np.asarray(path, dtype=float),
        transmittance=0.9,
        error=0.1,
        rules=Rules(lobe=6, diffuse=6),
        finest=Rules(lobe=9, diffuse=9),
        view=AXIS,
    )


def slope_along_y(views, _rules):
    """Light that grows evenly with the tangent of the angle from the axis, up in the picture."""
    ups = [np.tan(view.zenith_rad - AXIS.zenith_rad) for view in views]
    return tuple(made([10.0 + 4.0 * up, 2.0 * up, 0.0]) for up in ups)


@pytest.mark.parametrize("rule", ["gauss-legendre", "midpoint"])
def test_mean_and_covariance_of_a_plane(rule):
    light = light_over_field(slope_along_y, view=AXIS, part=field(7.5), per_side=4, rule=rule)
    moments = light.moments(texture_cov=NO_TEXTURE)
    assert moments.mean[0] == pytest.approx(10.0, abs=0.05)
    width = 2.0 * np.tan(np.radians(7.5))
    # Variance of a plane over its width, of which four midpoints miss 1/16. Off the middle column the zenith angle is
    # larger by up to x^2 / (2 tan 40 deg) = 0.010, in the mean 0.0034: 0.014 in the mean, 2 % of the deviation.
    expected = 16.0 * width**2 / 12.0 * (1.0 - 1.0 / 16.0 if rule == "midpoint" else 1.0)
    assert moments.cov[0, 0] == pytest.approx(expected, rel=0.03)
    assert moments.cov[0, 1] == pytest.approx(0.5 * moments.cov[0, 0])


def test_a_narrow_field_is_one_tile_and_leaves_out_less_than_its_spread():
    narrow = light_over_field(slope_along_y, view=AXIS, part=field(0.05), per_side=4)
    assert len(narrow.lights) == 1
    assert 0.0 < narrow.spread < 1e-3
    np.testing.assert_array_equal(narrow.moments(texture_cov=NO_TEXTURE).cov, 0.0)
    tiled = light_over_field(slope_along_y, view=AXIS, part=field(0.05), per_side=4, negligible=0.0)
    assert abs(tiled.mean()[0] - narrow.mean()[0]) <= narrow.spread * narrow.mean()[0]
    assert np.sqrt(tiled.moments(texture_cov=NO_TEXTURE).cov[0, 0]) <= 1.01 * narrow.spread * narrow.mean()[0]


def recorded(requests):
    def lights_at(views, rules):
        requests.append((len(views), rules))
        return slope_along_y(views, rules)

    return lights_at


RULES = Rules(lobe=6, diffuse=6)


@pytest.mark.parametrize(
    ("part", "expected"),
    [(None, [(1, None)]), (field(7.5), [(1, None), (4, RULES), (4, RULES)])],
    ids=["point", "tiles"],
)
def test_a_point_is_seen_once_and_tiles_use_the_rules_of_the_centre(part, expected):
    requests = []
    found = light_over_field(recorded(requests), view=AXIS, part=part, per_side=2)
    assert requests == expected
    assert len(found.lights) == expected[-1][0]
    assert (found.spread == 0.0) == (part is None)


def test_all_tiles_use_the_rules_that_suffice_in_corners_and_middle_and_the_finest_tried_there_are_kept():
    requests = []
    several = lights_over_tiles(recorded(requests), fields=[(AXIS, field(7.5)), (AXIS, field(2.0))], per_side=3)
    assert requests == [(10, None), (18, RULES)]
    for found in several:
        assert sorted(found.finer) == [0, 2, 4, 6, 8]
        for tile, light in found.finer.items():
            np.testing.assert_array_equal(light.total, found.lights[tile].total)
            assert light.view == found.lights[tile].view


def test_texture_multiplies_what_is_reflected_and_not_the_path():
    light = FieldLight(lights=(made([10.0, 3.0, -1.0], path=[5.0, 1.0, 0.0]),), weights=(1.0,), spread=0.0)
    moments = light.moments(texture_rms=0.1, texture_cov=NO_TEXTURE)
    np.testing.assert_allclose(moments.mean, [15.0, 4.0, -1.0])
    reflected = np.array([10.0, 3.0, -1.0])
    np.testing.assert_allclose(moments.cov, 0.01 * np.outer(reflected, reflected))
    assert not np.any(light.moments("path", texture_rms=0.1, texture_cov=NO_TEXTURE).cov)
    # Independent deviations are shares of the reflected S0.
    moments = light.moments(texture_diagonal=(0.1, 0.2, 0.3), texture_cov=NO_TEXTURE)
    np.testing.assert_allclose(moments.cov, np.diag([1.0, 4.0, 9.0]))


def test_moments_errors_and_transmittances_are_those_of_all_tiles():
    light = FieldLight(lights=(made([10, 0, 0]), made([20, 0, 0])), weights=(0.5, 0.5), spread=0.5)
    moments = light.moments(texture_rms=0.1, texture_cov=np.diag([0.0, 1.0, 1.0]))
    # Variance of the two means 25, and 0.01 of the mean square 250.
    assert moments.cov[0, 0] == pytest.approx(25.0 + 2.5)
    assert moments.cov[1, 1] == 1.0
    assert light.error == pytest.approx(0.1)
    assert light.transmittance == pytest.approx(0.9)


def test_falloff_has_the_moments_of_draws_over_the_picture():
    part = FieldPart(left_rad=-0.1, right_rad=0.4, bottom_rad=0.05, top_rad=0.3)
    draws = np.random.default_rng(2)
    x = draws.uniform(np.tan(-0.1), np.tan(0.4), 400_000)
    y = draws.uniform(np.tan(0.05), np.tan(0.3), 400_000)
    share = np.cos(np.arctan(np.hypot(x, y))) ** 4
    found = cosine_fourth(part)
    # Five standard errors of a mean; of a variance with a kurtosis below 3.
    assert abs(share.mean() - found.mean) < 5.0 * share.std() / np.sqrt(x.size)
    assert abs(share.var() - found.var) < 5.0 * share.var() * np.sqrt(2.0 / x.size)


@pytest.mark.parametrize("width", [2e-3, 0.3, 1.0])
def test_mean_falloff_is_above_the_limit_that_the_farthest_corner_sets(width):
    found = cosine_fourth(whole_field(width_rad=width, height_rad=width)).mean
    # 1 - 2 t with t = x^2 + y^2: over a narrow square of half side a the mean of t is 2 a^2 / 3, in its corner 2 a^2.
    corner = 2.0 * np.tan(width / 2.0) ** 2
    assert found >= 1.0 - 2.0 * corner
    if width < 0.01:
        assert 1.0 - found == pytest.approx(2.0 / 3.0 * corner, rel=1e-5)


@pytest.mark.parametrize("transmittance", [0.0, 1e-6, 0.3, 0.9, 1.0 - 1e-7, 1.0])
def test_forward_scattered_light_is_less_than_what_the_air_takes_and_its_share_of_the_depth(transmittance):
    found = forward_scattered(transmittance)
    assert 0.0 <= found <= 1.0 - transmittance
    with np.errstate(divide="ignore"):
        limit = -(1.0 - BACKSCATTER) * np.log(transmittance)
    assert found <= limit
    if 1.0 - 1e-6 < transmittance < 1.0:
        assert found == pytest.approx(limit, rel=1e-6)


def light_of_panel(albedo, effects=ALL, **changes):
    return evaluate(panel_scene(surround_albedo=albedo, **changes), COARSE, effects=effects).lights["panel"].mean()


def test_bright_surroundings_add_unpolarised_light_and_dark_ones_take_some_away():
    like, bright, dark, without = (light_of_panel(albedo) for albedo in (0.1, 0.9, 0.0, None))
    np.testing.assert_array_equal(like, without)
    assert bright[0] > like[0] > dark[0]
    np.testing.assert_array_equal(bright[1:], like[1:])
    np.testing.assert_array_equal(light_of_panel(0.9, ALL - {Effect.ADJACENCY}), without)


def test_a_camera_on_the_ground_sees_no_surroundings():
    np.testing.assert_array_equal(*(light_of_panel(albedo, height_m=0.0) for albedo in (None, 0.9)))


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: tiles(field(7.5), replace(AXIS, zenith_rad=np.radians(84.0)), per_side=5), "above the horizon"),
        (lambda: tiles(field(7.5), AXIS, per_side=0), "0 tiles"),
        (lambda: tiles(field(7.5), AXIS, per_side=3, rule="simpson"), "rule"),
        (lambda: FieldPart(left_rad=0.1, right_rad=-0.1, bottom_rad=-0.1, top_rad=0.1), "left and right"),
        (lambda: FieldLight(lights=(made([1, 0, 0]),), weights=(1.0,), spread=0.0).mean("moon"), "source = 'moon'"),
    ],
)
def test_impossible_fields_rules_and_sources_are_refused(make, word):
    with pytest.raises(ValueError, match=word):
        make()
