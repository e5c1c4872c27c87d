import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_devices.world import Polarizer, World
from tests.sim_devices.camera_builders import PERFECT_POLARIZER, Turntable, uniform_world

LEAKY = Polarizer(transmittance_along=0.8, transmittance_across=0.02, offset_deg=0.0, sense=1)
HORIZONTAL, VERTICAL = (2.0, 2.0, 0.0), (2.0, -2.0, 0.0)
PLUS_45, MINUS_45 = (2.0, 0.0, 2.0), (2.0, 0.0, -2.0)


def seen(*, stokes, stage_angle_deg, polarizer=PERFECT_POLARIZER):
    """Return the radiance of the one pixel of a uniform scene."""
    stage = Turntable()
    stage.angle_deg = stage_angle_deg
    world = uniform_world(stokes=stokes, width=1, height=1, polarizer=polarizer, stage=stage)
    return world.radiance_behind_polarizer().item()


@pytest.mark.parametrize(("stokes", "brightest_deg"), [(HORIZONTAL, 0), (PLUS_45, 45), (VERTICAL, 90), (MINUS_45, 135)])
def test_pure_light_passes_along_its_own_direction_and_leaks_across(stokes, brightest_deg):
    # All of 2 times 0.8 or 0.02; some ten operations of rounding.
    along = seen(stokes=stokes, stage_angle_deg=brightest_deg, polarizer=LEAKY)
    across = seen(stokes=stokes, stage_angle_deg=brightest_deg + 90, polarizer=LEAKY)
    assert along == pytest.approx(1.6, rel=1e-14)
    assert across == pytest.approx(0.04, rel=1e-14)


def test_half_way_between_the_axes_both_transmittances_count_half():
    assert seen(stokes=PLUS_45, stage_angle_deg=0, polarizer=LEAKY) == pytest.approx(0.82, rel=1e-14)


@pytest.mark.parametrize(
    ("stage_angle_deg", "passed"), [(0, 1.5), (30, 1.25), (45, 1.0), (60, 0.75), (90, 0.5), (180, 1.5)]
)
def test_malus_law_of_half_polarised_light(stage_angle_deg, passed):
    # Half of the unpolarised 1, and cos^2 of the angle of the polarised 1.
    assert seen(stokes=(2.0, 1.0, 0.0), stage_angle_deg=stage_angle_deg) == pytest.approx(passed, rel=1e-14)


def test_offset_turns_the_axis_counter_clockwise():
    turned = Polarizer(transmittance_along=1.0, transmittance_across=0.0, offset_deg=10.0, sense=1)
    assert seen(stokes=PLUS_45, stage_angle_deg=35, polarizer=turned) == pytest.approx(2.0, rel=1e-14)


def test_sense_of_minus_one_turns_the_axis_against_the_stage():
    mirrored = Polarizer(transmittance_along=1.0, transmittance_across=0.0, offset_deg=10.0, sense=-1)
    # 45 = -(-35) + 10
    assert seen(stokes=PLUS_45, stage_angle_deg=-35, polarizer=mirrored) == pytest.approx(2.0, rel=1e-14)


def test_crossed_polarizer_never_passes_less_than_nothing():
    # Decimals whose root of squares rounds to either side of S0.
    directions = np.deg2rad(np.arange(0.0, 180.0, 0.7))
    for direction in directions:
        stokes = (0.7, 0.7 * np.cos(2 * direction), 0.7 * np.sin(2 * direction))
        crossed = seen(stokes=stokes, stage_angle_deg=np.rad2deg(direction) + 90)
        assert 0.0 <= crossed < 1e-14


@settings(deadline=None, max_examples=100)
@given(
    s0=st.floats(0.01, 100.0),
    dolp=st.floats(0.0, 1.0),
    aolp_rad=st.floats(0.0, np.pi),
    along=st.floats(0.1, 1.0),
    extinction=st.floats(0.0, 1.0),
    axis_deg=st.floats(-720.0, 720.0),
)
def test_agrees_with_the_mueller_row_of_a_diattenuator(s0, dolp, aolp_rad, along, extinction, axis_deg):
    s1, s2 = s0 * dolp * np.cos(2 * aolp_rad), s0 * dolp * np.sin(2 * aolp_rad)
    across = along * extinction
    polarizer = Polarizer(transmittance_along=along, transmittance_across=across, offset_deg=0.0, sense=1)
    double_rad = 2.0 * np.deg2rad(axis_deg)
    oracle = 0.5 * (along + across) * s0
    oracle += 0.5 * (along - across) * (s1 * np.cos(double_rad) + s2 * np.sin(double_rad))
    found = seen(stokes=(s0, s1, s2), stage_angle_deg=axis_deg, polarizer=polarizer)
    # The argument of the cosine, up to 8 pi, carries 8 pi eps = 6e-15; the rest are some ten eps.
    assert found == pytest.approx(oracle, abs=2e-14 * s0)


