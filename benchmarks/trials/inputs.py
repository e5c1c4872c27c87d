"""Uncertain inputs over many seeds: is z against both errors standard normal, is an input that is off named first?

Usage: python -m benchmarks.trials.inputs [--seeds 200] [--moved-seeds 60] [--processes 2]
"""

import argparse
import os
import sys
import tempfile
import time
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import bdtr

from benchmarks.trials.uncertain_panels import STATED, drawn_truth, scene_text, take_run
from rigctl.comparison.compare import compare_with_scene
from rigctl.comparison.explain import InputAttribution
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import measure
from rigctl.scene.reading import scene_of_file

ALPHA = 1e-3
MOVED_STD = 5.0
# About 70 rows with two figures each: one beyond 4 standard errors is expected in a hundred such trials.
_SUSPICIOUS = 4.0
_WANTED = 0.95
# A share is too low where chance makes so few or fewer in one trial of a thousand.
_CHANCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a seed gave: z of each row, the verdict, and what an attribution put first."""

    agrees: bool
    z: dict[tuple[str, str, str], float]
    first: str
    can_be_told: bool
    is_first: bool
    is_named: bool


def one_seed(seed: int, moved: str | None) -> Outcome:
    """Draw a truth, take a run of it, compare it with what is stated."""
    place = 0 if moved is None else 1 + list(STATED).index(moved)
    draws = np.random.default_rng([seed, place])
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(scene_text())
        scene = load_scene(path)
        run = take_run(Path(folder) / "run", drawn_truth(draws, moved=moved, by_std=MOVED_STD), draws)
        found = compare_with_scene(measure(run, regions=list(scene.regions)), scene_of_file(scene), alpha=ALPHA)
    attribution = found.attribution
    if attribution is None or attribution.best is None:
        raise RuntimeError("a scene with uncertain inputs has to have an explanation")
    return Outcome(
        agrees=found.agrees,
        z={(row.region, row.quantity, row.statistic): row.z for row in found.rows if row.z is not None},
        first=attribution.best.name,
        can_be_told=_can_be_told(attribution, moved),
        is_first=attribution.best.name == moved,
        is_named=_is_named(attribution, moved),
    )


def _can_be_told(attribution: InputAttribution, name: str | None) -> bool:
    return any(move.name == name and not move.indistinguishable_from for move in attribution.moves)


def _is_named(attribution: InputAttribution, name: str | None) -> bool:
    """Whether the input is first, or is said to be indistinguishable from the first, or not to be seen."""
    best = attribution.moves[0]
    own = next((move for move in attribution.moves if move.name == name), None)
    if own is None:
        return name in attribution.unseen
    return own is best or best.name in own.indistinguishable_from or name in best.indistinguishable_from


def run_inputs(seeds: int, moved_seeds: int, *, processes: int) -> bool:
    """Run the seeds, print the tables, return whether all is as it should be."""
    start_s = time.monotonic()
    with ProcessPoolExecutor(processes) as pool:
        plain = [pool.submit(one_seed, seed, None) for seed in range(1, seeds + 1)]
        moved = {name: [pool.submit(one_seed, s, name) for s in range(1, moved_seeds + 1)] for name in STATED}
        sound = _report_scores([task.result() for task in plain])
        for name, tasks in moved.items():
            sound &= _report_moved(name, [task.result() for task in tasks])
    print(f"{time.monotonic() - start_s:.0f} s")
    return sound


def _report_scores(outcomes: list[Outcome]) -> bool:
    scores: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for outcome in outcomes:
        for row, z in outcome.z.items():
            scores[row].append(z)
    n = len(outcomes)
    off = {}
    for row, z in scores.items():
        mean, variance = float(np.mean(z)), float(np.var(z, ddof=1))
        off[row] = (mean, variance, mean * n**0.5, (variance - 1.0) / (2.0 / (n - 1)) ** 0.5)
    worst = sorted(off, key=lambda row: -max(map(abs, off[row][2:])))
    print(f"z against both errors, {n} seeds, {len(off)} rows; the five farthest from mean 0 and variance 1:")
    for row in worst[:5]:
        mean, variance, mean_off, variance_off = off[row]
        print(f"  {' '.join(row):42} mean {mean:+.3f} ({mean_off:+.1f})  variance {variance:.3f} ({variance_off:+.1f})")
    variances = [entry[1] for entry in off.values()]
    print(
        f"  mean variance of all rows: {np.mean(variances):.3f}; disagree: {sum(not o.agrees for o in outcomes)} of {n}"
    )
    return all(max(map(abs, entry[2:])) <= _SUSPICIOUS for entry in off.values())


def _report_moved(name: str, outcomes: list[Outcome]) -> bool:
    n = len(outcomes)
    first, named = sum(o.is_first for o in outcomes), sum(o.is_named for o in outcomes)
    told = sum(o.can_be_told for o in outcomes) > n / 2
    right = first if told else named
    kind = "can be told" if told else "is said to be indistinguishable or unseen"
    print(f"  {name:34} moved by 5: first in {first:3d} of {n}, first or named with the first in {named:3d}; {kind}")
    return bool(bdtr(right, n, _WANTED) > _CHANCE)


def main() -> int:
    """Run the trial; return 1 where it fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--moved-seeds", type=int, default=60)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    return 0 if run_inputs(arguments.seeds, arguments.moved_seeds, processes=arguments.processes) else 1


if __name__ == "__main__":
    sys.exit(main())
