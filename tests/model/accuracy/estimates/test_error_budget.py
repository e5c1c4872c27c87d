from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.estimates.error_budget import error_budget, on_more_tiles
from model.accuracy.estimates.light_error import LightError
from model.accuracy.evaluation.chain import evaluate
from model.accuracy.evaluation.quantities import Reading
from model.accuracy.planning.numerical_settings import HEMISPHERE, NUMERICAL_SETTINGS, STREAMS, settings_at
from model.prediction.prediction import predict
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
        more = on_more_tiles(scene, result, own.name)
        for moment in ("stokes_radiance", "field_cov"):
            true = np.max(np.abs(getattr(finest[own.name], moment) - getattr(own, moment)))
            found = np.max(np.abs(getattr(more, moment) - getattr(own, moment)))
            # What one more tile still misses is a tenth of it, or less.
            assert found == pytest.approx(true, rel=0.11), (own.name, moment)


def test_a_point_has_no_more_tiles():
    scene = random_scene(POINTS)
    result = evaluate(scene, settings(3))
    assert all(on_more_tiles(scene, result, name) is None for name in result.lights)


def test_light_that_is_given_has_none():
    scene = random_scene(WIDE)
    result = replace(evaluate(scene, settings(3)), illumination=None)
    with pytest.raises(ValueError, match="nothing to compute"):
        on_more_tiles(scene, result, next(iter(result.lights)))


def test_what_exists_by_a_hair_is_not_promised_where_the_light_may_be_less():
    scene = random_scene(POINTS)
    result = evaluate(scene, settings(3))
    region = result.scenario.regions[0]

    def of(factor):
        sensor = replace(result.scenario.sensor, exposure_s=factor * result.scenario.sensor.exposure_s)
        scenario = replace(result.scenario, sensor=sensor)
        return replace(
            result, scenario=scenario, predictions=predict(scenario, tolerance=result.settings.dolp_tolerance)
        )

    def exists(factor):
        return "dolp_pixels" in of(factor).predictions[region.name].quantities

    long, short = 1.0, 1e-6
    assert exists(long)
    assert not exists(short)
    while long > 1.001 * short:
        middle = np.sqrt(long * short)
        long, short = (middle, short) if exists(middle) else (long, middle)

    mean = Reading(region.name, "dolp_pixels", "mean")
    for share, is_promised in ((1e-2, False), (1e-5, True)):
        off = share * region.stokes_radiance[0]
        error = LightError(together=np.zeros((0, 3)), apart=np.array([off, 0.0, 0.0]), field=np.zeros(3))
        budget = error_budget(scene, of(1.0005 * long), {STREAMS: {region.name: error}}, tolerance=1e-2, tiles=False)
        assert np.isfinite(budget.total[mean]) == is_promised
