"""The paper checked with sets of materials: verdicts on its statements, its figures, a page and files.

`check_paper` judges the statements. Figures 5 and 7 to 15 are curves; points that were read off the paper's own figures
can be drawn over them.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.base.durable import MOST_TEXT_BYTES, read_bounded
from rigctl.base.numbers import finite
from rigctl.errors import ConfigError
from rigctl.files.choices import SnrForm
from rigctl.files.scene_file import SceneFile, load_scene
from rigctl.paper.scenes import (
    ANGLES_DEG,
    ASSUMED,
    DECIBELS,
    HEIGHTS_M,
    NOISE_FACTORS,
    P_FALSE_ALARM,
    PANELS,
    ROC_NOISE_FACTORS,
    SUNS_DEG,
    VIEWS_DEG,
    Geometry,
    PaperScenes,
    Source,
    low_light,
)
from rigctl.paper.statements import (
    ALL_DETECTED,
    IN_WORDS,
    UNPOLARIZED_SNR,
    Judged,
    Reading,
    Search,
    descriptions,
    judged,
    labelled,
    search,
    statements,
)
from rigctl.report.document import Column, Picture, Report, Section, Shown, Table, text_columns, value_columns
from rigctl.report.drawing import COLOURS, legend_below, legend_of_all, png, say_beneath, subplots
from rigctl.report.light import sky_picture
from rigctl.report.prediction import laws_of
from rigctl.scene.scene import scene_of_file
from rigctl.scene.sky_map import sky_map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.prediction import RegionPrediction
    from model.processing.dolp_studies import EstimatorError
    from rigctl.console import Json
    from rigctl.report.files import Content

FloatArray = NDArray[np.float64]

# Figures that are computed.
FIGURES = (2, *range(5, 16))
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


# Statements as tables, CSV and JSON.

# A page shows so many numbers of a statement; CSV and JSON have all of them.
_MOST_SHOWN = 8


def statement_json(one: Judged) -> dict[str, Json]:
    """Return a statement as programs read it."""
    content: dict[str, Json] = {
        "id": one.id,
        "figure": one.statement.figure,
        "sentence": one.statement.sentence,
        "geometry": one.statement.geometry,
        "check": one.statement.check,
        "numbers": {label: finite(number.value) for label, number in labelled(one.readings)},
        "margin": one.margin,
        "numerical_error": one.numerical_error,
        "verdict": one.verdict,
        "materials": one.materials,
        "readings": {reading.name: reading.verdict for reading in one.readings},
    }
    if one.as_paper:
        content["as_paper"] = {
            "numbers": {label: finite(number.value) for label, number in labelled(one.as_paper)},
            "verdict": one.as_paper_verdict,
        }
    return content


_WIDE = Shown.PAGE | Shown.CSV
_COLUMNS: tuple[Column[Judged], ...] = (
    Column(key="id", title="id", left=True, unbroken=True),
    Column(key="figure", value=lambda one: one.statement.figure, shown=Shown.CSV),
    Column(
        key="sentence", title="sentence", value=lambda one: one.statement.sentence, left=True, wide=True, shown=_WIDE
    ),
    Column(key="geometry", title="where", value=lambda one: one.statement.geometry, left=True, shown=_WIDE),
    Column(key="check", title="check", value=lambda one: one.statement.check, left=True),
    Column(
        key="numbers",
        title="numbers",
        value=lambda one: _all_numbers(one.readings),
        text=lambda one: _numbers_text(one),
        left=True,
        shown=_WIDE,
    ),
    Column(key="margin", title="margin", text=lambda one: "–" if one.margin is None else f"{one.margin:.3g}"),
    Column(
        key="numerical_error",
        title="num. error",
        text=lambda one: "–" if one.numerical_error is None else f"{one.numerical_error:.1g}",
    ),
    Column(
        key="verdict",
        title="verdict",
        text=lambda one: verdict_text(one),
        brief=lambda one: IN_WORDS[one.verdict],
        left=True,
    ),
    Column(key="materials", shown=Shown.CSV),
    Column(
        key="readings", value=lambda one: "; ".join(f"{r.name}: {r.verdict}" for r in one.readings), shown=Shown.CSV
    ),
    Column(key="as_paper_numbers", value=lambda one: _all_numbers(one.as_paper), shown=Shown.CSV),
    Column(key="as_paper_verdict", shown=Shown.CSV),
)


def statement_table(results: Sequence[Judged]) -> Table[Judged]:
    """Return the statements with their verdicts; page and CSV have the sentences and the numbers of each, too."""
    return Table(columns=_COLUMNS, rows=tuple(results), is_off=lambda one: one.verdict == "opposite")


def _all_numbers(readings: Sequence[Reading]) -> str:
    return "; ".join(f"{label} {number.value:.8g}" for label, number in labelled(readings))


def _numbers_text(one: Judged) -> str:
    numbers = labelled(one.readings)
    shown = numbers[:_MOST_SHOWN]
    more = f"; {len(numbers) - _MOST_SHOWN} more in statements.json" if len(numbers) > _MOST_SHOWN else ""
    text = "; ".join(f"{label} {number.value:.4g}" for label, number in shown) + more
    if not one.as_paper:
        return text
    theirs = {label: number.value for label, number in labelled(one.as_paper)}
    changed = "; ".join(
        f"{label} {theirs[label]:.4g} ({theirs[label] - number.value:+.2g})"
        for label, number in shown
        if label in theirs
    )
    return f"{text} | as the paper computes: {changed}"


def verdict_text(one: Judged) -> str:
    """Return the verdict, with that of each reading where they differ."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += " (" + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings) + ")"
    if one.as_paper_verdict is not None and one.as_paper_verdict != one.verdict:
        text += f"; as the paper computes: {IN_WORDS[one.as_paper_verdict]}"
    return text


