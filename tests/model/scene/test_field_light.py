import numpy as np
import pytest

from model.scene.field import FieldLight, FieldPart, light_over_field, lights_over_tiles
from model.scene.panel import ApertureLight, Rules, View

AXIS = View(zenith_rad=np.radians(40.0), azimuth_rad=0.0)
NO_TEXTURE = np.zeros((3, 3))
NOTHING = np.zeros(3)


def field(half_deg):
    half = np.radians(half_deg)
    return FieldPart(left_rad=-half, right_rad=half, bottom_rad=-half, top_rad=half)


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
    view_of = light_over_field(slope_along_y, view=AXIS, part=field(7.5), per_side=4, rule=rule)
    moments = view_of.moments(texture_cov=NO_TEXTURE)
    assert moments.mean[0] == pytest.approx(10.0, abs=0.05)
    width = 2.0 * np.tan(np.radians(7.5))
    # Variance of a plane over its width, of which four midpoints miss 1/16. Off the middle column the zenith angle is
    # larger by up to x^2 / (2 tan 40 deg) = 0.010, in the mean 0.0034: 0.014 in the mean, 2 % of the deviation.
    expected = 16.0 * width**2 / 12.0 * (1.0 - 1.0 / 16.0 if rule == "midpoint" else 1.0)
    assert moments.cov[0, 0] == pytest.approx(expected, rel=0.03)
    assert moments.cov[0, 1] == pytest.approx(0.5 * moments.cov[0, 0])


def test_a_narrow_field_is_one_tile():
    found = light_over_field(slope_along_y, view=AXIS, part=field(0.05), per_side=4)
    assert len(found.lights) == 1
    assert 0.0 < found.spread < 1e-3
    np.testing.assert_array_equal(found.moments(texture_cov=NO_TEXTURE).cov, 0.0)


def test_what_a_narrow_field_leaves_out_is_less_than_its_spread():
    narrow = light_over_field(slope_along_y, view=AXIS, part=field(0.05), per_side=4)
    taken = light_over_field(slope_along_y, view=AXIS, part=field(0.05), per_side=4, negligible=0.0)
    assert abs(taken.mean()[0] - narrow.mean()[0]) <= narrow.spread * narrow.mean()[0]
    assert np.sqrt(taken.moments(texture_cov=NO_TEXTURE).cov[0, 0]) <= 1.01 * narrow.spread * narrow.mean()[0]


def recorded(asked):
    def lights_at(views, rules):
        asked.append((len(views), rules))
        return slope_along_y(views, rules)

    return lights_at


def test_a_point_is_seen_once():
    asked = []
    found = light_over_field(recorded(asked), view=AXIS, part=None, per_side=5)
    assert asked == [(1, None)]
    assert found.spread == 0.0


def test_tiles_use_the_rules_of_the_centre():
    asked = []
    found = light_over_field(recorded(asked), view=AXIS, part=field(7.5), per_side=2)
    rules = Rules(lobe=6, diffuse=6)
    assert asked == [(1, None), (4, rules), (4, rules)]
    assert len(found.lights) == 4


def test_all_tiles_use_the_rules_that_suffice_in_corners_and_middle_and_the_finest_tried_there_are_kept():
    asked = []
    several = lights_over_tiles(recorded(asked), fields=[(AXIS, field(7.5)), (AXIS, field(2.0))], per_side=3)
    assert asked == [(10, None), (18, Rules(lobe=6, diffuse=6))]
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


def test_texture_over_a_field_follows_the_light_of_each_tile():
    light = FieldLight(lights=(made([10, 0, 0]), made([20, 0, 0])), weights=(0.5, 0.5), spread=0.5)
    extra = np.diag([0.0, 1.0, 1.0])
    moments = light.moments(texture_rms=0.1, texture_cov=extra)
    # Variance of the two means 25, and 0.01 of the mean square 250.
    assert moments.cov[0, 0] == pytest.approx(25.0 + 2.5)
    assert moments.cov[1, 1] == 1.0


def test_errors_and_transmittances_are_means():
    light = FieldLight(lights=(made([10, 0, 0]), made([20, 0, 0])), weights=(0.3, 0.7), spread=0.5)
    assert light.error == pytest.approx(0.1)
    assert light.transmittance == pytest.approx(0.9)


def test_an_unknown_source_is_refused():
    light = FieldLight(lights=(made([10, 0, 0]),), weights=(1.0,), spread=0.0)
    with pytest.raises(ValueError, match="source = 'moon'"):
        light.mean("moon")


def test_independent_texture_is_a_share_of_the_reflected_s0():
    light = FieldLight(lights=(made([10.0, 3.0, -1.0], path=[5.0, 1.0, 0.0]),), weights=(1.0,), spread=0.0)
    moments = light.moments(texture_diagonal=(0.1, 0.2, 0.3), texture_cov=NO_TEXTURE)
    np.testing.assert_allclose(moments.cov, np.diag([1.0, 4.0, 9.0]))
