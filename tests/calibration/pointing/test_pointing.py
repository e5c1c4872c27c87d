"""Where cameras and panels point: simulated pictures of known direction, and sources that contradict one another."""

import cv2
import numpy as np
import pytest

from benchmarks.trials.pointing import coverage, panel_corners, seen
from calibration.pointing.pose import (
    Lens,
    SunSeen,
    calibrate_lens,
    camera_axes,
    compass,
    fuse,
    level,
    panel_stands,
    plain_lens,
    positions,
    rays,
    refraction_rad,
    sun_in_picture,
    way_between,
    wrapped_rad,
)
from calibration.results import CalibrationError

LENS = Lens(parameters=np.array([1500.0, 1500.0, 390.5, 290.5, -0.1, 0.02, 0.0, 0.0]), covariance=np.zeros((8, 8)))


def test_the_axes_of_a_camera_are_those_of_the_conventions():
    north = camera_axes(np.array([0.0, 0.0, 0.0]))
    assert north == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), abs=1e-12)
    east_down = camera_axes(np.radians([90.0, -30.0, 0.0]))
    assert east_down[2] == pytest.approx([np.cos(np.pi / 6), 0.0, -0.5], abs=1e-12)
    # Rolled counter-clockwise as it sees the scene its right side rises.
    assert camera_axes(np.radians([0.0, 0.0, 10.0]))[0, 2] == pytest.approx(np.sin(np.radians(10.0)))


def test_rays_are_the_inverse_of_the_picture():
    draws = np.random.default_rng(1)
    pixels = draws.uniform(0.0, 580.0, (20, 2))
    looks = rays(pixels, LENS)
    back = seen(looks @ camera_axes(np.zeros(3)), np.zeros(3), LENS)
    assert back == pytest.approx(pixels, abs=1e-4)


def test_stated_intervals_hold_the_truth():
    found = coverage(range(5))
    rms = {name: row[2] for name, row in found.items() if "contradictions" not in name and name != "two stands"}
    assert len(rms) == 10
    # Of five draws the rms lies below 1.9 in all but one of a thousand cases (chi-square).
    assert max(rms.values()) < 2.2
    assert 0.5 < np.sqrt(np.mean(np.square(list(rms.values())))) < 1.5


def _compass(deg, std_deg=1.0):
    return compass(np.radians(deg), np.radians(std_deg), declination_rad=0.0, declination_std_rad=0.0)


def test_sources_that_agree_are_weighted_by_their_errors():
    found = fuse([_compass(10.0, 1.0), _compass(13.0, 2.0), level(-0.5, 0.0, 0.01)])
    assert np.degrees(found.angles_rad[0]) == pytest.approx(10.6, abs=1e-3)
    assert np.degrees(found.std_rad[0]) == pytest.approx(np.sqrt(0.8), rel=1e-3)
    assert (found.contradictions, found.freedom) == ((), 1)


def test_a_compass_beside_iron_is_named_and_widens_the_errors():
    target = 100.0 * camera_axes(np.radians([350.0, -20.0, 0.0]))[2]
    found = fuse([_compass(20.0), positions(target, np.full(3, 0.5)), level(np.radians(-20.0), 0.0, 0.01)])
    assert "compass" in {one.name for one in found.contradictions}
    assert np.degrees(found.std_rad[0]) > 1.0


def test_what_no_source_says_is_not_determined():
    found = fuse([_compass(359.0)])
    assert np.degrees(found.std_rad[1]) > 50.0
    assert abs(np.degrees(wrapped_rad(found.angles_rad[:1] - np.radians(359.0)))[0]) < 1e-6


def test_the_sun_and_a_level_tell_the_azimuth():
    angles = np.radians([200.0, 30.0, 1.0])
    sun = SunSeen(azimuth_rad=np.radians(203.0), elevation_rad=np.radians(33.0))
    pixel = seen(sun.vector[None, :], angles, LENS)[0]
    found = fuse([sun_in_picture(pixel, 0.5, sun, LENS), level(angles[1], angles[2], np.radians(0.01))])
    assert np.degrees(found.angles_rad) == pytest.approx([200.0, 30.0, 1.0], abs=0.01)
    assert np.degrees(found.std_rad[0]) < 0.05


def test_refraction_is_that_of_the_almanac():
    # Saemundsson: 28.9 minutes of arc at the horizon, 1.0 at 45 deg.
    assert np.degrees(refraction_rad(0.0)) * 60.0 == pytest.approx(28.98, abs=0.5)
    assert np.degrees(refraction_rad(np.pi / 4)) * 60.0 == pytest.approx(1.0, abs=0.03)


