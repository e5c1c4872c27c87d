from dataclasses import replace

import numpy as np
import pytest

from model.scene.panel import Rules, View, aperture_lights
from model.scene.sky_light import illuminate
from model.stokes import aolp_rad, dolp, rotate_frame
from model.surface.facets import mueller_elements
from model.surface.pbrdf import Surface, Tilt, mueller
from tests.model.made_lighting import MadeLighting, even_sky

PAINT = Surface(n=1.5, slope_rms=0.15, dhr=0.05)
LEVEL = Tilt(tilt_rad=0.0)


def illumination(*, zenith_deg=50.0, azimuth_deg=200.0, albedo=0.1, **more):
    return illuminate(
        MadeLighting(),
        sun_zenith_rad=np.radians(zenith_deg),
        sun_azimuth_rad=np.radians(azimuth_deg),
        ground_albedo=albedo,
        **more,
    )


def view(zenith_deg, azimuth_deg, **more):
    return View(zenith_rad=np.radians(zenith_deg), azimuth_rad=np.radians(azimuth_deg), **more)


def light(camera, *, surface=PAINT, tilt=LEVEL, sun=None, **more):
    return aperture_lights(sun or illumination(), surface=surface, tilt=tilt, views=(camera,), **more)[0]


def test_sign_of_s2_by_compass_azimuths():
    # Sun in the south, camera in the east: phi = 180 - 90 = +90 deg. A facet mirrors 43 deg into 53 deg.
    sun = illumination(zenith_deg=43.0, azimuth_deg=180.0)
    found = light(view(53.0, 90.0), surface=replace(PAINT, dhr=None, slope_rms=0.3), sun=sun).reflected_sun
    assert found[2] / found[0] == pytest.approx(0.440, abs=5e-4)
    # No more polarized than the facet's Fresnel reflection: unpolarized light, so exactly as much.
    m00, m01, _ = mueller_elements(
        cos2_psi=np.array([0.5 * (1.0 + np.cos(np.radians(43.0)) * np.cos(np.radians(53.0)))]), n=1.5, k=0.0
    )
    assert dolp(found) == pytest.approx(float(m01[0] / m00[0]), rel=1e-9)


def test_the_beam_is_reflected_by_the_first_column():
    found = light(view(40.0, 20.0)).reflected_sun
    f = mueller(np.radians(50.0), np.radians(40.0), np.radians(180.0), surface=PAINT)
    np.testing.assert_allclose(found, 300.0 * np.cos(np.radians(50.0)) * f[:, 0], rtol=1e-10, atol=1e-12)


def test_parts_add_up():
    found = light(view(40.0, 100.0, height_m=3000.0))
    np.testing.assert_array_equal(found.total, found.reflected_sun + found.reflected_sky + found.path)
    assert np.all(np.array([found.reflected_sun[0], found.reflected_sky[0], found.path[0]]) > 0.0)


def test_air_dims_what_is_reflected_and_adds_its_own():
    near, far = (light(view(40.0, 100.0, height_m=height)) for height in (0.0, 5000.0))
    through = np.exp(-0.5 / np.cos(np.radians(40.0)))
    assert far.transmittance == pytest.approx(through)
    np.testing.assert_allclose(far.reflected, through * near.reflected)
    assert far.error == pytest.approx(through * near.error)
    np.testing.assert_array_equal(near.path, 0.0)
    assert far.path[0] == pytest.approx(20.0 * (1.0 - through))


def test_roll_turns_the_frame_of_every_part():
    straight = light(view(40.0, 100.0, height_m=3000.0))
    rolled = light(view(40.0, 100.0, height_m=3000.0, roll_rad=0.3))
    for part in ("reflected_sun", "reflected_sky", "path"):
        expected = rotate_frame(getattr(straight, part), 0.3)
        np.testing.assert_allclose(getattr(rolled, part), expected, atol=1e-12)
    lowered = (aolp_rad(straight.total) - aolp_rad(rolled.total)) % np.pi
    assert lowered == pytest.approx(0.3)  # axes turned counter-clockwise lower the angle