def tally(found: Sequence[Judged]) -> str:
    """Return how many statements have each verdict."""
    counts = Counter(one.verdict for one in found)
    return ", ".join(f"{IN_WORDS[name]} {counts[name]}" for name in IN_WORDS if counts[name])


def search_lines(searched: Search | None) -> Iterable[str]:
    """Return the result of a search."""
    if searched is None:
        return
    most, numbers = searched.tried[0]
    own = next(held for held, drawn in searched.tried if not drawn)
    yield (
        f"search: {most} of {len(statements())} statements hold with the best of {len(searched.tried)} sets of "
        f"materials, {own} with the set given; {searched.impossible} impossible draws were made anew"
    )
    for key, value in numbers.items():
        yield f"  {key} = {value:.4g}"


def estimator_table(found: Mapping[str, EstimatorError], true_snr: Sequence[float]) -> Table[int]:
    """Return bias and rms error of estimators of DoLP, one row for each true signal-to-noise ratio."""
    columns: tuple[Column[int], ...] = (
        Column(title="true SNR", text=lambda k: f"{true_snr[k]:g}"),
        *(Column(title=name, text=partial(_bias_and_rms, of), unbroken=True) for name, of in found.items()),
    )
    return Table(title="bias/rms error", columns=columns, rows=tuple(range(len(true_snr))))


def _bias_and_rms(found: EstimatorError, k: int) -> str:
    return f"{found.bias[k]:+.3f}/{found.rms[k]:.3f}"


# Curves.

_AZIMUTHS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
_TURNED = "total, azimuth of path turned by 180 deg"


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A line, or points where `marker` says so."""

    label: str
    x: FloatArray
    y: FloatArray
    marker: str = "."
    line: str = "-"


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves over one pair of axes; the letter is the paper's."""

    letter: str
    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


# Title and panels of a figure of the paper as the model has it.
_Figure = tuple[str, tuple[Panel, ...]]


