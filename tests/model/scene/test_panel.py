"""Light of one panel: the beam, the sky over the hemisphere by rules with their error, and the air before a camera."""

from dataclasses import replace

import numpy as np
import pytest

from model.scene.panel import PanelLight, Rules, View, aperture_lights, reflected_by_rules, reflected_diffuse
from model.stokes import aolp_rad, dolp, rotate_frame
from model.surface.facets import lobe_reflectance, mueller_elements
from model.surface.materials import surface_of
from model.surface.pbrdf import Surface, Tilt, hemispherical_reflectance, mueller
from rigctl.files.materials import load_material
from tests.model.made_lighting import SUN_AZIMUTH_RAD, even_sky, illumination, polarized_sky, skylight
from tests.rigctl.example_files import EXAMPLES

GLOSSY = Surface(n=1.5, slope_rms=0.15)
PAINT = Surface(n=1.5, slope_rms=0.15, dhr=0.05)
LEVEL = Tilt(tilt_rad=0.0)


def camera_at(zenith_deg, azimuth_deg=70.0, **more):
    return View(zenith_rad=np.radians(zenith_deg), azimuth_rad=np.radians(azimuth_deg), **more)


def panel(zenith_deg, *, surface=PAINT, tilt=LEVEL, azimuth_deg=70.0):
    return PanelLight(surface=surface, tilt=tilt, views=(camera_at(zenith_deg, azimuth_deg),))


def reflected(one, light, **how):
    """Return what goes to the only camera."""
    found = reflected_diffuse(one, light, **how)
    return replace(found, stokes=found.stokes[0], error=found.error[0])


def by_rules(one, light, rules):
    return reflected_by_rules(one, light, rules)[0]


@pytest.mark.parametrize("zenith_deg", [0.0, 35.0, 75.0])
@pytest.mark.parametrize("slope_rms", [0.05, 0.3])
def test_an_even_sky_is_reflected_by_the_hemispherical_reflectance(zenith_deg, slope_rms):
    surface = replace(GLOSSY, slope_rms=slope_rms)
    found = reflected(panel(zenith_deg, surface=surface), skylight(even_sky), tolerance=1e-7)
    # By reciprocity; the reflectance is known to 1e-8.
    expected = lobe_reflectance(np.radians(zenith_deg), lobe=surface.lobe)
    assert found.stokes[0] == pytest.approx(float(expected.s0), abs=found.error + 2e-8)
    assert found.stokes[1] == pytest.approx(float(expected.s1), abs=found.error + 2e-8)
    assert found.stokes[2] == pytest.approx(0.0, abs=1e-12)