def test_angle_of_the_stage_is_read_anew_each_time():
    stage = Turntable()
    world = uniform_world(stokes=HORIZONTAL, width=1, height=1, stage=stage)
    before = world.radiance_behind_polarizer().item()
    stage.angle_deg = 90.0
    assert before == pytest.approx(2.0, rel=1e-14)
    assert world.radiance_behind_polarizer().item() == pytest.approx(0.0, abs=1e-14)


def test_each_pixel_keeps_its_place():
    radiance = np.zeros((3, 2, 3))
    radiance[0] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    world = World(radiance=radiance, polarizer=PERFECT_POLARIZER, stage_angle_deg=Turntable(), flat_radiance=1.0)
    assert world.shape == (2, 3)
    np.testing.assert_array_equal(world.radiance_behind_polarizer(), [[0.5, 1.0, 1.5], [2.0, 2.5, 3.0]])


def test_covered_lens_sees_nothing():
    world = uniform_world(stokes=HORIZONTAL, width=3, height=2)
    world.present("dark")
    np.testing.assert_array_equal(world.radiance_behind_polarizer(), np.zeros((2, 3)))


@pytest.mark.parametrize("stage_angle_deg", [0.0, 45.0, 90.0])
def test_flat_is_the_same_at_every_pixel_and_angle(stage_angle_deg):
    stage = Turntable()
    stage.angle_deg = stage_angle_deg
    world = uniform_world(width=3, height=2, polarizer=LEAKY, stage=stage, flat_radiance=10.0)
    world.present("flat")
    # (0.8 + 0.02) / 2 of 10
    np.testing.assert_allclose(world.radiance_behind_polarizer(), 4.1, rtol=1e-15)


def test_scene_comes_back_after_something_else():
    world = uniform_world(stokes=HORIZONTAL, width=1, height=1)
    world.present("dark")
    world.present("scene")
    assert world.radiance_behind_polarizer().item() == pytest.approx(2.0, rel=1e-14)


def test_unknown_subject_is_refused():
    with pytest.raises(ValueError, match="'scene', 'dark' or 'flat'"):
        uniform_world().present("moon")


@pytest.mark.parametrize(
    "change",
    [
        {"transmittance_along": 1.1},
        {"transmittance_across": -0.1},
        {"transmittance_across": 0.9},
        {"transmittance_along": 0.0, "transmittance_across": 0.0},
        {"sense": 0},
        {"offset_deg": float("nan")},
    ],
)
def test_polarizer_that_cannot_be_is_refused(change):
    values = {"transmittance_along": 0.8, "transmittance_across": 0.01, "offset_deg": 0.0, "sense": 1}
    with pytest.raises(ValueError, match=next(iter(change))):
        Polarizer(**{**values, **change})


@pytest.mark.parametrize(
    ("radiance", "message"),
    [
        (np.ones((3, 4)), "has to be"),
        (np.ones((4, 2, 2)), "first axis"),
        (np.ones((3, 2, 2)), "is no light"),
        (np.zeros((3, 2, 2)), "is no light"),
    ],
)
def test_radiance_that_is_no_light_is_refused(radiance, message):
    with pytest.raises(ValueError, match=message):
        World(radiance=radiance, polarizer=PERFECT_POLARIZER, stage_angle_deg=Turntable(), flat_radiance=1.0)


@pytest.mark.parametrize("flat_radiance", [0.0, -1.0, float("inf"), float("nan")])
def test_flat_without_light_is_refused(flat_radiance):
    with pytest.raises(ValueError, match="flat_radiance"):
        uniform_world(flat_radiance=flat_radiance)