def _curve(label: str, x: Sequence[float] | FloatArray, y: Sequence[float] | FloatArray, **look: str) -> Curve:
    return Curve(label=label, x=np.asarray(x, dtype=np.float64), y=np.asarray(y, dtype=np.float64), **look)


def _fig5(_: PaperScenes) -> _Figure:
    law = low_light()
    panels = tuple(
        Panel(
            letter=letter,
            title=f"({letter}) {name} of DoLP",
            x_label="SNR of S0 [dB, amplitude]",
            y_label=f"{name} of DoLP",
            curves=(
                _curve("1e4 Poisson draws", DECIBELS, drawn, marker="o", line=""),
                _curve("first order, [MK14]", DECIBELS, first, marker="", line="--"),
                _curve("exact: Poisson counts", DECIBELS, exact, marker=""),
            ),
        )
        for letter, name, drawn, first, exact in (
            ("a", "mean", law.drawn_mean, law.first_mean, law.true_mean),
            ("b", "deviation", law.drawn_std, law.first_std, law.true_std),
        )
    )
    return "DoLP under shot noise, S = (1, 0.5, 0.5)", panels


def _fig7(scenes: PaperScenes) -> _Figure:
    panels = tuple(
        Panel(
            letter=letter,
            title=f"({letter}) {name}",
            x_label="angle of the polarizer [deg]",
            y_label=f"{name} of the counts [DN]",
            curves=tuple(
                _curve(label, ANGLES_DEG, [scenes.panel(panel, f"dn_{angle}", of).value for angle in ANGLES_DEG])
                for panel, label in PANELS.items()
            ),
        )
        for letter, name, of in (("a", "mean", "mean"), ("b", "deviation", "std"))
    )
    return "counts of the panels: sun 22, view 53, phi 180", panels


def _fig9(scenes: PaperScenes) -> _Figure:
    panels = []
    for letter, view in (("a", 10.0), ("b", 50.0)):
        at = [scenes.at(25.0, view, phi) for phi in _AZIMUTHS_DEG]
        curves = [
            _snr_curve(scenes, "reflected", _AZIMUTHS_DEG, at, source="reflected"),
            _snr_curve(scenes, "upwelling", _AZIMUTHS_DEG, at, source="path"),
            _snr_curve(scenes, "total", _AZIMUTHS_DEG, at),
            _snr_curve(scenes, _TURNED, _AZIMUTHS_DEG, at, turned=True),
        ]
        if scenes.snr_form == "exact":
            label = f"of unpolarized light, {UNPOLARIZED_SNR:.3f}"
            curves.append(_curve(label, _AZIMUTHS_DEG, [UNPOLARIZED_SNR] * len(at), marker="", line="-."))
        title = f"({letter}) sun 25, view {view:g}"
        panels.append(_snr_panel(scenes, letter, title, "relative azimuth phi [deg]", curves))
    return "parts of the light", tuple(panels)


def _fig10(scenes: PaperScenes) -> _Figure:
    at = [scenes.at(50.0, 50.0, height_m=height) for height in HEIGHTS_M]
    km, x_label = [height / 1000.0 for height in HEIGHTS_M], "height of the camera [km]"
    reflected = [_snr_curve(scenes, "reflected", km, at, source="reflected")]
    total = [_snr_curve(scenes, "total", km, at), _snr_curve(scenes, _TURNED, km, at, turned=True)]
    panels = (
        _snr_panel(scenes, "a", "(a) reflected radiance", x_label, reflected),
        _snr_panel(scenes, "b", "(b) total radiance", x_label, total),
    )
    return "sun 50, view 50, phi 180", panels


def _snr_curve(
    scenes: PaperScenes,
    label: str,
    x: Sequence[float],
    at: Sequence[Geometry],
    *,
    source: Source = "total",
    turned: bool = False,
) -> Curve:
    values = [scenes.snr(one, source=source, turned=turned).value for one in at]
    return _curve(label, x, values, line=":" if turned else "-")


