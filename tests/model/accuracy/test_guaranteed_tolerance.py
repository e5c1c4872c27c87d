"""Guaranteed tolerances are kept: few of the scenes of `benchmarks.trials.tolerance`."""

import pytest

from model.accuracy.chain import differences, evaluate, readings
from model.accuracy.plan import HEMISPHERE, LAYERS, SKY_GRID, STREAMS, TILES, WAVELENGTHS, settings_at
from model.accuracy.predict import predict
from tests.model.accuracy.random_scenes import hostile_scene, random_scene

FINER = {STREAMS: 4, LAYERS: 3, WAVELENGTHS: 6, SKY_GRID: 2, HEMISPHERE: 4, TILES: 5}


@pytest.mark.parametrize("tolerance", [0.1, 0.01])
# Seeds whose finer evaluation is cheap; the trial takes all.
@pytest.mark.parametrize(
    ("make_scene", "seed"),
    [
        (random_scene, 0),
        (random_scene, 8),
        (random_scene, 21),
        (hostile_scene, 4),
        (hostile_scene, 9),
        (hostile_scene, 14),
    ],
)
def test_every_number_that_is_promised_keeps_the_tolerance_and_the_estimate_is_above_the_error(
    make_scene, seed, tolerance
):
    scene = make_scene(seed)
    (found,) = predict([scene], tolerance=tolerance).cases
    # With the tolerance of the law of DoLP, on which it depends whether there are moments.
    finer = evaluate(scene, settings_at(FINER, tolerance, face_m=scene.sensor_height_m))
    own, true = (readings(one.scenario, one.predictions, one.detections) for one in (found.result, finer))
    promised = {key: error for key, error in differences(own, true).items() if key not in found.not_guaranteed}
    assert promised
    worst = max(promised, key=promised.get)
    assert promised[worst] <= tolerance, worst
    assert max(found.budget.total[key] for key in promised) > promised[worst]
