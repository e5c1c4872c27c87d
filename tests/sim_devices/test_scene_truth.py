import numpy as np
import pytest

from sim_devices.world import Rectangle, Region, Surface, paint_scene

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


def test_background_fills_what_no_region_covers():
    radiance = painted(
        regions=[Region(surface=PANEL, where=Rectangle(left=2, top=1, width=3, height=4))],
    )
    assert radiance.shape == (3, 6, 8)
    outside = np.ones((6, 8), dtype=bool)
    outside[1:5, 2:5] = False
    np.testing.assert_array_equal(radiance[:, outside], np.tile([[5.0], [1.0], [0.5]], 48 - 12))


def test_rectangle_is_left_top_width_height_with_rows_from_the_top():
    radiance = painted(
        regions=[Region(surface=PANEL, where=Rectangle(left=2, top=1, width=3, height=4))],
    )
    np.testing.assert_array_equal(np.argwhere(radiance[0] == 20.0)[[0, -1]], [[1, 2], [4, 4]])
    assert np.count_nonzero(radiance[0] == 20.0) == 12


def test_region_may_be_a_mask():
    mask = np.eye(6, 8, dtype=bool)
    radiance = painted(regions=[Region(surface=PANEL, where=mask)])
    np.testing.assert_array_equal(radiance[2] == -3.0, mask)


def test_later_region_covers_earlier_one():
    everywhere = Rectangle(left=0, top=0, width=8, height=6)
    corner = Rectangle(left=0, top=0, width=1, height=1)
    radiance = painted(
        regions=[Region(surface=PANEL, where=everywhere), Region(surface=ASPHALT, where=corner)],
    )
    assert radiance[0, 0, 0] == 5.0
    assert radiance[0, 0, 1] == 20.0


def test_texture_multiplies_the_whole_vector_of_a_pixel():
    radiance = painted(background=Surface(mean_stokes=(20.0, 4.0, -3.0), texture_rms=0.1))
    assert np.ptp(radiance[0]) > 0.0
    # Two multiplications of rounding, eps each.
    np.testing.assert_allclose(radiance[1] / radiance[0], 0.2, rtol=1e-15)
    np.testing.assert_allclose(radiance[2] / radiance[0], -0.15, rtol=1e-15)


def test_texture_has_the_rms_that_was_asked_for():
    radiance = painted(width=400, height=400, background=Surface(mean_stokes=(20.0, 4.0, -3.0), texture_rms=0.1))
    relative = radiance[0] / 20.0
    count = 160_000
    assert abs(relative.mean() - 1.0) < 5 * 0.1 / np.sqrt(count)
    assert abs(relative.std() - 0.1) < 5 * 0.1 / np.sqrt(2 * count)


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


def test_truth_cannot_be_changed_afterwards():
    with pytest.raises(ValueError, match="read-only"):
        painted()[0, 0, 0] = 1.0


def test_fully_polarised_light_is_allowed():
    Surface(mean_stokes=(1.0, 0.6, 0.8))


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


@pytest.mark.parametrize(
    "rectangle",
    [
        Rectangle(left=-1, top=0, width=2, height=2),
        Rectangle(left=7, top=0, width=2, height=2),
        Rectangle(left=0, top=5, width=2, height=2),
        Rectangle(left=0, top=0, width=0, height=2),
    ],
)
def test_rectangle_outside_of_the_picture_is_refused(rectangle):
    with pytest.raises(ValueError, match="8 x 6"):
        painted(regions=[Region(surface=PANEL, where=rectangle)])


def test_mask_of_another_size_is_refused():
    with pytest.raises(ValueError, match="mask has shape"):
        painted(regions=[Region(surface=PANEL, where=np.ones((8, 6), dtype=bool))])
