"""Tilted panels against vectors in the world's axes, and plain cases that can be seen."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.stokes import aolp_rad, rotation
from model.surface.pbrdf import Surface, Tilt, local_geometry, mueller, tilted_mueller
from tests.model.surface.oracles import direction, facet_mueller

SURFACE = Surface(n=1.5, k=0.2, slope_rms=0.3)
LEVEL = Tilt(tilt_rad=0.0)


def seen(tilt: Tilt, *angles: float, roll: float = 0.0, surface: Surface = SURFACE) -> np.ndarray:
    return tilted_mueller(
        sun_zenith_rad=angles[0],
        sun_azimuth_rad=angles[1],
        camera_zenith_rad=angles[2],
        camera_azimuth_rad=angles[3],
        camera_roll_rad=roll,
        tilt=tilt,
        surface=surface,
    )


@given(
    sun=st.tuples(st.floats(0.0, 1.4), st.floats(-7.0, 7.0)),
    camera=st.tuples(st.floats(0.0, 1.4), st.floats(-7.0, 7.0)),
)
@settings(deadline=None, max_examples=40)
def test_a_level_panel_is_the_pbrdf_itself(sun: tuple, camera: tuple) -> None:
    phi = sun[1] - camera[1]
    expected = mueller(sun[0], camera[0], phi, surface=SURFACE)
    # Directions round by 1e-16; the exponent, tan^2 / (2 slope^2) < 200, and steep angles (1 / cos < 6) magnify it.
    np.testing.assert_allclose(seen(LEVEL, *sun, *camera), expected, atol=1e-11 * expected[0, 0])


@pytest.mark.parametrize("azimuth", [0.0, 2.5])
def test_a_level_panel_under_a_nadir_camera(azimuth: float) -> None:
    phi = 0.7 - azimuth
    expected = mueller(0.6, 0.0, phi, surface=SURFACE)
    np.testing.assert_allclose(seen(LEVEL, 0.6, 0.7, 0.0, azimuth), expected, atol=1e-13 * expected[0, 0])


@given(
    tilt=st.tuples(st.floats(0.0, 1.2), st.floats(-3.0, 3.0)),
    sun=st.tuples(st.floats(0.05, 1.2), st.floats(-3.0, 3.0)),
    camera=st.tuples(st.floats(0.05, 1.2), st.floats(-3.0, 3.0)),
)
@settings(deadline=None, max_examples=40)
def test_tilted_panel_against_world_vectors(tilt: tuple, sun: tuple, camera: tuple) -> None:
    actual = seen(Tilt(tilt_rad=tilt[0], azimuth_rad=tilt[1]), *sun, *camera)
    normal, to_sun, to_camera = direction(*tilt), direction(*sun), direction(*camera)
    facing = [float(sum(a * b for a, b in zip(normal, ray, strict=True))) for ray in (to_sun, to_camera)]
    if min(facing) <= 0.0:
        assert not np.any(actual)
        return
    expected = np.array(
        facet_mueller(
            to_sun,
            to_camera,
            normal=normal,
            h_in=[mp.cos(sun[1]), -mp.sin(sun[1]), mp.mpf(0)],
            h_out=[-mp.cos(camera[1]), mp.sin(camera[1]), mp.mpf(0)],
            n=1.5,
            k=0.2,
            slope_rms=0.3,
            shadow="v-cavity",
        )
    )
    # The oracle works with 15 digits here; steepness of the exponent and 1 / cos at the panel's rim magnify.
    np.testing.assert_allclose(actual, expected, atol=1e-9 * expected[0, 0] / min(facing) ** 2)


def test_glint_off_a_wall_is_vertical() -> None:
    # A wall facing south; sun in the south-east, camera in the south-west, both on the horizon: a plane of incidence
    # that is horizontal, so the s direction is up.
    wall = Tilt(tilt_rad=np.pi / 2, azimuth_rad=np.pi)
    level_rays = (np.pi / 2, np.deg2rad(135.0), np.pi / 2, np.deg2rad(225.0))
    light = seen(wall, *level_rays, surface=Surface(n=1.5, slope_rms=0.2))[:, 0]
    assert aolp_rad(light) == pytest.approx(np.pi / 2, abs=1e-12)
    local = local_geometry(
        sun_zenith_rad=level_rays[0],
        sun_azimuth_rad=level_rays[1],
        camera_zenith_rad=level_rays[2],
        camera_azimuth_rad=level_rays[3],
        tilt=wall,
    )
    assert local.theta_i_rad == pytest.approx(np.pi / 4)
    assert local.theta_r_rad == pytest.approx(np.pi / 4)
    assert abs(local.phi_rad) == pytest.approx(np.pi)


@pytest.mark.parametrize("roll", [0.3, -1.1])
def test_camera_roll_lowers_the_angle_of_polarization(roll: float) -> None:
    angles = (0.7, 0.2, 0.9, 2.2)
    upright, rolled = seen(LEVEL, *angles)[:, 0], seen(LEVEL, *angles, roll=roll)[:, 0]
    assert np.sin(aolp_rad(rolled) - (aolp_rad(upright) - roll)) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(rolled, rotation(roll) @ upright, atol=1e-15)


def test_a_ray_along_the_panels_normal() -> None:
    # Camera on the normal: the panel has no plane for it, the camera's own horizontal must still come out.
    tilt = Tilt(tilt_rad=0.5, azimuth_rad=1.0)
    on, beside = (seen(tilt, 0.9, 0.3, 0.5 + offset, 1.0) for offset in (0.0, 1e-7))
    # F changes by about tan / slope^2 = 5 per rad, times 1e-7.
    np.testing.assert_allclose(on, beside, atol=2e-6 * on[0, 0])


def test_arrays_of_sky_points() -> None:
    tilt = Tilt(tilt_rad=0.3, azimuth_rad=2.0)
    zenith, azimuth = np.array([[0.2], [0.8]]), np.array([0.0, 1.0, 3.0])
    together = seen(tilt, zenith, azimuth, 0.6, 0.1)
    assert together.shape == (2, 3, 3, 3)
    np.testing.assert_allclose(together[1, 2], seen(tilt, 0.8, 3.0, 0.6, 0.1), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"tilt_rad": -0.1}, "tilt_rad"),
        ({"tilt_rad": np.nan}, "tilt_rad"),
        ({"tilt_rad": 0.1, "azimuth_rad": np.inf}, "azimuth_rad"),
    ],
)
def test_tilts_have_ranges(arguments: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        Tilt(**arguments)


def test_roll_must_be_finite() -> None:
    with pytest.raises(ValueError, match="camera_roll_rad"):
        seen(LEVEL, 0.1, 0.2, 0.3, 0.4, roll=np.nan)
