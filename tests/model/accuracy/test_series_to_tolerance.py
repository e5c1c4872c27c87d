"""Series of neighbouring scenes to a tolerance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from model.accuracy.chain import LightStore, Reading, Settings, Value, differences, evaluate, readings
from model.accuracy.errors import Budget
from model.accuracy.predict import Cell, lattice, predict, told_errors
from model.atmosphere.sky import Fidelity, SolverSettings
from model.effects.names import Effect
from model.effects.planner import plan_of_all
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
    found = predict(scenes, tolerance=TOLERANCE)
    assert found.judged < 8
    assert [case.is_judged for case in found.cases][0::13] == [True, True]
    for place in (4,):
        truth = evaluate(scenes[place], _FINE, store=store)
        off = differences(_read(found.cases[place].result), _read(truth))
        for key, error in off.items():
            assert error <= TOLERANCE or key in found.cases[place].not_guaranteed, (place, key)


def test_errors_of_cases_between_are_no_smaller_than_those_of_their_neighbours():
    cases = predict(_series(8), tolerance=TOLERANCE).cases
    place = next(place for place, case in enumerate(cases) if not case.is_judged)
    judged = [k for k, case in enumerate(cases) if case.is_judged]
    nearest = [cases[max(k for k in judged if k < place)], cases[min(k for k in judged if k > place)]]
    between = cases[place]
    for key, error in between.errors.items():
        # A probability may be surer here than there: its error follows how fast it changes.
        if key.quantity not in ("p_detection", "auc"):
            assert error >= max(case.errors.get(key, 0.0) for case in nearest)
        assert error <= TOLERANCE or key in between.not_guaranteed


def test_a_single_scene_is_judged_to_the_whole_tolerance():
    (case,) = predict(_series(1), tolerance=TOLERANCE).cases
    assert case.is_judged
    assert case.tolerance == TOLERANCE


def test_a_tolerance_out_of_range_is_refused():
    with pytest.raises(ValueError, match="allowed is"):
        predict(_series(2), tolerance=0.5)


def test_a_grid_is_judged_at_its_corners_and_keeps_its_order():
    scene = _series(1)[0]
    zeniths, azimuths = np.radians([20.0, 25.0, 30.0]), np.radians([0.0, 5.0, 10.0])
    views = [replace(scene.view, zenith_rad=float(z), azimuth_rad=float(a)) for z in zeniths for a in azimuths]
    found = predict([replace(scene, view=view) for view in views], shape=(3, 3), tolerance=TOLERANCE)
    assert all(found.cases[place].is_judged for place in (0, 2, 6, 8))
    assert found.spot_checks == 1
    for view, case in zip(views, found.cases, strict=True):
        seen = [np.mean([tile.view.zenith_rad for tile in one.lights]) for one in case.result.lights.values()]
        assert np.allclose(seen, view.zenith_rad, atol=np.radians(2.0))


def test_a_probability_that_rises_between_two_judged_cases_has_the_error_of_its_rise():
    corner, middle = (Value(number, 1.0) for number in (0.9, 0.5))
    key = Reading("target on background", "p_detection", "0.01")
    budget = Budget(by_setting={"layers": {key: 1e-4}, "ROC": {}}, total={key: 1e-4})
    told = told_errors([_judged(budget, {key: corner})], {key: middle})
    # The normal deviate of 0.9 is 1.28: there a probability changes by exp(-1.28**2 / 2) of the most.
    assert told[key] == pytest.approx(1.5 * 1e-4 * np.exp(0.5 * 1.2816**2), rel=1e-3)


def test_a_certain_probability_tells_nothing_of_one_that_is_not():
    key = Reading("target on background", "p_detection", "0.01")
    budget = Budget(by_setting={"layers": {}, "ROC": {}}, total={key: 0.0})
    assert told_errors([_judged(budget, {key: Value(1.0, 1.0)})], {key: Value(0.5, 1.0)}) == {}


def _judged(budget, numbers):
    return SimpleNamespace(budget=budget, errors=budget.total, numbers=numbers)


def test_an_effect_is_left_out_of_each_case_only_within_its_own_bound():
    scenes = _series(8)
    allowed = scenes[:5]

    def planned(scene):
        return plan_of_all({Effect.PATH_RADIANCE: not any(scene is one for one in allowed)})

    cases = predict(scenes, tolerance=TOLERANCE, planned=planned).cases
    assert cases[0].left_out == {Effect.PATH_RADIANCE}
    assert all(case.left_out == frozenset() for case in cases[5:])
    assert all(Effect.PATH_RADIANCE in case.result.effects for case in cases if not case.left_out)


def test_a_lattice_covers_a_grid_and_its_cells_are_divided_at_a_case():
    cells = lattice((30, 9))
    assert {place for cell in cells for place in cell.places} == {(i, j) for i in range(30) for j in range(9)}
    assert [part.low for part in Cell(low=(0, 0), high=(4, 4)).divided((2, 0))] == [(0, 0), (2, 0)]
    assert Cell(low=(3,), high=(3,)).corners == ((3,),)