def _snr_panel(scenes: PaperScenes, letter: str, title: str, x_label: str, curves: Sequence[Curve]) -> Panel:
    form = {"exact": "exact law", "first-order": "first order"}[scenes.snr_form]
    y_label = f"DoLP SNR of black paint, {form}"
    return Panel(letter=letter, title=title, x_label=x_label, y_label=y_label, curves=tuple(curves))


def _fig11(scenes: PaperScenes) -> _Figure:
    points = {f"{height / 1000:g} km": scenes.at(50.0, 50.0, height_m=height) for height in HEIGHTS_M}
    return "ROC by height", _roc(scenes, "a", "sun 50, view 50, phi 180", points)


def _roc(scenes: PaperScenes, letter: str, title: str, points: Mapping[str, Geometry]) -> tuple[Panel, ...]:
    """Return the curves, and those of misses where all lie at 1 from the rate of the statements on."""
    rocs = {label: scenes.roc(at) for label, at in points.items()}
    curves = tuple(_curve(label, roc.p_false_alarm, roc.p_detection, marker="") for label, roc in rocs.items())
    shown = Panel(
        letter=letter,
        title=title,
        x_label="probability of false alarm",
        y_label="probability of detection",
        curves=curves,
        log_x=True,
    )
    place = int(np.argmin(np.abs(curves[0].x - P_FALSE_ALARM)))
    if any(curve.y[place] <= ALL_DETECTED for curve in curves):
        return (shown,)
    missed = tuple(
        _curve(label, roc.p_false_alarm[roc.p_miss > 0.0], roc.p_miss[roc.p_miss > 0.0], marker="")
        for label, roc in rocs.items()
    )
    return shown, replace(
        shown,
        letter=f"{letter} missed",
        title=f"{title}: the same, 1 - P_D",
        y_label="probability of a miss",
        curves=missed,
        log_y=True,
    )


def _fig12(scenes: PaperScenes) -> _Figure:
    curves = [
        _snr_curve(scenes, f"view {view:g} deg", SUNS_DEG, [scenes.at(sun, view) for sun in SUNS_DEG])
        for view in VIEWS_DEG
    ]
    panel = _snr_panel(scenes, "a", "phi 180", "solar zenith angle [deg]", curves)
    return "DoLP SNR by sun and view", (panel,)


def _fig13(scenes: PaperScenes) -> _Figure:
    points = {f"sun {sun:g}, view {view:g}": scenes.at(sun, view) for sun in (10.0, 50.0) for view in VIEWS_DEG}
    return "ROC by geometry", _roc(scenes, "a", "phi 180", points)


def _fig14(scenes: PaperScenes) -> _Figure:
    curves = [
        _snr_curve(scenes, f"sun {sun:g} deg", NOISE_FACTORS, [scenes.at(sun, 40.0, kn=kn) for kn in NOISE_FACTORS])
        for sun in SUNS_DEG
    ]
    panel = _snr_panel(scenes, "a", "view 40, phi 180", "noise factor Kn", curves)
    return "DoLP SNR by noise factor", (panel,)


def _fig15(scenes: PaperScenes) -> _Figure:
    panels: list[Panel] = []
    for letter, view in zip("ab", VIEWS_DEG, strict=True):
        points = {f"Kn {kn:g}": scenes.at(50.0, view, kn=kn) for kn in ROC_NOISE_FACTORS}
        panels += _roc(scenes, letter, f"sun 50, view {view:g} (not stated), phi 180", points)
    return "ROC by noise factor", tuple(panels)


_DRAWN: dict[int, Callable[[PaperScenes], _Figure]] = {
    5: _fig5, 7: _fig7, 9: _fig9, 10: _fig10, 11: _fig11, 12: _fig12, 13: _fig13, 14: _fig14, 15: _fig15
}  # fmt: skip