def test_an_outline_of_another_shape_is_refused():
    with pytest.raises(CalibrationError, match="no panel of 2 x 1 m has this outline"):
        panel_stands(np.array([[100, 100], [200, 90], [210, 400], [90, 200]], float), 2.0, 1.0, 0.5, LENS)


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([[100, 100], [200, 100], [300, 100], [150, 200]], "not convex"),
        ([[100, 100], [200, 200], [200, 100], [100, 200]], "not convex"),
        ([[100, 100], [300, 100], [160, 140], [100, 300]], "not convex"),
        ([[100, 100], [100, 100], [200, 200], [100, 200]], "two corners of the outline lie 0 pixels apart"),
    ],
)
def test_an_outline_that_is_none_is_refused(corners, said):
    with pytest.raises(CalibrationError, match=said):
        panel_stands(np.array(corners, float), 2.0, 1.0, 0.5, LENS)


def test_a_panel_listed_the_other_way_round_stands_as_it_does():
    angles = np.radians([30.0, -40.0, 0.0])
    corners = panel_corners(10.0 * camera_axes(angles)[2], 0.3, 3.4, 1.0, np.array([2.0, 1.0]))
    outline = seen(corners, angles, LENS)
    one, *_ = panel_stands(outline, 2.0, 1.0, 0.1, LENS)
    other, *_ = panel_stands(outline[[1, 0, 3, 2]], 2.0, 1.0, 0.1, LENS)
    assert other.normal == pytest.approx(one.normal, abs=1e-6)


def test_the_way_between_places_is_that_of_the_ellipsoid():
    # A minute of latitude at 45 deg is 1852.2 m, one of longitude 1315 m (WGS 84: 111.132 and 78.847 km a degree).
    assert way_between((45.0, 7.0, 100.0), (45.0 + 1 / 60, 7.0, 90.0)) == pytest.approx([0.0, 1852.2, -10.0], abs=0.3)
    assert way_between((45.0, 7.0, 0.0), (45.0, 7.0 + 1 / 60, 0.0))[0] == pytest.approx(1314.1, abs=0.3)


def _board(lens, angles, centre_m, *, columns=7, rows=5, square_m=0.03, size=(320, 240)):
    """Return a picture of a chessboard, drawn pixel by pixel through the lens."""
    turn, _ = cv2.Rodrigues(np.array(angles))
    grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2).astype(float)
    pixels = np.concatenate([grid + shift for shift in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))])
    looks = rays(pixels, lens) @ turn
    origin = -np.array(centre_m) @ turn
    places = origin[:2] + looks[:, :2] * (-origin[2] / looks[:, 2:])
    cells = np.floor(places / square_m + 0.5 * np.array([columns + 1, rows + 1])).astype(int)
    inside = np.all((cells >= 0) & (cells < [columns + 1, rows + 1]), axis=1)
    dark = inside & (cells.sum(axis=1) % 2 == 0)
    picture = np.where(dark, 300.0, 3000.0).reshape(4, size[1], size[0]).mean(axis=0)
    return np.random.default_rng(2).normal(picture, 20.0).clip(0.0, 4095.0).astype(np.uint16)


STANDS = ((0.5, 0.1, 0.0), (-0.4, 0.3, 0.1), (0.1, -0.5, 0.2), (0.4, 0.4, -0.2), (-0.3, -0.4, 0.0))


def test_a_chessboard_tells_the_lens():
    true = Lens(parameters=np.array([500.0, 500.0, 165.0, 118.0, -0.15, 0.0, 0.0, 0.0]), covariance=np.zeros((8, 8)))
    pictures = [_board(true, stand, (0.01 * k - 0.02, 0.01, 0.5)) for k, stand in enumerate(STANDS)]
    found = calibrate_lens([*pictures, np.full((240, 320), 500, np.uint16)], columns=7, rows=5, square_m=0.03)
    assert (found.used, found.unused) == ((0, 1, 2, 3, 4), (5,))
    assert found.rms_px < 0.3
    off = (found.lens.parameters - true.parameters)[:4] / np.sqrt(np.diag(found.lens.covariance))[:4]
    assert np.abs(off).max() < 4.0


def test_too_few_boards_are_refused():
    with pytest.raises(CalibrationError, match="0 of 3 pictures show a board of 7 x 5"):
        calibrate_lens([np.full((240, 320), 500, np.uint16)] * 3, columns=7, rows=5, square_m=0.03)


def test_a_lens_by_its_focal_length_has_its_axis_in_the_middle():
    lens = plain_lens(1500.0, 20.0, 782, 582)
    assert rays(np.array([[390.5, 290.5]]), lens)[0] == pytest.approx([0.0, 0.0, 1.0])
    assert len(list(lens.moved())) == 4
