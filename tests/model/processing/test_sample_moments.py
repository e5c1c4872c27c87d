import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.processing import samples as sm

# Scores of REPEATS independent samples: their mean has the standard error 1 / sqrt(REPEATS), their variance
# sqrt(2 / REPEATS) for normal scores. Five of these are allowed; the seeds are fixed.
REPEATS = 400


def _assert_standard_normal(scores):
    scores = np.asarray(scores)
    assert abs(scores.mean()) < 5 / np.sqrt(REPEATS)
    assert abs(scores.var() - 1) < 5 * np.sqrt(2 / REPEATS)


def test_error_of_a_mean_covers_at_its_rate():
    rng = np.random.default_rng(1)
    found = [sm.mean_moments(rng.exponential(2.0, (1, 500))) for _ in range(REPEATS)]
    _assert_standard_normal([(m.mean[0] - 2.0) / np.sqrt(m.cov[0, 0]) for m in found])


def test_error_of_a_deviation_covers_at_its_rate_without_a_normal_law():
    # Uniform numbers have kurtosis 1.8: the error of a normal law, s / sqrt(2 P), would be 58 % too large.
    rng = np.random.default_rng(2)
    found = [sm.deviation(rng.uniform(0.0, np.sqrt(12.0), 2000)) for _ in range(REPEATS)]
    _assert_standard_normal([(s.value - 1.0) / s.std_error for s in found])


def test_error_of_a_temporal_deviation_covers_although_differences_share_frames():
    rng = np.random.default_rng(3)
    pattern = rng.normal(0.0, 20.0, 1500)
    found = [sm.temporal_deviation(pattern + rng.normal(100.0, 3.0, (6, 1500))) for _ in range(REPEATS)]
    _assert_standard_normal([(s.value - 3.0) / s.std_error for s in found])


def test_temporal_deviation_does_not_see_flicker_common_to_all_pixels():
    rng = np.random.default_rng(4)
    flicker = np.array([[0.0], [50.0], [-30.0], [10.0]])
    noise = rng.normal(0.0, 2.0, (4, 20_000))
    with_flicker, without = sm.temporal_deviation(noise + flicker), sm.temporal_deviation(noise)
    assert with_flicker.value == pytest.approx(without.value, rel=1e-12)


def test_error_of_mean_over_deviation_covers_at_its_rate():
    rng = np.random.default_rng(5)
    # Gamma with shape 9: mean over deviation is 3, and mean and deviation are correlated by its skewness.
    found = [sm.mean_over_deviation(rng.gamma(9.0, 1.0, 3000)) for _ in range(REPEATS)]
    _assert_standard_normal([(s.value - 3.0) / s.std_error for s in found])


def test_independent_pixels_count_in_full():
    rng = np.random.default_rng(6)
    inside = np.zeros((80, 90), dtype=bool)
    inside[5:75, 10:80] = True
    assert sm.effective_pixels(rng.normal(size=inside.shape), inside) == inside.sum()


def test_pixels_in_equal_squares_count_once_a_square():
    rng = np.random.default_rng(7)
    inside = np.ones((320, 320), dtype=bool)
    squares = np.kron(rng.normal(size=(80, 80)), np.ones((4, 4)))
    # 6400 independent squares; the variance of 400 block means is known to sqrt(2 / 399) = 7 %, five of them 35 %.
    assert sm.effective_pixels(squares, inside) == pytest.approx(6400, rel=0.35)


def test_a_small_region_is_worth_what_its_correlations_say():
    inside = np.ones((64, 64), dtype=bool)
    squares = np.kron(np.random.default_rng(9).normal(size=(16, 16)), np.ones((4, 4)))
    # 256 independent squares: correlations up to 4 pixels are known to a fifth or so.
    assert sm.effective_pixels(squares, inside) == pytest.approx(256, rel=0.5)


def test_texture_widens_what_channels_share_and_not_their_ratio():
    rng = np.random.default_rng(10)
    inside = np.ones((64, 64), dtype=bool)
    texture = np.kron(rng.normal(size=(16, 16)), np.ones((4, 4))).ravel()
    channels = 100.0 + 10.0 * texture + rng.normal(size=(2, texture.size))
    found = sm.region_mean_moments(channels, inside).cov
    plain = sm.mean_moments(channels).cov
    assert found[0, 0] / plain[0, 0] == pytest.approx(16.0, rel=0.5)
    difference = np.array([1.0, -1.0])
    assert difference @ found @ difference == pytest.approx(difference @ plain @ difference, rel=0.1)


def test_a_constant_image_is_no_correlation():
    assert sm.effective_pixels(np.ones((40, 40)), np.ones((40, 40), dtype=bool)) == 1600


@given(shift=st.floats(-1e6, 1e6), scale=st.floats(1e-3, 1e3))
@settings(deadline=None, max_examples=40)
def test_deviation_follows_the_scale_and_not_the_shift(shift, scale):
    values = np.random.default_rng(8).normal(size=200)
    plain, changed = sm.deviation(values), sm.deviation(shift + scale * values)
    # The shift costs the digits that it is larger than the spread.
    tolerance = 1e-12 + 1e-14 * abs(shift) / scale
    assert changed.value == pytest.approx(scale * plain.value, rel=tolerance)


def test_one_repeat_has_no_temporal_deviation():
    with pytest.raises(ValueError, match="at least 2"):
        sm.temporal_deviation(np.ones((1, 50)))


def test_equal_values_have_no_signal_to_noise_ratio():
    with pytest.raises(ValueError, match="all equal"):
        sm.mean_over_deviation(np.full(50, 3.0))


def test_numbers_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="not finite"):
        sm.deviation(np.array([1.0, 2.0, np.nan, 4.0]))