def _curves_of(number: int, scenes: PaperScenes, *, as_paper: PaperScenes | None = None) -> _Figure | None:
    """Return the curves of a figure; None for Figs 2, 6 and 8, which are pictures and laws."""
    drawn = _DRAWN.get(number)
    if drawn is None:
        return None
    title, panels = drawn(scenes)
    if as_paper is None or number < 9:
        return title, panels
    theirs = {panel.letter: panel.curves for panel in drawn(as_paper)[1]}
    return title, tuple(
        replace(
            panel,
            curves=(
                *panel.curves,
                *(
                    replace(curve, label=f"{curve.label}, as the paper", line="--")
                    for curve in theirs.get(panel.letter, ())
                ),
            ),
        )
        for panel in panels
    )


# Figures.


_PANEL_PIXELS = 120
_MOST_FALSE_ALARMS = 0.03
_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))


def _curves_png(number: int, figure: _Figure, beneath: Sequence[str], points: Sequence[DigitisedPoint] = ()) -> bytes:
    """Return a figure of curves, with digitised points of the paper's own figure over them."""
    title, panels = figure
    columns = len(panels)
    drawn, axes = subplots(1, columns, size=(max(6.4 * columns, 8.5), 4.8 + 0.16 * len(beneath)))
    for ax, panel in zip(axes, panels, strict=True):
        _draw(ax, panel)
        if not panel.log_y:
            _overlay(ax, [one for one in points if one.panel in ("", panel.letter)])
        legend_below(ax)
    drawn.suptitle(f"[MK14] Fig. {number}: {title}", fontsize=11)
    say_beneath(drawn, beneath)
    return png(drawn)


def _draw(ax: Axes, panel: Panel) -> None:
    colours = len(COLOURS)
    for k, curve in enumerate(panel.curves):
        # Colours that repeat get dashed lines.
        line = "--" if k >= colours and curve.line == "-" else curve.line
        ax.plot(curve.x, curve.y, linestyle=line or "none", marker=curve.marker or None, label=curve.label)
    if panel.log_x:
        ax.set_xscale("log")
    if panel.log_y:
        ax.set_yscale("log")
        # At high false alarm rates the misses fall by many decades, which would hide the rest.
        shown = np.concatenate([curve.y[curve.x <= _MOST_FALSE_ALARMS] for curve in panel.curves])
        ax.set_ylim(0.1 * float(np.min(shown)), 10.0 * float(np.max(shown)))
    elif panel.log_x:
        ax.set_ylim(0.0, 1.03)
    else:
        ax.set_ylim(0.0, 1.05 * max(float(np.nanmax(curve.y)) for curve in panel.curves))
    ax.set_title(panel.title, fontsize=9)
    ax.set_xlabel(panel.x_label)
    ax.set_ylabel(panel.y_label)


def _overlay(ax: Axes, points: Sequence[DigitisedPoint]) -> None:
    for name in dict.fromkeys(point.label for point in points):
        own = [point for point in points if point.label == name]
        ax.plot([point.x for point in own], [point.y for point in own], "kx", markersize=6, label=f"digitised: {name}")


def _panels_png(predictions: Mapping[str, RegionPrediction], names: Mapping[str, str], beneath: Sequence[str]) -> bytes:
    """Return Fig. 6: S0 and DoLP of panels, each pixel drawn from the predicted law (seed 1)."""
    generator = np.random.default_rng(1)
    size = (_PANEL_PIXELS * _PANEL_PIXELS, 3)
    s0, degree = [], []
    for name in names:
        stokes = predictions[name].stokes_dn
        pixels = stokes.mean + generator.standard_normal(size) @ np.linalg.cholesky(stokes.cov).T
        s0.append(pixels[:, 0].reshape(_PANEL_PIXELS, -1))
        degree.append(np.hypot(pixels[:, 1], pixels[:, 2]).reshape(_PANEL_PIXELS, -1) / s0[-1])
    figure, axes = subplots(1, 2, size=(12.0, 4.0))
    for ax, parts, label, cmap in zip(axes, (s0, degree), ("S0 [DN]", "DoLP"), ("gray", "magma"), strict=True):
        shown = ax.imshow(np.hstack(parts), cmap=cmap, vmin=0.0)
        ax.set_title(f"{label}: {', '.join(names.values())} (left to right)", fontsize=9)
        ax.set_xlabel("x [pixel]")
        ax.set_ylabel("y [pixel]")
        figure.colorbar(shown, ax=ax, label=label, shrink=0.8)
    figure.suptitle("[MK14] Fig. 6: panels drawn from the predicted law; no picture of the authors", fontsize=11)
    say_beneath(figure, beneath)
    return png(figure)


