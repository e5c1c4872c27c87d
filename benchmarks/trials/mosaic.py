"""Trial of a camera with polarizers on its pixels: do model and run agree, and is each standard error what it says?

Sessions of the simulated camera, with the samples as they are and interpolated, each seed with its own texture,
pattern and noise.
"""

from collections import defaultdict
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.trials.harness import are_normal, over
from rigctl.comparison.compare import compare_with_scene
from rigctl.files.choices import Interpolation
from rigctl.files.scene_file import load_scene
from rigctl.measure.diagnose import measure_run
from rigctl.runs.folder import read_run
from rigctl.scene.scene import scene_of_file
from rigctl.session.take import take_session
from tests.rigctl.session.test_mosaic_session import TAKES, mosaic_rig, mosaic_session

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
        measured = measure_run(read_run(folder / "run"), list(scene.regions))
        found = compare_with_scene(measured, scene_of_file(scene), alpha=0.001)
        off: dict[tuple[str, str], list[float]] = defaultdict(list)
        for row in found.rows:
            if row.z is not None:
                off[row.quantity, row.statistic].append(row.z)
        return bool(found.agrees), dict(off)


def run_mosaic(*, seeds: int = 30, first_seed: int = 1) -> bool:
    """Compare runs with the samples as they are and interpolated with their scene."""
    sound = True
    for interpolation in ("none", "bilinear"):
        agree, by_number = 0, defaultdict(list)
        for does_agree, off in over(partial(scores, interpolation), range(first_seed, first_seed + seeds)):
            agree += does_agree
            for number, values in off.items():
                by_number[number] += values
        # Deviations of interpolated pictures are known to be worth less than their pixels, so scores may be small.
        sound &= are_normal(interpolation, by_number, may_be_small=lambda _: True)
        print(f"{interpolation}: {agree} of {seeds} agree")
        sound &= seeds - agree <= max(1, _MOST_DISAGREEING * seeds)
    return sound
