"""Trial of a camera with polarizers on its pixels: do model and run agree, and is each standard error what it says?

Sessions of the simulated camera, with the samples as they are and interpolated, each seed with its own texture,
pattern and noise.

Usage: python -m benchmarks.trials.mosaic [--seeds 30] [--first-seed 1]
"""

import argparse
import sys
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rigctl.comparison.compare import compare_with_scene
from rigctl.files.choices import Interpolation
from rigctl.files.scene_file import load_scene
from rigctl.measure.measure import measure
from rigctl.runs.folder import read_run
from rigctl.scene.reading import scene_of_file
from rigctl.session.take import take_session
from tests.rigctl.session.test_mosaic_session import TAKES, mosaic_rig, mosaic_session

# Deviations of interpolated pictures are known to be worth less than P / 4.5 pixels, means to somewhat more than P / 4.
_LARGEST_VARIANCE, _SUSPICIOUS = 1.0, 4.5
_MOST_DISAGREEING = 0.05


def scores(interpolation: Interpolation, seed: int) -> tuple[bool, dict[tuple[str, str], list[float]]]:
    """Return whether a run agrees with its scene, and how many standard errors each of its numbers is off."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        rig = mosaic_rig(folder, interpolation=interpolation)
        if rig.simulation is not None:
            rig = rig.model_copy(update={"simulation": rig.simulation.model_copy(update={"seed": seed})})
        session = mosaic_session(name=f"trial {seed}", take=[TAKES[0], {**TAKES[2], "cycles": 4}])
        take_session(rig, session, folder / "run", files={})
        scene = load_scene(folder / "scene.toml")
        measured = measure(read_run(folder / "run"), regions=list(scene.regions))
        found = compare_with_scene(measured, scene_of_file(scene), alpha=0.001)
        off: dict[tuple[str, str], list[float]] = defaultdict(list)
        for row in found.rows:
            if row.z is not None:
                off[row.quantity, row.statistic].append(row.z)
        return bool(found.agrees), off


def run_mosaic(seeds: int, *, first_seed: int = 1) -> bool:
    """Print what became of all of them; return whether it is as it should be."""
    sound = True
    for interpolation in ("none", "bilinear"):
        agree, by_number = 0, defaultdict(list)
        for seed in range(first_seed, first_seed + seeds):
            does_agree, off = scores(interpolation, seed)
            agree += does_agree
            for number, values in off.items():
                by_number[number] += values
        wide = 0
        for number, values in by_number.items():
            mean, variance = float(np.mean(values)), float(np.mean(np.square(values)))
            errors = np.array([mean * np.sqrt(len(values)), (variance - _LARGEST_VARIANCE) * np.sqrt(len(values) / 2)])
            if abs(errors[0]) > _SUSPICIOUS or errors[1] > _SUSPICIOUS:
                wide += 1
                print(f"  {' '.join(number)}: mean {mean:.2f}, variance {variance:.2f} of {len(values)}")
        variances = [float(np.mean(np.square(values))) for values in by_number.values()]
        print(
            f"{interpolation}: {agree} of {seeds} agree; variance of scores {min(variances):.2f} to "
            f"{max(variances):.2f}, mean {np.mean(variances):.2f}; {wide} of {len(by_number)} numbers off"
        )
        sound &= wide == 0 and seeds - agree <= max(1, _MOST_DISAGREEING * seeds)
    return sound


def main() -> int:
    """Run the trial; return 1 where it fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first-seed", type=int, default=1)
    arguments = parser.parse_args()
    return 0 if run_mosaic(arguments.seeds, first_seed=arguments.first_seed) else 1


if __name__ == "__main__":
    sys.exit(main())