def _laws_png(
    predictions: Mapping[str, RegionPrediction],
    names: Mapping[str, str],
    beneath: Sequence[str],
    points: Sequence[DigitisedPoint] = (),
) -> bytes:
    """Return Fig. 8 (b): laws of s1, s2 and DoLP of the panels' pixels, exact and, dashed, Gaussian to first order."""
    figure, axes = subplots(1, 3, size=(14.0, 4.6 + 0.16 * len(beneath)))
    quantities = ("s1n", "s2n", "dolp")
    for name, label in names.items():
        one = predictions[name]
        for ax, quantity, (x, density) in zip(axes, quantities, laws_of(one), strict=True):
            # Thin over broad, so that both are visible where they coincide.
            (line,) = ax.plot(x, density, linewidth=4.0, alpha=0.35, label=f"{label}, exact")
            mean, std = one.quantities[quantity]["mean"], one.quantities[quantity]["std"]
            gauss = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
            ax.plot(x, gauss, "--", color=line.get_color(), linewidth=1.4, label=f"{label}, first order")
    for letter, ax, label in zip("abc", axes, ("s1 = S1/S0", "s2 = S2/S0", "DoLP"), strict=True):
        _overlay(ax, [one for one in points if one.panel in ("", letter)])
        ax.set_xlabel(f"{label} of a pixel")
        ax.set_ylabel("density")
        ax.locator_params(axis="x", nbins=6)
        ax.set_ylim(bottom=0.0)
        legend_below(ax)
    figure.suptitle("[MK14] Fig. 8 (b): sun 22, view 53, phi 180", fontsize=11)
    say_beneath(figure, beneath)
    return png(figure)


def estimator_plot(true_snr: NDArray[np.float64], errors: Mapping[str, EstimatorError]) -> bytes:
    """Return bias and rms error of every estimator against the true signal-to-noise ratio."""
    figure, axes = subplots(1, 2, size=(11.0, 4.2))
    for (name, found), dash in zip(errors.items(), _DASHES, strict=True):
        axes[0].plot(true_snr, found.bias, linestyle=dash, label=name)
        axes[1].plot(true_snr, found.rms, linestyle=dash, label=name)
    for ax, label in zip(axes, ("bias", "rms error"), strict=True):
        ax.set_xlabel("true DoLP / deviation")
        ax.set_ylabel(f"{label} / deviation")
        ax.axhline(0.0 if label == "bias" else 1.0, color="0.8", linewidth=1.0)
    legend_of_all(figure, axes[1])
    return png(figure)


# The page and the files.


_NOTHING_STATED = "The text describes this figure without a claim that could be tested."
_MEANING = (
    "Holds, opposite: by more than three numerical errors. Saturated at 1: every P_D compared is above 0.999. Needs "
    "unpublished data: the sentence compares with measured points that were not published. Noise floor: the exact DoLP "
    "SNRs are below 2.1; unpolarized light has 1.913. Ambiguous: some readings of the sentence hold and others do not. "
    "A statement may fail here and hold with the authors' materials, whose optical properties were not published."
)


