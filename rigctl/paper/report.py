"""Tables, figures, page and files of the check of the paper."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.base.numbers import finite
from rigctl.paper.curves import Panel, PaperFigure, curves_of
from rigctl.paper.scenes import PANELS
from rigctl.paper.statements import IN_WORDS, Judged, Reading, Search, descriptions, labelled, statements
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
    from rigctl.paper.check import CheckedPaper, DigitisedPoint, MaterialSet
    from rigctl.report.files import Content


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


# Figures.


_PANEL_PIXELS = 120
_MOST_FALSE_ALARMS = 0.03
_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))


def _curves_png(figure: PaperFigure, beneath: Sequence[str], points: Sequence[DigitisedPoint] = ()) -> bytes:
    """Return a figure of curves, with digitised points of the paper's own figure over them."""
    columns = len(figure.panels)
    drawn, axes = subplots(1, columns, size=(max(6.4 * columns, 8.5), 4.8 + 0.16 * len(beneath)))
    for ax, panel in zip(axes, figure.panels, strict=True):
        _draw(ax, panel)
        if not panel.log_y:
            _overlay(ax, [one for one in points if one.panel in ("", panel.letter)])
        legend_below(ax)
    drawn.suptitle(f"[MK14] Fig. {figure.number}: {figure.title}", fontsize=11)
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
        (one.name, number): curves_of(number, one.scenes, as_paper=one.as_paper)
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


def _picture(found: CheckedPaper, one: MaterialSet, number: int, curves: PaperFigure | None) -> bytes:
    of_what = "the same for all materials" if number in _SAME_FOR_ALL else f"materials: {one.name}"
    verdicts = [
        f"{row.statement.id} {verdict_text(row)}: {row.statement.check}"
        for row in one.results
        if number in row.statement.figures
    ]
    beneath = (of_what, *(verdicts or (_NOTHING_STATED,)))
    points = [point for point in found.points if point.figure == number]
    if curves is not None:
        return _curves_png(curves, beneath, points)
    if number == 2:
        return sky_picture(sky_map(scene_of_file(one.scene)), title=(_FIG2,), beneath=beneath)
    panels = one.scenes.panels
    return _panels_png(panels, PANELS, beneath) if number == 6 else _laws_png(panels, PANELS, beneath, points)


def _points_table(curves: dict[tuple[str, int], PaperFigure | None]) -> Table[Any]:
    """Return the points of all curves for programs, one per row."""
    rows = tuple(
        (name, number, panel.letter, curve.label, x, y)
        for (name, number), figure in curves.items()
        for panel in (figure.panels if figure is not None else ())
        for curve in panel.curves
        for x, y in zip(curve.x, curve.y, strict=True)
    )
    return Table(columns=value_columns("materials", "figure", "panel", "label", "x", "y"), rows=rows)
