"""Simulated roofs, noon and morning: is z standard normal row by row, are changes of the roof found and named?

Usage: python -m benchmarks.trials.roof [--seeds 40] [--changed-seeds 4] [--first-seed 1] [--changes NAME ...]
    [--hours noon morning] [--processes 2]
"""

import argparse
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from benchmarks.trials.roof_runs import Hour, roof_comparison
from rigctl.comparison.explain import InputAttribution
from rigctl.files.choices import ROOF_CHANGES, RoofChange

# About 200 rows with two figures each: one beyond 4 standard errors is expected in some 80 such trials.
_SUSPICIOUS = 4.0
NAMES: dict[RoofChange, str] = {
    "visibility": "atmosphere.visibility_km",
    "aerosol": "atmosphere.alternative.share",
    "dhr": "regions.black_panel.dhr",
    "tilt": "regions.black_panel.tilt_deg",
    "drift": "errors.illumination_drift",
}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a run: z of each row, whether it agrees, and what the comparison says would explain it."""

    agrees: bool | None
    z: dict[tuple[str, str, str], float]
    first: str
    indistinguishable: tuple[str, ...]
    flags: tuple[str, ...]

    def verdict(self, name: str) -> str:
        """Return "named", "indistinguishable", "misnamed" or "missed" for an input that was changed.

        A drift of the light is named by the run's own check of its cycles, before any model.
        """
        if name == NAMES["drift"] and "drift of the light" in self.flags:
            return "named"
        if self.agrees is not False:
            return "missed"
        return "named" if self.first == name else "indistinguishable" if name in self.indistinguishable else "misnamed"


def one_run(hour: Hour, seed: int, perturb: RoofChange | None) -> Outcome:
    """Take a run of a roof and compare it; one that was changed with a scene file that states what is not known."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        found = roof_comparison(Path(folder), hour=hour, seed=seed, perturb=perturb, uncertain=perturb is not None)
    best = None if found.attribution is None else found.attribution.best
    return Outcome(
        agrees=found.agrees,
        z={(row.region, row.quantity, row.statistic): row.z for row in found.rows if row.z is not None},
        first="" if best is None else best.name,
        indistinguishable=() if best is None else _alike(found.attribution, best.name),
        flags=tuple(check.name for check in found.flags),
    )


def _alike(attribution: InputAttribution | None, first: str) -> tuple[str, ...]:
    """Return what is said to look the same as the first, either way, and what is said not to be seen."""
    if attribution is None:
        return ()
    best = attribution.moves[0]
    others = (move.name for move in attribution.moves if first in move.indistinguishable_from)
    return (*best.indistinguishable_from, *others, *attribution.unseen)


def off_rows(outcomes: Iterable[Outcome]) -> dict[tuple[str, str, str], tuple[float, float, float, float]]:
    """Return of each row mean and variance of z, and how far they are from 0 and 1 in their standard errors."""
    scores: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for outcome in outcomes:
        for row, z in outcome.z.items():
            scores[row].append(z)
    off = {}
    for row, z in scores.items():
        n, mean, variance = len(z), float(np.mean(z)), float(np.var(z, ddof=1))
        off[row] = (mean, variance, mean * n**0.5, (variance - 1.0) / (2.0 / (n - 1)) ** 0.5)
    return off


def run_roof(
    seeds: int,
    changed_seeds: int,
    *,
    processes: int,
    first_seed: int = 1,
    changes: Sequence[RoofChange] = ROOF_CHANGES,
    hours: Sequence[Hour] = get_args(Hour),
) -> bool:
    """Run the seeds, print the tables, return whether all is as it should be."""
    start_s = time.monotonic()
    first = first_seed
    with ProcessPoolExecutor(processes) as pool:
        plain = {
            hour: [pool.submit(one_run, hour, seed, None) for seed in range(first, first + seeds)] for hour in hours
        }
        changed = {
            (what, hour): [pool.submit(one_run, hour, seed, what) for seed in range(first, first + changed_seeds)]
            for what in changes
            for hour in hours
            if changed_seeds
        }
        sound = True
        for hour, tasks in plain.items():
            sound &= _report_scores(hour, [task.result() for task in tasks])
        for (what, hour), tasks in changed.items():
            sound &= _report_changed(what, hour, [task.result() for task in tasks])
    print(f"{time.monotonic() - start_s:.0f} s")
    return sound


def _report_scores(hour: Hour, outcomes: list[Outcome]) -> bool:
    off = off_rows(outcomes)
    worst = sorted(off, key=lambda row: -max(map(abs, off[row][2:])))
    print(f"roof at {hour}, {len(outcomes)} seeds, {len(off)} rows; the five farthest from mean 0 and variance 1:")
    for row in worst[:5]:
        mean, variance, mean_off, variance_off = off[row]
        print(f"  {' '.join(row):42} mean {mean:+.3f} ({mean_off:+.1f})  variance {variance:.3f} ({variance_off:+.1f})")
    means, variances = ([entry[k] for entry in off.values()] for k in (0, 1))
    disagree = sum(outcome.agrees is False for outcome in outcomes)
    print(f"  all rows: mean {np.mean(means):+.3f}, variance {np.mean(variances):.3f}; disagree: {disagree}")
    return all(max(map(abs, entry[2:])) <= _SUSPICIOUS for entry in off.values())


def _report_changed(what: RoofChange, hour: Hour, outcomes: list[Outcome]) -> bool:
    verdicts = [outcome.verdict(NAMES[what]) for outcome in outcomes]
    counts = ", ".join(f"{verdict} {verdicts.count(verdict)}" for verdict in sorted(set(verdicts)))
    firsts = sorted({outcome.first for outcome in outcomes})
    flags = sorted({name for outcome in outcomes for name in outcome.flags})
    print(f"  {what:10} {hour:8} {counts} of {len(outcomes)}; first: {', '.join(firsts)}; flagged: {', '.join(flags)}")
    return set(verdicts) <= {"named", "indistinguishable"}


def main() -> int:
    """Run the trial; return 1 where it fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--changed-seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--changes", nargs="*", choices=ROOF_CHANGES, default=ROOF_CHANGES)
    parser.add_argument("--hours", nargs="*", choices=get_args(Hour), default=get_args(Hour))
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    sound = run_roof(
        given.seeds,
        given.changed_seeds,
        processes=given.processes,
        first_seed=given.first_seed,
        changes=given.changes,
        hours=given.hours,
    )
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