def paper_files(found: CheckedPaper) -> dict[str, Content]:
    """Return the page, statements, curves and pictures as files."""
    curves = {
        (one.name, number): _curves_of(number, one.scenes, as_paper=one.as_paper)
        for one in found.sets
        for number in found.figures
    }
    pictures = {
        f"fig{number}-{'model' if number in _SAME_FOR_ALL else one.name}.png": _picture(
            found, one, number, curves[one.name, number]
        )
        for number in found.figures
        for one in found.sets[: 1 if number in _SAME_FOR_ALL else None]
    }
    statements = [statement_json(one) for one in found.results]
    return {
        "paper.html": _report(found, pictures),
        "statements.json": (json.dumps(statements, indent=2, allow_nan=False) + "\n").encode(),
        "statements.csv": statement_table(found.results),
        "curves.csv": _points_table(curves),
        **pictures,
    }


def _report(found: CheckedPaper, pictures: Mapping[str, bytes]) -> Report:
    tallies = tuple(f"{one.name}: {tally(one.results)}" for one in found.sets)
    sections = [Section(title="Verdicts", blocks=(tallies, _MEANING))]
    for number in found.figures:
        shown = [Picture(png=png, caption=name) for name, png in pictures.items() if name.startswith(f"fig{number}-")]
        rows = [one for one in found.results if number in one.statement.figures]
        judged = [statement_table(rows)] if rows else [(_NOTHING_STATED)]
        drawn = [(sentence, here) for figure, sentence, here in descriptions() if figure == number]
        described = text_columns("description in the text", "here", left=(0, 1), wide=0)
        blocks = (*shown, *judged, Table(columns=described, rows=tuple(drawn)))
        sections.append(Section(title=f"Fig. {number}", blocks=blocks))
    if found.search is not None:
        note = "Computed without a tolerance; confirm a set with --materials."
        sections.append(Section(title="Search", blocks=((*search_lines(found.search), note),)))
    sections.append(Section(title="Assumed", blocks=(found.remarks,)))
    sections += [Section(title=f"Assumed in {one.name}", blocks=(one.assumed,), folded=True) for one in found.sets]
    return Report(
        title="[MK14] figure by figure and sentence by sentence",
        source="Meng & Kerekes, An Analytical Model for Optical Polarimetric Imaging Systems, IEEE TGRS 2014",
        sections=sections,
    )


_SAME_FOR_ALL = (2, 5)
_FIG2 = (
    "[MK14] Fig. 2: Stokes parameters and DoLP of the sky, with sun and air of section V, because Table I is missing"
)


def _picture(found: CheckedPaper, one: MaterialSet, number: int, curves: _Figure | None) -> bytes:
    of_what = "the same for all materials" if number in _SAME_FOR_ALL else f"materials: {one.name}"
    verdicts = [
        f"{row.statement.id} {verdict_text(row)}: {row.statement.check}"
        for row in one.results
        if number in row.statement.figures
    ]
    beneath = (of_what, *(verdicts or (_NOTHING_STATED,)))
    points = [point for point in found.points if point.figure == number]
    if curves is not None:
        return _curves_png(number, curves, beneath, points)
    if number == 2:
        return sky_picture(sky_map(scene_of_file(one.scene)), title=(_FIG2,), beneath=beneath)
    panels = one.scenes.panels
    return _panels_png(panels, PANELS, beneath) if number == 6 else _laws_png(panels, PANELS, beneath, points)


def _points_table(curves: dict[tuple[str, int], _Figure | None]) -> Table[Any]:
    """Return the points of all curves for programs, one per row."""
    rows = tuple(
        (name, number, panel.letter, curve.label, x, y)
        for (name, number), figure in curves.items()
        for panel in (() if figure is None else figure[1])
        for curve in panel.curves
        for x, y in zip(curve.x, curve.y, strict=True)
    )
    return Table(columns=value_columns("materials", "figure", "panel", "label", "x", "y"), rows=rows)
