import numpy as np
import pytest

from model.scene.field import FieldPart, cosine_fourth, whole_field


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


def test_narrow_field_falls_with_the_square_of_its_size():
    # 1 - 2 t with t = x^2 + y^2: over a square of half side a the mean of t is 2 a^2 / 3.
    half = 1e-3
    found = cosine_fourth(whole_field(width_rad=2.0 * half, height_rad=2.0 * half))
    assert 1.0 - found.mean == pytest.approx(4.0 / 3.0 * half**2, rel=1e-5)


def test_mean_is_above_the_limit_that_the_farthest_corner_sets():
    for width in (0.01, 0.3, 1.0):
        part = whole_field(width_rad=width, height_rad=width)
        corner = 2.0 * np.tan(width / 2.0) ** 2
        assert cosine_fourth(part).mean >= 1.0 - 2.0 * corner
