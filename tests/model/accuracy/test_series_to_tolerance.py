"""Series of neighbouring scenes to a tolerance."""

from dataclasses import replace

import numpy as np
import pytest

from model.accuracy.evaluation.chain import evaluate
from model.accuracy.evaluation.light_store import LightStore
from model.accuracy.evaluation.quantities import differences, readings
from model.accuracy.evaluation.settings import Settings
from model.accuracy.predict_to_tolerance import predict
from model.accuracy.series_to_tolerance import predict_series
from model.atmosphere.lighting.fidelity import Fidelity, SolverSettings
from tests.model.accuracy.random_scenes import random_scene

TOLERANCE = 0.01
_FINE = Settings(
    wavelengths=5,
    split_at_kinks=True,
    solver=SolverSettings(
        fine_layers=True, nodes=8, element_depth=0.1, tolerance=1e-6, matrix_tolerance=1e-3, extrapolated=True
    ),
    sky_zeniths=24,
    sky_azimuths=20,
    hemisphere_tolerance=1e-5,
    tiles_per_side=6,
    negligible_spread=0.0,
)


def _series(count):
    """Views of one scene, from 20 to 50 deg, by light scattered once: no solution, no time."""
    scene = random_scene(3)
    air = replace(scene.air, fidelity=Fidelity.SINGLE)
    zeniths = np.radians(np.linspace(20.0, 50.0, count))
    return [replace(scene, air=air, view=replace(scene.view, zenith_rad=float(zenith))) for zenith in zeniths]


def _read(result):
    return readings(result.scenario, result.predictions, result.detections)


def test_a_series_keeps_its_tolerance_though_few_cases_are_judged():
    scenes, store = _series(14), LightStore()
    found = predict_series(scenes, tolerance=TOLERANCE)
    assert found.judged < 8
    assert [case.is_judged for case in found.cases][0::13] == [True, True]
    for place in (4,):
        truth = evaluate(scenes[place], _FINE, store=store)
        off = differences(_read(found.cases[place].result), _read(truth))
        for key, error in off.items():
            assert error <= TOLERANCE or key in found.cases[place].not_guaranteed, (place, key)


def test_errors_of_cases_between_are_no_smaller_than_those_of_their_neighbours():
    cases = predict_series(_series(8), tolerance=TOLERANCE).cases
    place = next(place for place, case in enumerate(cases) if not case.is_judged)
    judged = [k for k, case in enumerate(cases) if case.is_judged]
    nearest = [cases[max(k for k in judged if k < place)], cases[min(k for k in judged if k > place)]]
    between = cases[place]
    for key, error in between.errors.items():
        assert error >= max(case.errors.get(key, 0.0) for case in nearest)
        assert error <= TOLERANCE or key in between.not_guaranteed


def test_one_scene_is_a_series():
    (scene,) = _series(1)
    (case,) = predict_series([scene], tolerance=TOLERANCE).cases
    alone = predict(scene, tolerance=0.5 * TOLERANCE)
    assert case.is_judged
    assert _read(case.result) == _read(alone.result)


def test_a_tolerance_out_of_range_is_refused():
    with pytest.raises(ValueError, match="allowed is"):
        predict_series(_series(2), tolerance=0.5)
