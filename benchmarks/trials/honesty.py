"""The demo over many seeds: is each standard error what it says, does each perturbation point where it belongs?"""

from collections import Counter
from dataclasses import dataclass
from functools import partial

from benchmarks.trials.harness import are_normal, by_row, is_low_enough, over, scratch
from rigctl.files.choices import PERTURBATIONS
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


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a seed gave: z of each row undisturbed, and the verdict and where it points for each perturbation."""

    agrees: bool
    z: dict[tuple[str, str, str], float]
    points_to: dict[str, tuple[str, ...]]


def one_seed(seed: int, *, perturbed_seeds: int) -> Outcome:
    """Take, calibrate and compare with one seed, undisturbed and with each perturbation."""
    with scratch() as folder:
        out = folder / "demo"
        copy_examples(out)
        rig = seeded(load_rig(out / "rig-sim.toml"), seed)
        take(rig, out, session="session-noise.toml", run=NOISE_RUN)
        noise(run=out / NOISE_RUN, out=out / NOISE)
        found = {}
        for what in (None, *(PERTURBATIONS if seed <= perturbed_seeds else ())):
            name = f"run-{what}"
            take(rig if what is None else perturbed(rig, what), out, session="session.toml", run=name)
            found[what] = compare_run(
                out / name, scene=out / "scene-panels.toml", noise=out / NOISE, calibrations="none", alpha=ALPHA
            )
        plain = found.pop(None)
        return Outcome(
            agrees=plain.agrees,
            z={(r.region, r.quantity, r.statistic): r.z for r in plain.rows if r.z is not None},
            points_to={str(what): comparison.points_to for what, comparison in found.items()},
        )


def run_honesty(*, seeds: int = 200, perturbed_seeds: int = 100) -> bool:
    """Run the seeds, the first ones with every perturbation too."""
    outcomes = list(over(partial(one_seed, perturbed_seeds=perturbed_seeds), range(1, seeds + 1)))
    sound = are_normal(f"undisturbed, {seeds} seeds", by_row(outcome.z for outcome in outcomes))
    disagree = sum(not outcome.agrees for outcome in outcomes)
    print(f"undisturbed: {disagree} of {seeds} disagree (alpha {ALPHA:g})")
    sound &= is_low_enough(disagree, seeds, ALPHA)
    for what in PERTURBATIONS if perturbed_seeds else ():
        counts = Counter(outcome.points_to[what] for outcome in outcomes[:perturbed_seeds])
        right = counts[(POINTS_TO[what],)]
        sound &= right >= 0.99 * perturbed_seeds
        print(f"{what:13}: {right} of {perturbed_seeds} point to {POINTS_TO[what]} alone; all: {dict(counts)}")
    return sound
