"""Standard errors from the pixels of a region cover at their rate; texture."""

import numpy as np
import pytest

from model.processing import samples as sm
from model.processing.samples import estimate_texture

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


def _temporal(repeats):
    return sm.repeated(repeats[:, None, :], np.ones((3, 1))).temporal[0]


def test_error_of_a_temporal_deviation_covers_although_differences_share_frames():
    rng = np.random.default_rng(3)
    pattern = rng.normal(0.0, 20.0, 1500)
    found = [_temporal(pattern + rng.normal(100.0, 3.0, (6, 1500))) for _ in range(REPEATS)]
    _assert_standard_normal([(s.value - 3.0) / s.std_error for s in found])


def test_temporal_deviation_does_not_see_flicker_common_to_all_pixels():
    rng = np.random.default_rng(4)
    flicker = np.array([[0.0], [50.0], [-30.0], [10.0]])
    noise = rng.normal(100.0, 2.0, (4, 20_000))
    assert _temporal(noise + flicker).value == pytest.approx(_temporal(noise).value, rel=1e-12)


def test_noise_that_neighbours_share_is_in_the_error_of_its_deviation():
    rng = np.random.default_rng(11)
    inside = np.ones((32, 32), dtype=bool)
    scores = []
    for _ in range(60):
        # Squares of 2 x 2 pixels alike: a quarter of the pixels.
        noise = np.kron(rng.normal(100.0, 3.0, (4, 1, 16, 16)), np.ones((2, 2))).reshape(4, 1, -1)
        found = sm.repeated(noise, np.ones((3, 1)), inside=inside).temporal[0]
        scores.append((found.value - 3.0) / found.std_error)
    # Counted in full the variance would be four; 60 scores know theirs to 18 %.
    assert 0.5 < np.var(scores) < 1.8


def test_light_that_drifts_is_divided_out_with_an_error_that_covers():
    times = np.arange(6)[:, None] + np.arange(4) / 4.0
    scores = []
    rng = np.random.default_rng(13)
    for _ in range(60):
        light = 1.0 + 0.003 * (times - times.mean())
        pixels = 1000.0 * light[:, :, None] + rng.normal(0.0, 20.0, (6, 4, 400))
        found = sm.repeated(pixels, np.ones((3, 4)), times=times)
        cov = np.diag(np.full(4, 400.0 / 2400.0)) + found.repeatability.cov(found.mean.mean(axis=1))
        difference = np.array([1.0, 1.0, -1.0, -1.0])
        scores.append(difference @ found.mean.mean(axis=1) / np.sqrt(difference @ cov @ difference))
        assert found.repeatability.drift == pytest.approx(0.003, abs=5 * 0.0025 / np.sqrt(17.5 * 4))
    # Undivided, the first two angles are 1.5 above the last two, which is two errors or more.
    assert abs(np.mean(scores)) < 4.0 / np.sqrt(60.0)
    assert 0.5 < np.var(scores) < 1.8


def test_error_of_mean_over_deviation_covers_at_its_rate():
    rng = np.random.default_rng(5)
    # Gamma with shape 9: mean over deviation is 3, and mean and deviation are correlated by its skewness.
    found = [sm.mean_over_deviation(rng.gamma(9.0, 1.0, 3000)) for _ in range(REPEATS)]
    _assert_standard_normal([(s.value - 3.0) / s.std_error for s in found])


