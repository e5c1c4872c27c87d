"""The paper checked with sets of materials: scenes, verdicts, assumptions, and points read off its figures."""

import csv
import math
import re
from collections.abc import Callable, Collection, Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import NamedTuple

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.errors import ConfigError
from rigctl.files.choices import SnrForm
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.paper.curves import FIGURES
from rigctl.paper.scenes import ASSUMED, PaperScenes
from rigctl.paper.statements import Judged, Search, judged, search

_POINT_COLUMNS = ("figure", "panel", "label", "x", "y")
_ASSUMED = re.compile(r"^\s*(?P<key>[A-Za-z_]+)\s*=\s*(?P<value>[^#]*?)\s*#\s*assumed:?\s*(?P<why>.*)$")
_TABLE = re.compile(r"^\s*\[+(?P<name>[\w.]+)\]+")
_NAME = re.compile(r'^\s*name\s*=\s*"(?P<name>[^"]*)"')


class DigitisedPoint(NamedTuple):
    """A point: number of the figure, letter of its panel (empty for all), label of the curve, and place."""

    figure: int
    panel: str
    label: str
    x: float
    y: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialSet:
    """One set of materials: its scenes, verdicts on the statements, and what is assumed."""

    name: str
    scene: SceneFile
    scenes: PaperScenes
    as_paper: PaperScenes | None  #: the same scenes, computed as the authors did
    results: tuple[Judged, ...]
    assumed: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedPaper:
    """Verdicts on the statements of the paper, by set of materials."""

    sets: tuple[MaterialSet, ...]
    figures: tuple[int, ...]
    search: Search | None  #: about the first set
    points: tuple[DigitisedPoint, ...]  #: digitised from the paper's figures
    remarks: tuple[str, ...]

    @property
    def results(self) -> tuple[Judged, ...]:
        """Verdicts of all sets."""
        return tuple(result for materials in self.sets for result in materials.results)


def check_paper(
    figures: tuple[int, ...],
    materials: Iterable[str],
    *,
    shipped: Collection[str],
    snr: SnrForm,
    height_m: float,
    as_paper: bool,
    sets: int,
    seed: int,
    digitised: Path | None,
    tell: Callable[[str], None],
) -> CheckedPaper:
    """Judge the statements about figures (all unless named) with each set of materials; `tell` takes each step.

    Raises ConfigError if a figure is not computed, or a file is wrong.
    """
    unknown = set(figures) - set(FIGURES)
    if unknown:
        raise ConfigError(f"--figure: {min(unknown)} is not computed; allowed: {', '.join(map(str, FIGURES))}")
    if sets and figures:
        raise ConfigError("--search counts all statements; leave out --figure")
    points = () if digitised is None else _read_digitised(digitised)
    checked = []
    for name in dict.fromkeys(materials):
        tell(f"{name}: computing")
        checked.append(
            _checked(name, figures, is_shipped=name in shipped, snr=snr, height_m=height_m, as_paper=as_paper)
        )
    tried = None
    if sets:
        first = checked[0]
        tried = search(
            first.scene, first.scenes, sets=sets, seed=seed, tell=lambda count: tell(f"search: {count} of {sets}")
        )
    return CheckedPaper(
        sets=tuple(checked),
        figures=figures or FIGURES,
        search=tried,
        points=points,
        remarks=tuple(_remarks(height_m, as_paper=as_paper)),
    )


def _checked(
    name: str, figures: tuple[int, ...], *, is_shipped: bool, snr: SnrForm, height_m: float, as_paper: bool
) -> MaterialSet:
    folder = files("rigctl") / "data" / "examples" / "paper"
    with as_file(folder / f"{name}.toml") if is_shipped else nullcontext(Path(name)) as path:
        scene, assumed = load_scene(path), _assumed_lines(path)
    label = name if is_shipped else Path(name).stem
    scenes = PaperScenes(scene, snr=snr, height_m=height_m)
    authors = scenes.as_authors() if as_paper else None
    return MaterialSet(
        name=label,
        scene=scene,
        scenes=scenes,
        as_paper=authors,
        results=judged(scenes, label, figures, as_paper=authors),
        assumed=(*assumed, *scenes.predictor.remarks),
    )


def _remarks(height_m: float, *, as_paper: bool) -> Iterable[str]:
    yield (
        f"assumed: {height_m / 1000:g} km where the paper states no height (Figs 9, 12 to 15; --height-m), "
        "and both views where it states none (Fig. 15)"
    )
    rooftop = ", ".join(f"{key} = {value:g}" for key, value in ASSUMED.items())
    yield f"assumed for section III (Figs 6 to 8): {rooftop}"
    yield "assumed for Fig. 2: sun, air and band of section V, because Table I of the paper is missing"
    if as_paper:
        yield (
            "as the paper computes: 3 x 3 tiles at their midpoints, a sky on a 10 deg grid, 1e5 draws of target and of "
            "background, DoLP SNR to first order; number of tiles and their place are assumed"
        )


def _read_digitised(path: Path) -> tuple[DigitisedPoint, ...]:
    """Return the points of a CSV file with the columns figure, panel, label, x, y."""
    try:
        rows = list(csv.DictReader(read_bounded(path, MOST_TEXT_BYTES).decode("utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    if not rows or not set(_POINT_COLUMNS) <= set(rows[0]):
        raise ConfigError(f"{path}: needs the header {','.join(_POINT_COLUMNS)} and one point per line")
    points = []
    for line, row in enumerate(rows, start=2):
        try:
            x, y = float(row["x"]), float(row["y"])
            if not (math.isfinite(x) and math.isfinite(y)):
                raise ValueError("x and y must be finite")
            points.append(DigitisedPoint(int(row["figure"]), row["panel"].strip(), row["label"], x, y))
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{path}, line {line}: {error}") from error
    return tuple(points)


def _assumed_lines(path: Path) -> tuple[str, ...]:
    """Return a text for each number of a scene file whose comment begins with 'assumed'."""
    table, assumed = "", []
    for line in read_bounded(path, MOST_TEXT_BYTES).decode("utf-8").splitlines():
        head, name, value = _TABLE.match(line), _NAME.match(line), _ASSUMED.match(line)
        if head is not None:
            table = f"{head['name']}."
        elif name is not None and table.startswith("regions."):
            table = f"regions.{name['name']}."
        if value is not None:
            why = f" ({value['why']})" if value["why"] else ""
            assumed.append(f"assumed: {table}{value['key']} = {value['value']}{why}")
    return tuple(assumed)
