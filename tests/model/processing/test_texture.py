import numpy as np
import pytest

from model.processing.samples import estimate_texture

MEAN = np.array([1000.0, 300.0, -200.0])
NOISE = np.array([[400.0, 50.0, 0.0], [50.0, 700.0, 20.0], [0.0, 20.0, 650.0]])
NONE = np.zeros((3, 3))


def _pixels(rng, *, texture, repeats, count=20_000):
    light = MEAN[:, None] + np.linalg.cholesky(texture + 1e-9 * np.eye(3)) @ rng.normal(size=(3, count))
    noise = np.linalg.cholesky(NOISE) @ rng.normal(size=(3, count)) / np.sqrt(repeats)
    return light + noise


def test_known_texture_is_found_within_its_error():
    texture = np.diag([900.0, 100.0, 60.0])
    found = estimate_texture(
        _pixels(np.random.default_rng(1), texture=texture, repeats=4), NOISE, repeats=4, pattern_cov=NONE
    )
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


def test_the_fixed_pattern_is_taken_off_too():
    texture, pattern = np.diag([500.0, 50.0, 50.0]), np.diag([300.0, 10.0, 10.0])
    pixels = _pixels(np.random.default_rng(4), texture=texture + pattern, repeats=4)
    found = estimate_texture(pixels, NOISE, repeats=4, pattern_cov=pattern)
    assert np.all(np.abs(found.cov - texture) < 4 * found.std_error)


def test_noise_that_explains_more_than_the_spread_is_repaired_and_said():
    found = estimate_texture(
        _pixels(np.random.default_rng(5), texture=NONE, repeats=1), 1.2 * NOISE, repeats=1, pattern_cov=NONE
    )
    assert np.all(np.linalg.eigvalsh(found.cov) >= -1e-9 * np.trace(NOISE))
    assert found.removed_variance > 0
    assert "set to zero" in found.remark


def test_a_sound_estimate_has_no_remark():
    found = estimate_texture(
        _pixels(np.random.default_rng(6), texture=np.diag([900.0, 900.0, 900.0]), repeats=4), NOISE, repeats=4,
        pattern_cov=NONE,
    )  # fmt: skip
    assert found.remark == ""


@pytest.mark.parametrize(("shape", "repeats"), [((3, 3), 1), ((3,), 1), ((3, 10), 0)])
def test_what_cannot_give_a_covariance_is_refused(shape, repeats):
    with pytest.raises(ValueError, match="pixels_of_mean"):
        estimate_texture(np.ones(shape), NOISE, repeats=repeats, pattern_cov=NONE)
