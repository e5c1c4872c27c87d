"""The world before a simulated camera: polarizer, scenes that are drawn once, scenes whose light changes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_devices.world import Polarizer, RegionLight, Surface, TexturedScene, World, paint_scene
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
        (np.ones((3, 4)), "must be"),
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


PANEL = Surface(mean_stokes=(20.0, 4.0, -3.0))


ASPHALT = Surface(mean_stokes=(5.0, 1.0, 0.5))


def painted(*, width=8, height=6, background=ASPHALT, regions=(), seed=1):
    return paint_scene(
        width=width,
        height=height,
        background=background,
        regions=regions,
        generator=np.random.default_rng(seed),
    )


def test_a_later_region_covers_an_earlier_one_and_both_the_background():
    inside, corner = np.zeros((6, 8), dtype=bool), np.zeros((6, 8), dtype=bool)
    inside[1:5, 2:5], corner[1, 2] = True, True
    radiance = painted(regions=[(PANEL, inside), (Surface(mean_stokes=(7.0, 0.0, 0.0)), corner)])
    assert radiance.shape == (3, 6, 8)
    assert radiance[:, 1, 2].tolist() == [7.0, 0.0, 0.0]
    np.testing.assert_array_equal(radiance[2] == -3.0, inside & ~corner)
    np.testing.assert_array_equal(radiance[:, ~inside], np.tile([[5.0], [1.0], [0.5]], 48 - 12))


def test_texture_multiplies_the_whole_vector_of_a_pixel():
    radiance = painted(background=Surface(mean_stokes=(20.0, 4.0, -3.0), texture_rms=0.1))
    assert np.ptp(radiance[0]) > 0.0
    # Two multiplications of rounding, eps each.
    np.testing.assert_allclose(radiance[1] / radiance[0], 0.2, rtol=1e-15)
    np.testing.assert_allclose(radiance[2] / radiance[0], -0.15, rtol=1e-15)


def test_extra_covariance_and_texture_add_up():
    extra = np.array([[0.5, 0.2, 0.0], [0.2, 0.3, -0.1], [0.0, -0.1, 0.4]])
    surface = Surface(mean_stokes=(20.0, 4.0, -3.0), texture_rms=0.02, extra_covariance=extra)
    radiance = painted(width=400, height=400, background=surface)
    sample = np.cov(radiance.reshape(3, -1))
    # 0.02^2 = 0.0004 times (20, 4, -3) (20, 4, -3)', plus `extra`.
    expected = np.array([[0.66, 0.232, -0.024], [0.232, 0.3064, -0.1048], [-0.024, -0.1048, 0.4036]])
    diagonal = np.diag(expected)
    # Normal law: var of s_ij is (s_ii s_jj + s_ij^2) / n.
    std_error = np.sqrt((np.outer(diagonal, diagonal) + expected**2) / 160_000)
    assert np.all(np.abs(sample - expected) < 5 * std_error)


def test_singular_extra_covariance_is_drawn():
    only_s1 = np.diag([0.0, 0.25, 0.0])
    radiance = painted(background=Surface(mean_stokes=(20.0, 4.0, -3.0), extra_covariance=only_s1))
    assert np.ptp(radiance[1]) > 0.0
    np.testing.assert_array_equal(radiance[0], 20.0)


def test_same_seed_gives_the_same_scene():
    rough = Surface(mean_stokes=(20.0, 4.0, -3.0), texture_rms=0.1)
    np.testing.assert_array_equal(painted(background=rough, seed=4), painted(background=rough, seed=4))
    assert not np.array_equal(painted(background=rough, seed=4), painted(background=rough, seed=5))


@pytest.mark.parametrize(
    "mean_stokes",
    [(0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 0.8, 0.7), (float("nan"), 0.0, 0.0), (float("inf"), 0.0, 0.0)],
)
def test_mean_that_is_no_light_is_refused(mean_stokes):
    with pytest.raises(ValueError, match=r"mean_stokes.*is no light"):
        Surface(mean_stokes=mean_stokes)


@pytest.mark.parametrize("texture_rms", [-0.1, float("nan"), float("inf")])
def test_texture_that_is_no_spread_is_refused(texture_rms):
    with pytest.raises(ValueError, match="texture_rms"):
        Surface(mean_stokes=(1.0, 0.0, 0.0), texture_rms=texture_rms)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.diag([1.0, -0.5, 1.0]), "eigenvalue of -0.5"),
        (np.triu(np.ones((3, 3))), "symmetric"),
        (np.eye(2), "shape"),
        (np.diag([np.inf, 1.0, 1.0]), "finite"),
    ],
)
def test_matrix_that_is_no_covariance_is_refused(covariance, message):
    with pytest.raises(ValueError, match=message):
        Surface(mean_stokes=(10.0, 0.0, 0.0), extra_covariance=covariance)


def test_pixels_drawn_dark_below_zero_are_refused_and_not_cut():
    with pytest.raises(ValueError, match="make texture_rms or extra_covariance smaller"):
        painted(width=100, height=100, background=Surface(mean_stokes=(1.0, 0.0, 0.0), texture_rms=1.0))


def test_pixels_drawn_beyond_full_polarisation_are_refused():
    nearly_full = Surface(mean_stokes=(1.0, 0.99, 0.0), extra_covariance=np.diag([0.0, 0.01, 0.01]))
    with pytest.raises(ValueError, match="is no light"):
        painted(width=100, height=100, background=nearly_full)


def test_mask_of_another_size_is_refused():
    with pytest.raises(ValueError, match="mask has shape"):
        painted(regions=[(PANEL, np.ones((8, 6), dtype=bool))])


MEAN = np.array([10.0, 3.0, -1.0])


COV = 1e-4 * np.outer(MEAN, MEAN) + np.diag([1e-3, 2e-3, 0.0])


def scene(seed: int = 1) -> TexturedScene:
    mask = np.zeros((100, 120), dtype=np.bool_)
    mask[10:90, 10:110] = True
    generator = np.random.default_rng(seed)
    return TexturedScene(masks={"panel": mask}, background_radiance=5.0, shape=mask.shape, generator=generator)


def pixels(radiance):
    return radiance[:, 10:90, 10:110].reshape(3, -1)


def test_the_moments_are_those_that_were_told():
    drawn = pixels(scene().painted({"panel": RegionLight(mean=MEAN, cov=COV)}))
    n = drawn.shape[1]
    assert np.all(np.abs(drawn.mean(axis=1) - MEAN) < 4.0 * np.sqrt(np.diag(COV) / n))
    scale = np.sqrt(np.outer(np.diag(COV), np.diag(COV)))
    assert np.all(np.abs(np.cov(drawn) - COV) < 4.0 * np.sqrt(2.0 / n) * scale)


def test_brighter_light_makes_every_pixel_brighter_in_proportion():
    seen = scene()
    before, after = (pixels(seen.painted({"panel": RegionLight(mean=f * MEAN, cov=f**2 * COV)})) for f in (1.0, 1.3))
    assert after == pytest.approx(1.3 * before, rel=1e-12)


def test_a_region_without_light_is_refused():
    with pytest.raises(ValueError, match="no light is given for panel"):
        scene().painted({})
