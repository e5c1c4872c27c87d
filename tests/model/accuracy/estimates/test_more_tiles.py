from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.chain import evaluate
from model.accuracy.errors import Asked, on_more_tiles
from model.accuracy.plan import HEMISPHERE, NUMERICAL_SETTINGS, settings_at
from tests.model.accuracy.random_scenes import random_scene

# A target before a background that fills 20 by 16 deg of the field; two points.
WIDE, POINTS = 14, 4
PLAN = {**dict.fromkeys(NUMERICAL_SETTINGS, 0), HEMISPHERE: 5}


def settings(tiles_per_side):
    return replace(settings_at(PLAN, 1e-3), tiles_per_side=tiles_per_side)


@pytest.mark.parametrize("per_side", [3, 4])
def test_what_one_more_tile_changes_is_what_the_tiles_miss(per_side):
    scene = random_scene(WIDE)
    result = evaluate(scene, settings(per_side))
    finest = {one.name: one for one in evaluate(scene, settings(9)).scenario.regions}
    wide = [one for one in result.scenario.regions if len(result.lights[one.name].lights) > 1]
    assert wide
    for own in wide:
        more = on_more_tiles([Asked(scene, result, own.name)])[0]
        for moment in ("stokes_radiance", "field_cov"):
            true = np.max(np.abs(getattr(finest[own.name], moment) - getattr(own, moment)))
            found = np.max(np.abs(getattr(more, moment) - getattr(own, moment)))
            # What one more tile still misses is a tenth of it, or less.
            assert found == pytest.approx(true, rel=0.11), (own.name, moment)


def test_several_are_as_each_alone():
    scene = random_scene(WIDE)
    other = replace(scene, view=replace(scene.view, zenith_rad=scene.view.zenith_rad + 0.1))
    asked = [Asked(one, evaluate(one, settings(3)), region.name) for one in (scene, other) for region in one.regions]
    for one, found in zip(asked, on_more_tiles(asked), strict=True):
        (alone,) = on_more_tiles([one])
        if alone is None:
            assert found is None
        else:
            np.testing.assert_allclose(found.stokes_radiance, alone.stokes_radiance, rtol=1e-12)


def test_a_point_has_no_more_tiles():
    scene = random_scene(POINTS)
    result = evaluate(scene, settings(3))
    assert set(on_more_tiles([Asked(scene, result, name) for name in result.lights])) == {None}


def test_light_that_is_given_has_none():
    scene = random_scene(WIDE)
    result = replace(evaluate(scene, settings(3)), illumination=None)
    with pytest.raises(ValueError, match="nothing to compute"):
        on_more_tiles([Asked(scene, result, next(iter(result.lights)))])
