"""What a promised tolerance costs over the fastest settings that one would choose knowing the truth.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.hand_chosen [SCENE.toml] [--tolerances 1e-2 1e-5]
        [--sweep geometry.camera_zenith_deg=10:60:100]

For each tolerance all knobs are lowered, one level at a time, as long as the true error stays within the tolerance,
each time the one that saves most; from the plan of the prediction. Of a sweep all cases have one plan, are evaluated
together by rules of the hemisphere integral that suffice at its ends and in its middle, and the error is that of ten of
them. Seconds of the processor.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from model.accuracy.chain import ChainResult, LightStore, differences, evaluate, evaluate_all, readings
from model.accuracy.plan import NUMERICAL_SETTINGS, Plan, settings_at
from model.accuracy.predict import Predictions, predict
from model.scene.field import known_rules
from model.scene.scene import LitScene
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor, parse_sweeps
from rigctl.prediction.sweep import swept_scenes

SCENE = Path(__file__).parents[1] / "examples" / "scene-airborne.toml"
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
_REPEATS = 2
# Cases of a sweep of which the truth is found, and settings for that: the finest but for three levels of each knob.
_LOOKED_AT = 10
_FINEST = {name: len(knob.levels) - 2 for name, knob in NUMERICAL_SETTINGS.items()}
_FINE = {name: len(knob.levels) - 4 for name, knob in NUMERICAL_SETTINGS.items()} | {"tiles": 5}


def timed(work):
    """Return what a function returns, and the least time of some calls [s]."""
    seconds = []
    for _ in range(_REPEATS):
        start = time.process_time()
        found = work()
        seconds.append(time.process_time() - start)
    return found, min(seconds)


# Results of some cases: of a scene itself, or of those of a sweep that are looked at.
Evaluation = Callable[[Plan, float], tuple[Sequence[ChainResult], float]]


def run(scene: LitScene, plan: Plan, tolerance: float) -> tuple[Sequence[ChainResult], float]:
    """Evaluate a plan, nothing being kept from before."""
    settings = settings_at(plan, tolerance, face_m=scene.sensor_height_m)
    found, seconds = timed(partial(evaluate, scene, settings))
    return (found,), seconds


def run_sweep(
    scenes: Sequence[LitScene], looked_at: Sequence[int], plan: Plan, tolerance: float
) -> tuple[Sequence[ChainResult], float]:
    """Evaluate a plan of all cases of a sweep; return those that are looked at."""
    settings = settings_at(plan, tolerance, face_m=scenes[0].sensor_height_m)

    def all_cases() -> Sequence[ChainResult]:
        store = LightStore()
        tried = [evaluate(scenes[k], settings, store=store).lights for k in (0, len(scenes) // 2, -1)]
        rules = {name: known_rules([one[name] for one in tried]) for name in tried[0]}
        return evaluate_all(scenes, settings, rules=rules, store=store)

    found, seconds = timed(all_cases)
    return [found[k] for k in looked_at], seconds


def all_readings(result: ChainResult):
    return readings(result.scenario, result.predictions, result.detections)


def largest(results: Sequence[ChainResult], truths) -> float:
    return max(max(differences(all_readings(one), true).values()) for one, true in zip(results, truths, strict=True))


def by_hand(evaluation: Evaluation, start: Plan, tolerance: float, truths) -> tuple[dict[str, int], float, float]:
    """Lower knobs while the true error allows it; plan, time and error."""
    plan = dict(start)
    found, seconds = evaluation(plan, tolerance)
    error = largest(found, truths)
    while True:
        tried = []
        for name in NUMERICAL_SETTINGS:
            if plan[name] == 0:
                continue
            lower = {**plan, name: plan[name] - 1}
            found, lower_s = evaluation(lower, tolerance)
            if (apart := largest(found, truths)) <= tolerance:
                tried.append((lower_s, apart, lower))
        if not tried or min(tried, key=lambda one: one[0])[0] >= seconds:
            return plan, seconds, error
        seconds, error, plan = min(tried, key=lambda one: one[0])


def of_scene(scene: LitScene, tolerances: Sequence[float]) -> None:
    truths = [all_readings(one) for one in run(scene, _FINEST, 1e-6)[0]]
    for tolerance in tolerances:
        predictions, seconds = timed(partial(predict, [scene], tolerance=tolerance))
        (found,) = predictions.cases
        error = largest([found.result], truths)
        print_row(tolerance, seconds, error, found.plan, by_hand(partial(run, scene), found.plan, tolerance, truths))


def of_sweep(scenes: Sequence[LitScene], tolerances: Sequence[float]) -> None:
    looked_at = sorted({round(k * (len(scenes) - 1) / (_LOOKED_AT - 1)) for k in range(_LOOKED_AT)})
    truths = [all_readings(run(scenes[k], _FINE, 1e-4)[0][0]) for k in looked_at]
    for tolerance in tolerances:
        found, seconds = timed(partial(predict, scenes, tolerance=tolerance))
        error = largest([found.cases[k].result for k in looked_at], truths)
        start = {name: max(case.plan[name] for case in found.cases) for name in NUMERICAL_SETTINGS}
        hand = by_hand(partial(run_sweep, scenes, looked_at), start, tolerance, truths)
        print_row(tolerance, seconds, error, start, hand)
        print(f"{'':10} {words(found, seconds)}", flush=True)


def words(found: Predictions, seconds: float) -> str:
    cases = len(found.cases)
    share = 100.0 * found.share_of_estimates
    return f"{1e3 * seconds / cases:.0f} ms a case, {found.judged} of {cases} judged, {share:.0f} % for estimates"


def print_row(tolerance: float, seconds: float, error: float, plan: Plan, hand: tuple[Plan, float, float]) -> None:
    hand_plan, hand_s, hand_error = hand
    levels = ["/".join(str(one[name]) for name in NUMERICAL_SETTINGS) for one in (plan, hand_plan)]
    numbers = f"{seconds:8.3f} s {error:9.1e} {hand_s:8.3f} s {hand_error:9.1e} {seconds / hand_s:6.2f}"
    print(f"{tolerance:10.0e} {numbers}   {'; '.join(levels)}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--tolerances", nargs="+", type=float, default=TOLERANCES)
    parser.add_argument("--sweep", default=None, help="KEY=start:stop:n")
    given = parser.parse_args()
    predictor = ScenePredictor(load_scene(given.scene), None)
    print(f"{'tolerance':>10} {'promised':>10} {'error':>9} {'by hand':>10} {'error':>9} {'ratio':>6}   plan; by hand")
    if given.sweep is None:
        of_scene(predictor.lit_scene(), given.tolerances)
    else:
        cases = swept_scenes(predictor.scene, parse_sweeps((given.sweep,))).values()
        of_sweep([predictor.lit_scene(one) for one in cases], given.tolerances)
    return 0


if __name__ == "__main__":
    sys.exit(main())