def test_a_panel_that_turns_from_the_sun_shows_sky_alone():
    away = Tilt(tilt_rad=np.radians(60.0), azimuth_rad=np.radians(20.0))
    found = light(view(50.0, 20.0), tilt=away)
    np.testing.assert_array_equal(found.reflected_sun, 0.0)
    assert found.reflected_sky[0] > 0.0


def test_a_tilted_panel_sees_the_ground_by_its_albedo():
    wall = Tilt(tilt_rad=np.radians(90.0), azimuth_rad=np.radians(20.0))
    dark, bright = (
        light(view(80.0, 20.0), tilt=wall, sun=illumination(albedo=albedo)).reflected_sky[0] for albedo in (0.0, 0.5)
    )
    assert bright > dark


def test_sky_irradiance_of_an_even_sky_is_pi():
    assert illumination(sky=even_sky).sky_irradiance == pytest.approx(np.pi, rel=1e-9)


def test_ground_radiance_is_what_a_lambertian_ground_sends_back():
    made = illumination(sky=even_sky, albedo=0.2)
    received = np.pi + 300.0 * np.cos(np.radians(50.0))
    assert made.diffuse_radiance.ground_radiance == pytest.approx(0.2 / np.pi * received, rel=1e-9)
    assert made.direct_horizontal_irradiance == pytest.approx(300.0 * np.cos(np.radians(50.0)))


def test_rules_of_a_similar_view_give_the_same_light_to_the_tolerance():
    views = (view(40.0, 100.0), view(42.0, 101.0))
    alone = [light(one, tolerance=1e-5) for one in views]
    together = aperture_lights(
        illumination(), surface=PAINT, tilt=LEVEL, views=views, tolerance=1e-5, rules=alone[0].rules
    )
    for one, same in zip(alone, together, strict=True):
        np.testing.assert_allclose(same.total, one.total, rtol=0, atol=same.error + one.error)
        assert same.error == pytest.approx(alone[0].rules.error * one.reflected_sky[0], rel=1e-3)
        assert same.rules == alone[0].rules


def test_a_coarse_rule_differs():
    found = light(view(40.0, 100.0))
    (coarse,) = aperture_lights(
        illumination(), surface=PAINT, tilt=LEVEL, views=(view(40.0, 100.0),), rules=Rules(lobe=4, diffuse=3)
    )
    assert coarse.reflected_sky[0] != pytest.approx(found.reflected_sky[0], rel=1e-6)


def test_views_from_two_heights_are_refused():
    views = (view(40.0, 100.0), view(40.0, 100.0, height_m=10.0))
    with pytest.raises(ValueError, match="one height"):
        aperture_lights(illumination(), surface=PAINT, tilt=LEVEL, views=views)


@pytest.mark.parametrize("zenith_deg", [85.01, 95.0, -1.0])
def test_a_sun_too_low_is_refused(zenith_deg):
    with pytest.raises(ValueError, match=r"solar zenith = .* allowed is 0 to 85 deg"):
        illumination(zenith_deg=zenith_deg)


def test_a_sun_at_85_deg_is_allowed():
    assert illumination(zenith_deg=85.0).direct_horizontal_irradiance > 0.0


@pytest.mark.parametrize("change", [{"zenith_rad": 1.6}, {"azimuth_rad": np.nan}, {"roll_rad": np.inf}])
def test_a_view_from_nowhere_is_refused(change):
    with pytest.raises(ValueError, match="camera"):
        View(**({"zenith_rad": 0.1, "azimuth_rad": 0.0} | change))


def test_a_camera_under_the_ground_is_refused():
    with pytest.raises(ValueError, match=r"height = -1.0 m"):
        view(10.0, 0.0, height_m=-1.0)


def test_an_albedo_above_one_is_refused():
    with pytest.raises(ValueError, match="ground_albedo"):
        illumination(albedo=1.2)
