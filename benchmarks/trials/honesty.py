"""The demo over many seeds: is each standard error what it says, does each perturbation point where it belongs?"""

import csv
import os
import tempfile
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import bdtrc

from rigctl.files.choices import PERTURBATIONS, Perturbation
from rigctl.files.rig_file import load_rig
from rigctl.rig.roof import perturbed
from rigctl.verbs.calibrate import noise
from rigctl.verbs.compare import compare_run
from rigctl.verbs.demo import NOISE, NOISE_RUN, copy_examples, seeded, take

ALPHA = 1e-3
POINTS_TO = {
    "gain": "scale",
    "angle-offset": "axis-offset",
    "angle-sense": "axis-sense",
    "extinction": "polarization",
}
# A score is suspicious when its mean or variance over the seeds is this many standard errors off. With about 110
# rows and two figures each, one of 3.5 is expected in ten such trials; 4 in seventy.
_SUSPICIOUS = 4.0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a seed gave: z of each row undisturbed, and the verdict and where it points for each perturbation."""

    seed: int
    agrees: bool
    z: dict[tuple[str, str, str], float]
    points_to: dict[str, tuple[str, ...]]


def one_seed(seed: int, perturbations: tuple[Perturbation, ...]) -> Outcome:
    """Take, calibrate and compare with one seed, undisturbed and with each perturbation."""
    # Frames in memory: the trial is about numbers, and durable writing only takes time.
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        out = Path(folder) / "demo"
        copy_examples(out)
        rig = seeded(load_rig(out / "rig-sim.toml"), seed)
        take(rig, out, session="session-noise.toml", run=NOISE_RUN)
        noise(run=out / NOISE_RUN, out=out / NOISE)
        found = {}
        for what in (None, *perturbations):
            name = f"run-{what}"
            take(rig if what is None else perturbed(rig, what), out, session="session.toml", run=name)
            found[what] = compare_run(
                out / name, scene=out / "scene-panels.toml", noise=out / NOISE, calibrations="none", alpha=ALPHA
            )
        plain = found.pop(None)
        return Outcome(
            seed=seed,
            agrees=plain.agrees,
            z={(r.region, r.quantity, r.statistic): r.z for r in plain.rows if r.z is not None},
            points_to={str(what): comparison.points_to for what, comparison in found.items()},
        )


def run_honesty(seeds: int, perturbed_seeds: int, *, processes: int, folder: Path | None = None) -> bool:
    """Run the seeds, print the tables, return whether all is as it should be."""
    start_s = time.monotonic()
    with ProcessPoolExecutor(processes) as pool:
        tasks = [
            pool.submit(one_seed, seed, PERTURBATIONS if seed <= perturbed_seeds else ())
            for seed in range(1, seeds + 1)
        ]
        outcomes = []
        for count, task in enumerate(tasks, start=1):
            outcomes.append(task.result())
            if count % 10 == 0:
                print(f"  {count} of {seeds} seeds, {time.monotonic() - start_s:.0f} s", flush=True)
    if folder is not None:
        _keep(outcomes, folder)
    sound = _report_scores(outcomes)
    sound &= _report_verdicts(outcomes)
    return sound & _report_perturbations(outcomes[:perturbed_seeds])


def _report_scores(outcomes: list[Outcome]) -> bool:
    scores: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for outcome in outcomes:
        for row, z in outcome.z.items():
            scores[row].append(z)
    print(f"\n{'region':12} {'quantity':12} {'statistic':17} {'n':>4} {'mean z':>7} {'var z':>6}  off by (mean, var)")
    suspicious = 0
    for (region, quantity, statistic), z in scores.items():
        values = np.array(z)
        n = values.size
        off = (values.mean() * np.sqrt(n), (values.var(ddof=1) - 1) / np.sqrt(2 / (n - 1)))
        flag = "  <--" if max(map(abs, off)) > _SUSPICIOUS else ""
        suspicious += bool(flag)
        print(
            f"{region:12} {quantity:12} {statistic:17} {n:4d} {values.mean():+7.3f} {values.var(ddof=1):6.3f}"
            f"  {off[0]:+5.1f} {off[1]:+5.1f}{flag}"
        )
    print(f"{suspicious} of {len(scores)} rows are off by more than {_SUSPICIOUS:g} standard errors")
    return suspicious == 0


def _report_verdicts(outcomes: list[Outcome]) -> bool:
    off = sum(not outcome.agrees for outcome in outcomes)
    # Chance of so many or more false disagreements if each has the chance alpha.
    chance = float(bdtrc(off - 1, len(outcomes), ALPHA)) if off else 1.0
    print(f"\nundisturbed: {off} of {len(outcomes)} seeds disagree (alpha {ALPHA:g}; so many or more: {chance:.3g})")
    return chance > 1e-3


def _report_perturbations(outcomes: list[Outcome]) -> bool:
    sound = True
    for what in PERTURBATIONS if outcomes else ():
        counts = Counter(outcome.points_to[what] for outcome in outcomes)
        right = counts[(POINTS_TO[what],)]
        sound &= right >= 0.99 * len(outcomes)
        print(f"{what:13}: {right} of {len(outcomes)} point to {POINTS_TO[what]} alone; all: {dict(counts)}")
    return sound


def _keep(outcomes: list[Outcome], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "scores.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("seed", "region", "quantity", "statistic", "z"))
        writer.writerows((outcome.seed, *row, z) for outcome in outcomes for row, z in outcome.z.items())
