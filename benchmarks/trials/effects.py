"""Every effect that is left out of a random scene changes it by no more than its bound, alone and together.

Usage: nice python -m benchmarks.trials.effects [--scenes 1000] [--first 0] [--hostile | --thin]

For each scene, every effect that is there and has a bound below 1 (whether the planner left it out or not) is left out
alone; then all that are not there, and all that the planner leaves out at a random tolerance, together. Each number of
the prediction is compared. On a busy machine OPENBLAS_NUM_THREADS=1 makes it several times faster.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from benchmarks.trials.effect_scenes import HOSTILE_SETTINGS, SETTINGS, hostile_scene, random_scene, thin_scene
from model.accuracy.chain import LightStore, Readings, Settings, evaluate
from model.accuracy.effect_check import change, skylight_bound
from model.effects.names import ALL, Bound, Effect, EffectPlan
from model.effects.planner import plan
from model.scene.scene import LitScene

_SCENES = {"random": random_scene, "hostile": hostile_scene, "thin": thin_scene}
_TOLERANCES = (1e-4, 1e-3, 1e-2, 0.1, 0.3)


@dataclass
class Score:
    """What was found so far."""

    scenes: int = 0
    refused: int = 0
    checked: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)


def run_effects(scenes: int, *, first: int = 0, kind: str = "random") -> bool:
    """Run the trial; return whether every bound held."""
    score, begin = Score(), time.perf_counter()
    for seed in range(first, first + scenes):
        score_scene(score, seed, kind=kind)
        if (seed - first) % 50 == 49:
            print(f"{seed - first + 1} scenes, {len(score.violations)} bounds violated", flush=True)
    for line in _summary(score, time.perf_counter() - begin):
        print(line)
    return not score.violations


def score_scene(score: Score, seed: int, *, kind: str = "random") -> None:
    """Check the bounds of one scene."""
    generator = np.random.default_rng([seed, 7])
    scene = _SCENES[kind](generator)
    tolerance = float(generator.choice(_TOLERANCES))
    try:
        _check(score, scene, seed, tolerance, SETTINGS if kind == "random" else HOSTILE_SETTINGS)
    except ValueError as error:
        # Such as a field that reaches above the horizon: no scene.
        score.refused += 1
        print(f"seed {seed}: refused: {error}")
        return
    score.scenes += 1


def _check(score: Score, scene: LitScene, seed: int, tolerance: float, settings: Settings) -> None:
    store = LightStore()

    def seen(effects: frozenset[Effect]) -> Readings:
        return evaluate(scene, settings, effects=effects, store=store).readings

    whole = seen(ALL)

    found = plan(scene, tolerance=tolerance, sharper=partial(skylight_bound, scene))
    for name, left_out, bound in _tried(found):
        actual = change(whole, seen(ALL - left_out))
        score.checked[name] += 1
        if not bound.holds(actual):
            score.violations.append(f"seed {seed}, {name}: bound {bound.in_words}; is {actual.in_words}")
            print(score.violations[-1], flush=True)
    score.left_out.update(one.effect.value for one in found.decisions if not one.acts and one.bound.largest > 0.0)


def _tried(found: EffectPlan) -> Iterator[tuple[str, frozenset[Effect], Bound]]:
    for one in found.decisions:
        if 0.0 < one.bound.largest < 1.0:
            yield one.effect.value, frozenset({one.effect}), one.bound
    absent = frozenset(one.effect for one in found.decisions if one.bound.largest == 0.0)
    yield "all that is not there", absent, Bound()
    yield "all that is left out together", ALL - found.active, found.spent


def _summary(score: Score, taken_s: float) -> Iterator[str]:
    yield f"{score.scenes} scenes ({score.refused} refused) in {taken_s:.0f} s, {len(score.violations)} bounds violated"
    for effect in (*(one.value for one in Effect), "all that is not there", "all that is left out together"):
        yield f"  {effect:32} checked {score.checked[effect]:5}, left out though there {score.left_out[effect]:5}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--hostile", action="store_true", help="scenes at the ends of what is allowed, in thin air")
    parser.add_argument("--thin", action="store_true", help="level materials under thin air, for the bound of skylight")
    arguments = parser.parse_args()
    kind = "hostile" if arguments.hostile else "thin" if arguments.thin else "random"
    return 0 if run_effects(arguments.scenes, first=arguments.first, kind=kind) else 1


if __name__ == "__main__":
    sys.exit(main())