def test_a_lambertian_panel_shows_its_reflectance_of_an_even_sky():
    surface = replace(PAINT, dhr=0.6, specular_weight=0.0, diffuse="lambert")
    found = reflected(panel(40.0, surface=surface), skylight(even_sky))
    np.testing.assert_allclose(found.stokes, [0.6, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(("zenith_deg", "azimuth_deg"), [(0.0, 10.0), (50.0, 110.0), (70.0, 20.0)])
def test_against_the_integral_written_out(zenith_deg, azimuth_deg):
    surface = replace(PAINT, slope_rms=0.3)
    camera = camera_at(zenith_deg, azimuth_deg)
    node, weight = np.polynomial.legendre.leggauss(300)
    theta = 0.25 * np.pi * (node + 1.0)
    around = 2.0 * np.pi * np.arange(600) / 600
    zenith, azimuth = np.meshgrid(theta, around, indexing="ij")
    f = mueller(zenith, camera.zenith_rad, azimuth - camera.azimuth_rad, surface=surface)
    light = polarized_sky()(zenith_rad=zenith, phi_rad=SUN_AZIMUTH_RAD - azimuth)
    ring = 0.25 * np.pi * weight * np.sin(theta) * np.cos(theta) * (2.0 * np.pi / 600)
    expected = np.einsum("z,zaij,zaj->i", ring, f, light)
    found = reflected(PanelLight(surface=surface, tilt=LEVEL, views=(camera,)), skylight(), tolerance=1e-5)
    # The lobe is some 60 nodes wide; the branch of its shadowing is a kink that a node misses by 0.3 deg.
    np.testing.assert_allclose(found.stokes, expected, rtol=0, atol=1e-4 * expected[0])


GRID = [
    (surface, zenith_deg, azimuth_deg, Tilt(tilt_rad=np.radians(tilt_deg), azimuth_rad=2.0))
    for surface in (replace(PAINT, slope_rms=0.05), replace(PAINT, slope_rms=0.12), replace(PAINT, slope_rms=0.35))
    for zenith_deg, azimuth_deg in ((0.0, 0.0), (22.0, 20.0), (53.0, 110.0), (53.0, 20.0), (80.0, 200.0))
    for tilt_deg in (0.0, 25.0)
]


@pytest.mark.slow
@pytest.mark.parametrize(("surface", "zenith_deg", "azimuth_deg", "tilt"), GRID)
def test_twice_the_nodes_change_less_than_the_error_that_was_reported(surface, zenith_deg, azimuth_deg, tilt):
    one, light = panel(zenith_deg, surface=surface, tilt=tilt, azimuth_deg=azimuth_deg), skylight(ground_radiance=5.0)
    found = reflected(one, light)
    # Twice the finest rule that there is.
    finer = by_rules(one, light, Rules(lobe=144, diffuse=144))
    assert np.max(np.abs(finer - found.stokes)) < found.error
    enough = by_rules(one, light, found.rules)
    assert np.max(np.abs(finer - enough)) < found.rules.error * found.stokes[0]


@pytest.mark.parametrize(("surface", "zenith_deg", "azimuth_deg", "tilt"), GRID[::4])
def test_the_rules_that_suffice_are_within_the_tolerance(surface, zenith_deg, azimuth_deg, tilt):
    one, light = panel(zenith_deg, surface=surface, tilt=tilt, azimuth_deg=azimuth_deg), skylight(ground_radiance=5.0)
    found = reflected(one, light)
    assert np.max(np.abs(by_rules(one, light, found.rules) - found.stokes)) < max(
        found.error,
        2e-4 * found.stokes[0],  # lobe and diffuse term
    )
    assert found.rules.error * found.stokes[0] <= max(found.error, (2e-4 + 3e-5) * found.stokes[0])  # and the tail


@pytest.mark.parametrize("slope_rms", [0.05, 0.15])
def test_a_level_panel_reaches_the_tolerance(slope_rms):
    found = reflected(panel(53.0, surface=replace(PAINT, slope_rms=slope_rms)), skylight(), tolerance=1e-4)
    assert found.error <= 2e-4 * found.stokes[0]  # lobe and diffuse term


def test_the_other_side_of_the_principal_plane_has_the_other_sign_of_s2():
    sun_deg = np.degrees(SUN_AZIMUTH_RAD)
    one, other = (reflected(panel(50.0, azimuth_deg=sun_deg + side * 70.0), skylight()).stokes for side in (1, -1))
    np.testing.assert_allclose(one, other * [1, 1, -1], rtol=1e-10)
    assert abs(one[2]) > 1e-3 * one[0]


def test_turning_sun_and_camera_together_changes_nothing():
    light = skylight()
    turned = replace(light, sun_azimuth_rad=light.sun_azimuth_rad + 1.1)
    here = reflected(panel(50.0, azimuth_deg=20.0), light).stokes
    there = reflected(panel(50.0, azimuth_deg=20.0 + np.degrees(1.1)), turned).stokes
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-5 * here[0])  # the azimuths of the diffuse nodes stay


def test_a_tilted_panel_in_even_light_shows_what_a_level_one_shows_at_its_own_angle():
    tilt = Tilt(tilt_rad=np.radians(30.0), azimuth_rad=np.radians(70.0))  # leans toward the camera
    light = skylight(even_sky, ground_radiance=1.0)
    tilted = reflected(panel(50.0, tilt=tilt), light, tolerance=1e-6).stokes
    level = reflected(panel(20.0), light, tolerance=1e-6).stokes
    # Two halves of the world's sphere, cut by the panel's plane: the rule converges as the square of 72 nodes.
    np.testing.assert_allclose(tilted, level, rtol=0, atol=2e-4 * level[0])


def test_a_panel_leaning_sideways_turns_the_polarization():
    tilt = Tilt(tilt_rad=np.radians(20.0), azimuth_rad=np.radians(160.0))  # to the left, as the camera sees it
    light = skylight(even_sky, ground_radiance=1.0)
    found = reflected(panel(50.0, surface=GLOSSY, tilt=tilt), light).stokes
    assert found[2] != pytest.approx(0.0, abs=1e-2 * found[0])
    assert 0.0 < dolp(found) < 1.0


def test_the_skys_own_error_is_passed_on():
    exact = reflected(panel(50.0), skylight())
    doubted = reflected(panel(50.0), skylight(relative_error=0.01))
    assert doubted.error - exact.error == pytest.approx(0.01 * exact.stokes[0])


@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_several_cameras_at_once_see_what_each_sees_alone(tilt_deg):
    tilt, light = Tilt(tilt_rad=np.radians(tilt_deg), azimuth_rad=2.0), skylight(ground_radiance=5.0)
    views = tuple(camera_at(*at) for at in ((0.0, 0.0), (22.0, 20.0), (53.0, 110.0), (61.0, 250.0)))
    # Enough nodes for more than one block of them.
    rules = Rules(lobe=32, diffuse=21)
    together = reflected_by_rules(PanelLight(surface=PAINT, tilt=tilt, views=views), light, rules)
    for one, found in zip(views, together, strict=True):
        alone = by_rules(PanelLight(surface=PAINT, tilt=tilt, views=(one,)), light, rules)
        np.testing.assert_allclose(found, alone, rtol=0, atol=1e-13 * alone[0])


def test_rules_are_refined_until_they_suffice_for_the_worst_camera():
    light, easy, hard = skylight(), camera_at(80.0, 200.0), camera_at(0.0, 0.0)
    alone, other, both = (
        reflected_diffuse(PanelLight(surface=PAINT, tilt=LEVEL, views=views), light, tolerance=1e-4).rules.lobe
        for views in ((easy,), (hard,), (easy, hard))
    )
    assert alone < other == both


@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_a_panel_that_was_seen_before_reflects_the_light_that_is_there_now(tilt_deg):
    tilt, rules = Tilt(tilt_rad=np.radians(tilt_deg), azimuth_rad=1.0), Rules(lobe=9, diffuse=6)
    first, other = (polarized_sky(sun_zenith_deg=at) for at in (50.0, 20.0))
    of_first, of_other = (by_rules(panel(53.0, tilt=tilt), skylight(sky), rules) for sky in (first, other))

    def both(*, zenith_rad, phi_rad):
        return first(zenith_rad=zenith_rad, phi_rad=phi_rad) + other(zenith_rad=zenith_rad, phi_rad=phi_rad)

    assert not np.allclose(of_first, of_other, rtol=1e-2)
    np.testing.assert_allclose(by_rules(panel(53.0, tilt=tilt), skylight(both), rules), of_first + of_other, rtol=1e-12)


def measured_surface():
    return surface_of(load_material(EXAMPLES / "measured-panel.csv"), wavelength_m=550e-9)


def test_a_measured_panel_shows_its_reflectance_of_an_even_sky():
    surface = measured_surface()
    found = reflected(panel(40.0, surface=surface), skylight(even_sky), tolerance=1e-3)
    total = hemispherical_reflectance(np.radians(40.0), surface=surface)
    np.testing.assert_allclose(found.stokes[:2], [total.s0, total.s1], atol=2e-3)


def light(camera, *, surface=PAINT, tilt=LEVEL, sun=None, **more):
    return aperture_lights(sun or illumination(), surface=surface, tilt=tilt, views=(camera,), **more)[0]


def test_sign_of_s2_by_compass_azimuths():
    # Sun in the south, camera in the east: phi = 180 - 90 = +90 deg. A facet mirrors 43 deg into 53 deg.
    sun = illumination(zenith_deg=43.0, azimuth_deg=180.0)
    found = light(camera_at(53.0, 90.0), surface=replace(PAINT, dhr=None, slope_rms=0.3), sun=sun).reflected_sun
    assert found[2] / found[0] == pytest.approx(0.440, abs=5e-4)
    # No more polarized than the facet's Fresnel reflection: unpolarized light, so exactly as much.
    m00, m01, _ = mueller_elements(
        cos2_psi=np.array([0.5 * (1.0 + np.cos(np.radians(43.0)) * np.cos(np.radians(53.0)))]), n=1.5, k=0.0
    )
    assert dolp(found) == pytest.approx(float(m01[0] / m00[0]), rel=1e-9)


def test_the_beam_is_reflected_by_the_first_column():
    found = light(camera_at(40.0, 20.0)).reflected_sun
    f = mueller(np.radians(50.0), np.radians(40.0), np.radians(180.0), surface=PAINT)
    np.testing.assert_allclose(found, 300.0 * np.cos(np.radians(50.0)) * f[:, 0], rtol=1e-10, atol=1e-12)


def test_parts_add_up():
    found = light(camera_at(40.0, 100.0, height_m=3000.0))
    np.testing.assert_array_equal(found.total, found.reflected_sun + found.reflected_sky + found.path)
    assert np.all(np.array([found.reflected_sun[0], found.reflected_sky[0], found.path[0]]) > 0.0)


def test_air_dims_what_is_reflected_and_adds_its_own():
    near, far = (light(camera_at(40.0, 100.0, height_m=height)) for height in (0.0, 5000.0))
    through = np.exp(-0.5 / np.cos(np.radians(40.0)))
    assert far.transmittance == pytest.approx(through)
    np.testing.assert_allclose(far.reflected, through * near.reflected)
    assert far.error == pytest.approx(through * near.error)
    np.testing.assert_array_equal(near.path, 0.0)
    assert far.path[0] == pytest.approx(20.0 * (1.0 - through))


def test_roll_turns_the_frame_of_every_part():
    straight = light(camera_at(40.0, 100.0, height_m=3000.0))
    rolled = light(camera_at(40.0, 100.0, height_m=3000.0, roll_rad=0.3))
    for part in ("reflected_sun", "reflected_sky", "path"):
        expected = rotate_frame(getattr(straight, part), 0.3)
        np.testing.assert_allclose(getattr(rolled, part), expected, atol=1e-12)
    lowered = (aolp_rad(straight.total) - aolp_rad(rolled.total)) % np.pi
    assert lowered == pytest.approx(0.3)  # axes turned counter-clockwise lower the angle


def test_a_panel_that_turns_from_the_sun_shows_sky_alone():
    away = Tilt(tilt_rad=np.radians(60.0), azimuth_rad=np.radians(20.0))
    found = light(camera_at(50.0, 20.0), tilt=away)
    np.testing.assert_array_equal(found.reflected_sun, 0.0)
    assert found.reflected_sky[0] > 0.0


def test_a_tilted_panel_sees_the_ground_by_its_albedo():
    wall = Tilt(tilt_rad=np.radians(90.0), azimuth_rad=np.radians(20.0))
    dark, bright = (
        light(camera_at(80.0, 20.0), tilt=wall, sun=illumination(albedo=albedo)).reflected_sky[0]
        for albedo in (0.0, 0.5)
    )
    assert bright > dark


def test_rules_of_a_similar_view_give_the_same_light_to_the_tolerance():
    views = (camera_at(40.0, 100.0), camera_at(42.0, 101.0))
    alone = [light(one, tolerance=1e-5) for one in views]
    together = aperture_lights(
        illumination(), surface=PAINT, tilt=LEVEL, views=views, tolerance=1e-5, rules=alone[0].rules
    )
    for one, same in zip(alone, together, strict=True):
        np.testing.assert_allclose(same.total, one.total, rtol=0, atol=same.error + one.error)
        assert same.error == pytest.approx(alone[0].rules.error * one.reflected_sky[0], rel=1e-3)
        assert same.rules == alone[0].rules
    (coarse,) = aperture_lights(
        illumination(), surface=PAINT, tilt=LEVEL, views=views[:1], rules=Rules(lobe=4, diffuse=3)
    )
    assert coarse.reflected_sky[0] != pytest.approx(alone[0].reflected_sky[0], rel=1e-6)


def sun_beyond_the_measured_angles():
    panel(40.0, surface=measured_surface()).sun(zenith_rad=np.radians(80.0), azimuth_rad=0.0, irradiance=1.0)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: panel(80.0, tilt=Tilt(tilt_rad=np.radians(30.0), azimuth_rad=np.radians(250.0))), "turns its back"),
        (lambda: reflected(panel(50.0), skylight(), tolerance=0.0), "tolerance"),
        (lambda: panel(80.0, surface=measured_surface()), "outside of the measured range"),
        (sun_beyond_the_measured_angles, "outside of the measured range"),
        (
            lambda: aperture_lights(
                illumination(),
                surface=PAINT,
                tilt=LEVEL,
                views=(camera_at(40.0), camera_at(40.0, height_m=10.0)),
            ),
            "one height",
        ),
        (lambda: camera_at(91.0), "camera"),
        (lambda: camera_at(10.0, np.nan), "camera"),
        (lambda: camera_at(10.0, roll_rad=np.inf), "camera"),
        (lambda: camera_at(10.0, height_m=-1.0), "height = -1.0 m"),
    ],
)
def test_what_cannot_be_seen_is_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()
