"""A scene whose light changes: moments as told, each pixel with a texture of its own that stays."""

import numpy as np
import pytest

from sim_devices.world import RegionLight, TexturedScene

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


def test_what_is_no_region_is_background():
    radiance = scene().painted({"panel": RegionLight(mean=MEAN, cov=COV)})
    assert radiance[:, 0, 0].tolist() == [5.0, 0.0, 0.0]


def test_a_region_without_light_is_refused():
    with pytest.raises(ValueError, match="no light is given of panel"):
        scene().painted({})
