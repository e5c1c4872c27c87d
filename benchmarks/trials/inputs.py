"""Uncertain inputs over many seeds: is z against both errors standard normal, is an input that is off named first?"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.trials.harness import are_normal, by_row, is_high_enough, over, scratch
from benchmarks.trials.uncertain_panels import STATED, drawn_truth, scene_text, take_run
from rigctl.comparison.compare import compare_with_scene
from rigctl.comparison.explain import InputAttribution
from rigctl.files.scene_file import load_scene
from rigctl.measure.diagnose import measure_run
from rigctl.scene.scene import scene_of_file

ALPHA = 1e-3
MOVED_STD = 5.0
_WANTED = 0.95


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a seed gave: z of each row, the verdict, and what an attribution put first."""

    agrees: bool
    z: dict[tuple[str, str, str], float]
    can_be_told: bool
    is_first: bool
    is_named: bool


def one_seed(seed: int, *, moved: str | None = None) -> Outcome:
    """Draw a truth, take a run of it, compare it with what is stated."""
    place = 0 if moved is None else 1 + list(STATED).index(moved)
    draws = np.random.default_rng([seed, place])
    with scratch() as folder:
        path = folder / "scene.toml"
        path.write_text(scene_text())
        scene = load_scene(path)
        run = take_run(folder / "run", drawn_truth(draws, moved=moved, by_std=MOVED_STD), draws)
        found = compare_with_scene(measure_run(run, list(scene.regions)), scene_of_file(scene), alpha=ALPHA)
    attribution = found.attribution
    if attribution is None or attribution.best is None:
        raise RuntimeError("a scene with uncertain inputs has to have an explanation")
    return Outcome(
        agrees=found.agrees,
        z={(row.region, row.quantity, row.statistic): row.z for row in found.rows if row.z is not None},
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


def run_inputs(*, seeds: int = 200, moved_seeds: int = 60) -> bool:
    """Compare runs of drawn truths, then runs in which one input is five standard errors off."""
    outcomes = list(over(one_seed, range(1, seeds + 1)))
    sound = are_normal(f"z over both errors, {seeds} seeds", by_row(outcome.z for outcome in outcomes))
    print(f"disagree: {sum(not outcome.agrees for outcome in outcomes)} of {seeds}")
    for name in STATED:
        moved = list(over(partial(one_seed, moved=name), range(1, moved_seeds + 1)))
        first, named = sum(o.is_first for o in moved), sum(o.is_named for o in moved)
        is_distinct = sum(o.can_be_told for o in moved) > moved_seeds / 2
        kind = "distinguishable" if is_distinct else "stated to be indistinguishable or without effect"
        print(f"  {name:34} moved by 5: first in {first:3d} of {moved_seeds}, in the first group in {named:3d}; {kind}")
        sound &= is_high_enough(first if is_distinct else named, moved_seeds, _WANTED)
    return sound
