"""Materials within their stated uncertainties with which most statements hold."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from rigctl.errors import ConfigError
from rigctl.files.scene_file import SceneFile
from rigctl.paper.airborne import BACKGROUND, TARGET, Airborne
from rigctl.paper.numbers import Verdict
from rigctl.paper.results import results
from rigctl.paper.rooftop import Rooftop
from rigctl.paper.statement import PaperScenes
from rigctl.scene.parameters import get, parameters

_OWN = tuple(f"regions.{region}." for region in (TARGET, BACKGROUND))
# Draws that no surface allows (a lobe that alone reflects more than its dhr) are made anew this many times.
_MOST_REDRAWN = 50


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A set of materials that was tried: its numbers by their keys, and the verdict on every statement."""

    numbers: Mapping[str, float]
    verdicts: Mapping[str, Verdict]

    @property
    def held(self) -> int:
        """How many statements hold."""
        return sum(verdict == "holds" for verdict in self.verdicts.values())


@dataclass(frozen=True, kw_only=True)
class Search:
    """Sets of materials that were tried, the best first, and how many draws no surface allowed."""

    tried: tuple[Tried, ...]
    impossible: int

    @property
    def best(self) -> Tried:
        """That with which most statements hold; the first of equals."""
        return self.tried[0]


def search(
    scene: SceneFile,
    start: PaperScenes,
    *,
    sets: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Search:
    """Return what comes out of random sets of materials, normal about those of a scene with their uncertainties.

    Parameters
    ----------
    scene : SceneFile
        Whose materials they are about.
    start : PaperScenes
        Its scenes, whose computed skies are used again; they are the first set that is tried.
    sets : int
        How many are tried beside it.
    seed : int
        Of the draws.
    progress : callable or None
        Told after each.

    Notes
    -----
    Settings of the scene file, without a tolerance: a verdict of a search is to be confirmed with `--materials`.
    """
    generator = np.random.default_rng(seed)
    found, impossible = [_tried(start, {}, "start")], 0
    for count in range(1, sets + 1):
        for numbers in _draws(start.airborne, generator):
            try:
                airborne = Airborne(
                    scene, light=start.airborne.light, snr=start.airborne.snr_form, changed=numbers, tolerance=None
                )
                scenes = PaperScenes(
                    airborne=airborne,
                    rooftop=Rooftop(airborne),
                    low_light=start.low_light,
                    height_m=start.height_m,
                )
                found.append(_tried(scenes, numbers, str(count)))
                break
            except ConfigError:
                impossible += 1
            except ValueError:
                impossible += 1
        if progress is not None:
            progress(count)
    return Search(tried=tuple(sorted(found, key=lambda one: -one.held)), impossible=impossible)


def _tried(scenes: PaperScenes, numbers: Mapping[str, float], name: str) -> Tried:
    found = results(scenes, name)
    return Tried(numbers=dict(numbers), verdicts={one.statement.id: one.verdict for one in found})


def _draws(airborne: Airborne, generator: np.random.Generator) -> Iterator[dict[str, float]]:
    scene = airborne.predictor.scene
    # Whatever the materials, or the scene of these two regions, state an uncertainty of.
    own = [
        one for parameter in parameters(scene) if (one := get(scene, parameter.key)).key.startswith(_OWN) and one.std
    ]
    for _ in range(_MOST_REDRAWN):
        drawn = {one.key: float(generator.normal(one.value, one.std)) for one in own}
        yield {one.key: min(max(drawn[one.key], one.least), one.most) for one in own}
