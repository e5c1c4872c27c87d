"""Shares of noise: of a unit and of as much as is asked for, and of nothing where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest

from model.effects.bounds import light_limits, radiance_bounds
from tests.model.effects.scenes import panel_scene


@pytest.fixture(scope="module")
def bounds():
    scene = panel_scene()
    limits, region = light_limits(scene), scene.regions[0]
    return radiance_bounds(scene, region, limits[region.name])


def test_shares_are_as_much_larger_as_what_has_them(bounds):
    assert bounds.temporal_share(3.0 * np.ones_like(bounds.signal_low)) == pytest.approx(3.0 * bounds.share_of_noise)
    light = bounds.spatial_share(bounds.to_channels(5.0 * np.eye(3)), is_part=False)
    assert light == pytest.approx(5.0 * bounds.share_of_light)


def test_nothing_has_no_share_even_of_what_has_no_limit(bounds):
    unknown = replace(bounds, variance_low=np.full_like(bounds.variance_low, np.inf))
    assert unknown.temporal_share(np.zeros_like(bounds.signal_low)) == 0.0
    assert unknown.temporal_share(np.ones_like(bounds.signal_low)) == np.inf
