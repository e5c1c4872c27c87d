import numpy as np
import pytest
from scipy.stats import norm

from model.processing.fault_fit import rounded_parts, rounding_error_rms, rounding_offsets


@pytest.mark.parametrize("std", [0.05, 0.2, 0.45])
def test_error_of_a_rounded_mean_is_the_root_mean_square_over_where_it_lies(std: float) -> None:
    means = np.arange(0.0, 1.0, 1e-3) + 5e-4
    steps = np.arange(-6, 8)[:, None]
    shares = norm.cdf(steps + 0.5, means, std) - norm.cdf(steps - 0.5, means, std)
    errors = (shares * steps).sum(axis=0) - means
    assert rounding_error_rms(std) == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-6)


def test_rounding_without_noise_moves_a_level_by_a_step_over_the_root_of_twelve() -> None:
    flat = np.full((4, 64, 64), 7.0)
    offsets = rounding_offsets(flat, np.ones((64, 64), dtype=bool), step=2.0)
    np.testing.assert_allclose(offsets, 2.0 / 12.0**0.5, rtol=0.02)


def test_noise_above_half_a_step_makes_rounding_harmless() -> None:
    noisy = np.rint(np.random.default_rng(5).normal(50.0, 1.0, (4, 64, 64)))
    assert np.all(rounding_offsets(noisy, np.ones((64, 64), dtype=bool), step=1.0) < 1e-3)


def test_pixels_of_the_same_counts_in_all_frames_are_one_part_and_texture_is_no_noise() -> None:
    rows, columns = np.mgrid[:64, :96]
    squares = np.where((rows // 2 + columns // 2) % 2, 80.0, 30.0)
    frames = np.array([squares, squares, squares + 1.0, squares])
    null_basis = 0.5 * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    parts = rounded_parts(frames, np.ones((64, 96), dtype=bool), null_basis=null_basis, step=1.0)
    assert parts is not None
    np.testing.assert_array_equal(parts.numbers, squares == 80.0)
    np.testing.assert_allclose(parts.errors, 12.0**-0.5, rtol=0.02)


def test_frames_with_noise_have_no_parts() -> None:
    frames = np.rint(np.random.default_rng(7).normal(90.0, 0.6, (4, 64, 96)))
    null_basis = 0.5 * np.array([[1.0], [-1.0], [1.0], [-1.0]])
    assert rounded_parts(frames, np.ones((64, 96), dtype=bool), null_basis=null_basis, step=1.0) is None