@pytest.mark.parametrize(
    ("side", "square", "allowed"),
    # The variance of 400 block means is known to sqrt(2 / 399) = 7 %, correlations up to 4 pixels to a fifth or so.
    [(70, 1, 0.0), (320, 4, 0.35), (64, 4, 0.5)],
    ids=["independent", "large", "small"],
)
def test_pixels_in_equal_squares_count_once_a_square(side, square, allowed):
    squares = np.kron(np.random.default_rng(7).normal(size=(side // square,) * 2), np.ones((square, square)))
    image, inside = np.pad(squares, 5), np.pad(np.ones((side, side), dtype=bool), 5)
    assert sm.effective_pixels(image, inside) == pytest.approx((side // square) ** 2, rel=allowed)


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


def test_texture_that_is_fainter_than_the_noise_is_seen():
    rng = np.random.default_rng(12)
    inside = np.ones((64, 64), dtype=bool)
    alike = []
    for _ in range(20):
        texture = np.kron(rng.normal(size=(16, 16)), np.ones((4, 4)))
        alike.append(4096.0 / sm.effective_pixels(0.35 * texture + rng.normal(size=(64, 64)), inside))
    # By definition 1 + 15 * 0.35^2 / (1 + 0.35^2).
    assert np.mean(alike) == pytest.approx(2.6, rel=0.2)
    assert min(alike) > 1.3


MEAN = np.array([1000.0, 300.0, -200.0])
NOISE = np.array([[400.0, 50.0, 0.0], [50.0, 700.0, 20.0], [0.0, 20.0, 650.0]])
NONE = np.zeros((3, 3))


def _pixels(rng, *, texture, repeats, count=20_000):
    light = MEAN[:, None] + np.linalg.cholesky(texture + 1e-9 * np.eye(3)) @ rng.normal(size=(3, count))
    noise = np.linalg.cholesky(NOISE) @ rng.normal(size=(3, count)) / np.sqrt(repeats)
    return light + noise


@pytest.mark.parametrize("pattern", [NONE, np.diag([300.0, 10.0, 10.0])], ids=["texture", "texture and fixed pattern"])
def test_known_texture_is_found_within_its_error(pattern):
    texture = np.diag([900.0, 100.0, 60.0])
    pixels = _pixels(np.random.default_rng(1), texture=texture + pattern, repeats=4)
    found = estimate_texture(pixels, NOISE, repeats=4, pattern_cov=pattern)
    # Nine elements, five of them distinct off the diagonal: the largest of six scores stays below 4.
    assert np.all(np.abs(found.cov - texture) < 4 * found.std_error)


def test_errors_cover_at_their_rate():
    texture = np.diag([900.0, 100.0, 60.0])
    rng = np.random.default_rng(2)
    found = [
        estimate_texture(_pixels(rng, texture=texture, repeats=2, count=800), NOISE, repeats=2, pattern_cov=NONE)
        for _ in range(200)
    ]
    z = np.array([(t.cov[0, 0] - 900.0) / t.std_error[0, 0] for t in found])
    # 200 scores: the standard error of their mean is 0.07, of their variance 0.1; five of each.
    assert abs(z.mean()) < 5 * 0.07
    assert abs(z.var() - 1) < 5 * 0.1


def test_a_common_factor_is_of_rank_one_with_its_rms():
    texture = 0.02**2 * np.outer(MEAN, MEAN)
    found = estimate_texture(
        _pixels(np.random.default_rng(3), texture=texture, repeats=16), NOISE, repeats=16, pattern_cov=NONE
    )
    assert found.rank_one_share > 0.95
    # Relative error of an rms from 20 000 pixels: 1 / sqrt(40 000) = 0.5 %, and the noise adds a tenth: five of them.
    assert found.common_factor_rms == pytest.approx(0.02, rel=0.03)


def test_noise_that_explains_more_than_the_spread_is_repaired_and_said():
    found = estimate_texture(
        _pixels(np.random.default_rng(5), texture=NONE, repeats=1), 1.2 * NOISE, repeats=1, pattern_cov=NONE
    )
    assert np.all(np.linalg.eigvalsh(found.cov) >= -1e-9 * np.trace(NOISE))
    assert found.removed_variance > 0
    assert "set to zero" in found.remark


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: estimate_texture(np.ones((3, 3)), NOISE, repeats=1, pattern_cov=NONE), "pixels_of_mean"),
        (lambda: estimate_texture(np.ones((3, 10)), NOISE, repeats=0, pattern_cov=NONE), "pixels_of_mean"),
        (lambda: sm.mean_over_deviation(np.full(50, 3.0)), "all equal"),
        (lambda: sm.deviation(np.array([1.0, 2.0, np.nan, 4.0])), "not finite"),
    ],
)
def test_values_without_a_result_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
