import numpy as np
import pytest

from model.processing.diagnosis.rounding import rounded_moments, rounded_parts, rounding_error_rms, rounding_offsets


@pytest.mark.parametrize(("mean", "std"), [(1.3, 0.05), (0.5, 0.2), (10.7, 0.4), (3.0, 2.5)])
def test_moments_of_rounded_numbers_are_those_of_draws(mean: float, std: float) -> None:
    drawn = np.rint(np.random.default_rng(3).normal(mean, std, 400_000))
    found_mean, found_variance = rounded_moments(mean, std)
    spread = max(float(drawn.std()), 1e-3)
    assert found_mean == pytest.approx(drawn.mean(), abs=5.0 * spread / 400_000**0.5)
    assert found_variance == pytest.approx(drawn.var(), abs=5.0 * 2.0 * spread / 400_000**0.5)


def test_error_of_a_rounded_mean_is_the_root_mean_square_over_where_it_lies() -> None:
    means = np.arange(0.0, 1.0, 1e-3) + 5e-4
    for std in (0.05, 0.2, 0.45):
        errors = rounded_moments(means, np.full(means.shape, std))[0] - means
        assert rounding_error_rms(std) == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.02)


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
