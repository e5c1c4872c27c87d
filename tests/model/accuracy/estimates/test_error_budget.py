from dataclasses import replace

import numpy as np

from model.accuracy.chain import Reading, evaluate
from model.accuracy.errors import LightError, error_budget
from model.accuracy.plan import NUMERICAL_SETTINGS, STREAMS, settings_at
from model.prediction import predict
from tests.model.accuracy.random_scenes import random_scene

# Two points.
POINTS = 4


def test_what_exists_by_a_hair_is_not_promised_where_the_light_may_be_less():
    scene = random_scene(POINTS)
    result = evaluate(scene, settings_at(dict.fromkeys(NUMERICAL_SETTINGS, 0), 1e-3))
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
