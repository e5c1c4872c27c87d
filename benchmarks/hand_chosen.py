"""What a promised tolerance costs over the fastest settings that one would choose knowing the truth.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.hand_chosen [SCENE.toml] [--tolerances 1e-2 1e-5]

For each tolerance all knobs are lowered, one level at a time, as long as the true error stays within the tolerance,
each time the one that saves most; from the plan of the prediction and from the finest. Seconds of the processor.
"""

import argparse
import sys
import time
from functools import partial
from pathlib import Path

from model.accuracy.evaluation.chain import ChainResult, evaluate
from model.accuracy.evaluation.quantities import differences, readings
from model.accuracy.planning.numerical_settings import NUMERICAL_SETTINGS, Plan, settings_at
from model.accuracy.predict_to_tolerance import predict
from model.scene.lit_scene import LitScene
from rigctl.files.scene_file import load_scene
from rigctl.prediction.scene_prediction import ScenePredictor

SCENE = Path(__file__).parents[1] / "examples" / "scene-airborne.toml"
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
_REPEATS = 2


def timed(work):
    """Return what a function returns, and the least time of some calls [s]."""
    seconds = []
    for _ in range(_REPEATS):
        start = time.process_time()
        found = work()
        seconds.append(time.process_time() - start)
    return found, min(seconds)


def run(scene: LitScene, plan: Plan, tolerance: float) -> tuple[ChainResult, float]:
    """Evaluate a plan, nothing being kept from before."""
    settings = settings_at(plan, tolerance, face_m=scene.sensor_height_m)
    return timed(partial(evaluate, scene, settings))


def all_readings(result: ChainResult):
    return readings(result.scenario, result.predictions, result.detections)


def largest(result: ChainResult, truth) -> float:
    return max(differences(all_readings(result), truth).values())


def by_hand(scene: LitScene, start: Plan, tolerance: float, truth) -> tuple[dict[str, int], float, float]:
    """Lower knobs while the true error allows it; plan, time and error."""
    plan = dict(start)
    result, seconds = run(scene, plan, tolerance)
    error = largest(result, truth)
    while True:
        tried = []
        for name in NUMERICAL_SETTINGS:
            if plan[name] == 0:
                continue
            lower = {**plan, name: plan[name] - 1}
            result, lower_s = run(scene, lower, tolerance)
            if (found := largest(result, truth)) <= tolerance:
                tried.append((lower_s, found, lower))
        if not tried or min(tried, key=lambda one: one[0])[0] >= seconds:
            return plan, seconds, error
        seconds, error, plan = min(tried, key=lambda one: one[0])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--tolerances", nargs="+", type=float, default=TOLERANCES)
    given = parser.parse_args()
    scene = ScenePredictor(load_scene(given.scene), None).lit_scene()
    finest = {name: len(knob.levels) - 2 for name, knob in NUMERICAL_SETTINGS.items()}
    truth = all_readings(run(scene, finest, 1e-6)[0])
    print(f"{'tolerance':>10} {'promised':>10} {'error':>9} {'by hand':>10} {'error':>9} {'ratio':>6}   plan; by hand")
    for tolerance in given.tolerances:
        found, seconds = timed(partial(predict, scene, tolerance=tolerance))
        error = largest(found.result, truth)
        plan, hand_s, hand_error = by_hand(scene, found.plan, tolerance, truth)
        levels = ["/".join(str(one[name]) for name in NUMERICAL_SETTINGS) for one in (found.plan, plan)]
        numbers = f"{seconds:8.3f} s {error:9.1e} {hand_s:8.3f} s {hand_error:9.1e} {seconds / hand_s:6.2f}"
        print(f"{tolerance:10.0e} {numbers}   {'; '.join(levels)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
