"""Trial of the tolerance in sweeps and grids: random scenes through random ranges, some cases beside finer settings.

Each scene is taken through a range of one number (two thirds) or a grid of two: zenith or azimuth of the camera, zenith
of the sun, optical depth, slopes. Of the cases that were not judged themselves some are drawn and set beside settings
finer in every knob. Of every reading that is promised the true error must be no more than the tolerance.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.trials.tolerance import true_errors
from model.accuracy.predict import predict
from model.scene.scene import LitScene
from tests.model.accuracy.random_scenes import hostile_scene, random_scene

_TOLERANCES = (0.1, 0.03, 0.01, 0.01)
_MOST_ZENITH_DEG = 75.0
_LOOKED_AT = 3

Change = Callable[[LitScene, float], LitScene]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A sweep beside the truth: cases in all, those looked at (not judged), broken promises, largest error over T."""

    words: str
    cases: int
    looked_at: int
    broken: tuple[str, ...]
    largest: float


def _view_zenith(scene: LitScene, value: float) -> LitScene:
    return replace(scene, view=replace(scene.view, zenith_rad=np.radians(value)))


def _view_azimuth(scene: LitScene, value: float) -> LitScene:
    return replace(scene, view=replace(scene.view, azimuth_rad=np.radians(value)))


def _sun(scene: LitScene, value: float) -> LitScene:
    air = scene.air
    other = None if air.alternative is None else replace(air.alternative, sun_zenith_rad=np.radians(value))
    return replace(scene, air=replace(air, sun_zenith_rad=np.radians(value), alternative=other))


def _depth(scene: LitScene, value: float) -> LitScene:
    return replace(scene, air=replace(scene.air, state=replace(scene.air.state, aerosol_optical_depth=value)))


def _slopes(scene: LitScene, value: float) -> LitScene:
    regions = tuple(replace(one, surface=replace(one.surface, slope_rms=value)) for one in scene.regions)
    return replace(scene, regions=regions)


# What changes, and the range from which its ends are drawn.
_CHANGES: dict[str, tuple[Change, float, float]] = {
    "view": (_view_zenith, 0.0, 60.0),
    "azimuth": (_view_azimuth, 0.0, 360.0),
    "sun": (_sun, 0.0, _MOST_ZENITH_DEG),
    "depth": (_depth, 0.0, 0.8),
    "slopes": (_slopes, 0.03, 0.4),
}


def swept(scene: LitScene, draw: np.random.Generator) -> tuple[str, tuple[int, ...], list[LitScene]]:
    """Return what changes, how many cases there are along each axis, and the scenes."""
    names = draw.choice(list(_CHANGES), size=1 if draw.random() < 2.0 / 3.0 else 2, replace=False).tolist()
    sizes = tuple(int(draw.integers(12, 30) if len(names) == 1 else draw.integers(4, 9)) for _ in names)
    axes = []
    for name, size in zip(names, sizes, strict=True):
        _, low, high = _CHANGES[name]
        ends = np.sort(draw.uniform(low, high, 2))
        first = min(ends[0], high - 0.2 * (high - low))
        axes.append(np.linspace(first, max(ends[1], first + 0.2 * (high - low)), size))
    scenes = []
    for values in product(*axes):
        one = scene
        for name, value in zip(names, values, strict=True):
            one = _CHANGES[name][0](one, float(value))
        scenes.append(one)
    return ", ".join(names), sizes, scenes


def one_sweep(seed: int, *, hostile: bool, looked_at: int) -> Outcome:
    """Return the outcome of the sweep of a seed."""
    draw = np.random.default_rng((seed, 7))
    words, sizes, scenes = swept((hostile_scene if hostile else random_scene)(seed), draw)
    tolerance = _TOLERANCES[seed % len(_TOLERANCES)]
    try:
        found = predict(scenes, shape=sizes, tolerance=tolerance, clock=time.process_time)
    except ValueError as error:
        return Outcome(words=f"{words} {sizes}: refused: {error}", cases=0, looked_at=0, broken=(), largest=0.0)
    between = [k for k, case in enumerate(found.cases) if not case.is_judged]
    chosen = sorted(draw.choice(between, size=min(looked_at, len(between)), replace=False).tolist())
    broken, largest = [], 0.0
    for k in chosen:
        case = found.cases[k]
        true = true_errors(scenes[k], case.result, case.not_guaranteed, tolerance)
        promised = {key: error for key, error in true.items() if key not in case.not_guaranteed}
        broken += [f"case {k}: {'/'.join(key)} {error:.2g}" for key, error in promised.items() if error > tolerance]
        largest = max(largest, max(promised.values(), default=0.0) / tolerance)
    judged = f"{found.judged} of {len(scenes)} judged, {100.0 * found.share_of_estimates:.0f} % for estimates"
    text = f"{words} {sizes} to {tolerance:g}: {judged}, spot checks {found.spot_checks_held}/{found.spot_checks}"
    return Outcome(words=text, cases=len(scenes), looked_at=len(chosen), broken=tuple(broken), largest=largest)


def run_sweeps(*, sweeps: int = 100, first: int = 0, is_hostile: bool = False) -> bool:
    """Predict sweeps and grids; return whether every promise was kept."""
    found = []
    for seed in range(first, first + sweeps):
        outcome = one_sweep(seed, hostile=is_hostile, looked_at=_LOOKED_AT)
        print(
            f"{seed}: {outcome.words}; largest true error {outcome.largest:.2g} of T {outcome.broken or ''}", flush=True
        )
        found.append(outcome)
    points, broken = (
        (sum(getattr(o, name) for o in found) for name in ("looked_at", "cases")),
        sum(len(o.broken) for o in found),
    )
    looked_at, cases = points
    print(f"{sweeps} sweeps of {cases} cases, {looked_at} between judged ones compared: {broken} promises broken")
    return broken == 0
