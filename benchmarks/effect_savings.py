"""What leaving effects out saves in the scenes of examples/effects, beside all effects at the same tolerance.

Usage: OPENBLAS_NUM_THREADS=1 python -m benchmarks.effect_savings [--tolerance 1e-2] [--repeats 5]

Each rule takes its turn in each scene, round by round; of the processor time of planning and prediction together the
least over the rounds counts. What every rule predicts is set beside a prediction with all effects to a hundredth of the
tolerance: the largest difference has to stay within the tolerance.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from model.accuracy.chain import Readings
from model.accuracy.effect_check import change, readings_of
from model.effects.names import EffectPlan, EffectRule
from rigctl.files.scene_file import load_scene
from rigctl.prediction.predict import ScenePredictor

_FOLDER = Path(__file__).parents[1] / "examples" / "effects"
_SCENES = ("bench", "lamp", "roof-3m", "airborne", "twilight")
_FINER = 1e-2
_RULES: tuple[EffectRule, ...] = ("all", "safe")


@dataclass(frozen=True, kw_only=True)
class Saving:
    """Outcome of a rule in a scene: what is left out, time, and the largest difference from the finer prediction."""

    rule: EffectRule
    left_out: tuple[str, ...]
    taken_s: float
    plan_s: float
    apart: float


def savings(scene: str, *, tolerance: float, repeats: int) -> Iterator[Saving]:
    """Yield the outcome of each rule."""
    truth = readings_of(_predictor(scene).to_tolerance(max(_FINER * tolerance, 1e-6)).result)
    rounds = [{rule: _once(scene, rule, tolerance, truth) for rule in _RULES} for _ in range(repeats)]
    for rule in _RULES:
        yield min((one[rule] for one in rounds), key=lambda found: found.taken_s)


def _once(scene: str, rule: EffectRule, tolerance: float, truth: Readings) -> Saving:
    predictor = _predictor(scene)
    begin = time.process_time()
    plan = predictor.effect_plan(tolerance, rule=rule)
    planned = time.process_time()
    found = predictor.to_tolerance(tolerance, effects=plan)
    return Saving(
        rule=rule,
        left_out=_left_out(plan),
        taken_s=time.process_time() - begin,
        plan_s=planned - begin,
        apart=change(truth, readings_of(found.result)).largest,
    )


def _predictor(scene: str) -> ScenePredictor:
    # A new one each time: nothing is kept from before.
    return ScenePredictor(load_scene(_FOLDER / f"{scene}.toml"), None)


def _left_out(plan: EffectPlan) -> tuple[str, ...]:
    return tuple(one.effect.value for one in plan.decisions if not one.acts and one.bound.largest > 0.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tolerance", type=float, default=1e-2)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    kept = True
    print("| scene | rule | left out | ms | of it planning | times faster | off by |")
    print("|---|---|---|---|---|---|---|")
    for scene in _SCENES:
        whole_s = 0.0
        for one in savings(scene, tolerance=arguments.tolerance, repeats=arguments.repeats):
            whole_s = one.taken_s if one.rule == "all" else whole_s
            kept = kept and one.apart <= arguments.tolerance
            factor = f"{whole_s / one.taken_s:.1f}" if whole_s > 0.0 else ""
            named = ", ".join(one.left_out) or "-"
            times = f"{1e3 * one.taken_s:.0f} | {1e3 * one.plan_s:.0f} | {factor}"
            print(f"| {scene} | {one.rule} | {named} | {times} | {one.apart:.1e} |", flush=True)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
