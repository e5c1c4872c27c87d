"""What a promised tolerance costs: over settings chosen by hand, for its error estimates, and with all effects."""

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from benchmarks.timing import Row, least_s
from model.accuracy.chain import ChainResult, differences, evaluate, readings
from model.accuracy.plan import NUMERICAL_SETTINGS, Plan, settings_at
from model.accuracy.predict import predict
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor

_EXAMPLES = Path(__file__).parents[1] / "examples"
_SCENES = {"airborne": "scene-airborne.toml", "bench": "effects/bench.toml", "rooftop": "scene-rooftop-noon.toml"}
_SAVINGS = ("bench", "lamp", "roof-3m", "airborne", "twilight")
_TOLERANCE = 1e-2
_FINEST = {name: len(knob.levels) - 2 for name, knob in NUMERICAL_SETTINGS.items()}
_MS = 1e3
# Seconds of the first prediction of a process, without its imports of numpy and erfa, and of another scene after it.
_FIRST = """
import sys, time, erfa, numpy
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor
for _ in range(3):
    scene = load_scene(sys.argv[1])
    start = time.process_time()
    ScenePredictor(scene, None).predict()
    print(time.process_time() - start)
"""


def rows() -> Iterator[Row]:
    """Time predictions of single scenes."""
    first, *warm = map(float, _python(_FIRST, str(_EXAMPLES / "scene-airborne.toml")).split())
    yield Row(
        work="first prediction in a process, airborne",
        ours=first,
        beside="the same, warm",
        theirs=min(warm),
        most_ratio=1.5,
    )
    for name, file in _SCENES.items():
        yield from _promised(name, _EXAMPLES / file)
    for name in _SAVINGS:
        yield _saved(name)


def _python(program: str, *words: str) -> str:
    return subprocess.run([sys.executable, "-c", program, *words], check=True, capture_output=True, text=True).stdout


def _promised(name: str, file: Path) -> Iterator[Row]:
    """Time a promise, and the fastest plan of the same true error that one would choose knowing the truth."""
    scene = ScenePredictor(load_scene(file), None).lit_scene()

    def run(plan: Plan, tolerance: float) -> ChainResult:
        return evaluate(scene, settings_at(plan, tolerance, face_m=scene.sensor_height_m))

    truth = _readings(run(_FINEST, 1e-6))

    def error(plan: Plan) -> float:
        return max(differences(_readings(run(plan, _TOLERANCE)), truth).values())

    (found,) = predict([scene], tolerance=_TOLERANCE).cases
    best = _by_hand(
        found.plan,
        error,
        allowed=error(found.plan),
        seconds=lambda plan: least_s(partial(run, plan, _TOLERANCE), rounds=2)[0],
    )
    promised, chosen = least_s(lambda: predict([scene], tolerance=_TOLERANCE), partial(run, best, _TOLERANCE), rounds=3)
    yield Row(
        work=f"prediction to {_TOLERANCE}, {name}", ours=_MS * promised, unit="ms",
        beside="settings of the same true error, chosen knowing it", theirs=_MS * chosen, most_ratio=2.0,
    )  # fmt: skip
    (final,) = least_s(partial(run, found.plan, _TOLERANCE), rounds=3)
    yield Row(
        work=f"— of it choosing settings and estimating errors, {name}",
        ours=100.0 * (1.0 - final / promised),
        unit="%",
        most=25.0,
    )


def _by_hand(start: Plan, error: Callable[[Plan], float], *, allowed: float, seconds: Callable[[Plan], float]) -> Plan:
    """Return the fastest plan found by lowering single settings while the true error is no more than is allowed."""
    plan, least = dict(start), seconds(start)
    while True:
        lower = [{**plan, name: plan[name] - 1} for name in NUMERICAL_SETTINGS if plan[name] > 0]
        tried: Sequence[tuple[float, dict[str, int]]] = [(seconds(one), one) for one in lower if error(one) <= allowed]
        if not tried or min(tried, key=lambda one: one[0])[0] >= least:
            return plan
        least, plan = min(tried, key=lambda one: one[0])


def _readings(result: ChainResult):
    return readings(result.scenario, result.predictions, result.detections)


def _saved(name: str) -> Row:
    """Time a scene with the effects that it calls for, planning included, beside all effects."""
    file = load_scene(_EXAMPLES / "effects" / f"{name}.toml")

    def predicted(rule: str) -> None:
        # A new predictor each time: nothing is kept from before.
        predictor = ScenePredictor(file, None)
        predictor.to_tolerance(_TOLERANCE, effects=predictor.effect_plan(_TOLERANCE, rule=rule))

    safe, whole = least_s(lambda: predicted("safe"), lambda: predicted("all"), rounds=3)
    return Row(
        work=f"{name} to {_TOLERANCE}, effects it calls for",
        ours=_MS * safe,
        unit="ms",
        beside="all effects",
        theirs=_MS * whole,
    )
