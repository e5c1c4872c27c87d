"""All that a check of the paper found, by set of materials."""

from dataclasses import dataclass

from rigctl.files.scene_file import SceneFile
from rigctl.paper.digitised import DigitisedPoint
from rigctl.paper.results import Result
from rigctl.paper.search import Search
from rigctl.paper.statement import PaperScenes


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialSet:
    """One set of materials: its scenes, what comes out of the statements, and what is assumed."""

    name: str
    scene: SceneFile
    scenes: PaperScenes
    as_paper: PaperScenes | None
    results: tuple[Result, ...]
    assumed: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperResult:
    """What was found, by set of materials.

    Attributes
    ----------
    sets : tuple of MaterialSet
        In the order of the request.
    figures : tuple of int
        Which were asked for.
    search : Search or None
        About the first set.
    points : tuple of DigitisedPoint
        Of the paper's figures, where somebody has them.
    remarks : tuple of str
        What is to be said.
    """

    sets: tuple[MaterialSet, ...]
    figures: tuple[int, ...]
    search: Search | None
    points: tuple[DigitisedPoint, ...]
    remarks: tuple[str, ...]

    @property
    def results(self) -> tuple[Result, ...]:
        """Of all sets."""
        return tuple(one for each in self.sets for one in each.results)
