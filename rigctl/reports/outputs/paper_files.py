"""The files of a check of the paper: a page, statements as CSV and JSON, a picture of each figure."""

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path

from rigctl.paper.curves import PaperFigure, curves_of
from rigctl.paper.paper_result import MaterialSet, PaperResult
from rigctl.paper.results import figures_of
from rigctl.paper.rooftop import PANELS
from rigctl.reports.figures.paper_figures import curves_png, laws_figure_png, panels_png
from rigctl.reports.figures.scene_figures import sky_picture
from rigctl.reports.pages.paper_page import NOTHING_STATED, paper_report
from rigctl.reports.tables.paper_tables import statement_csv, statement_json, verdict_lines
from rigctl.reports.writers.html_page import html
from rigctl.reports.writers.output_folder import write_folder
from rigctl.scene.sky_map import sky_map

_SAME_FOR_ALL = (2, 5)
_FIG2 = (
    "[MK14] Fig. 2: Stokes parameters and DoLP of the sky, with the sun and air of section V: Table I is not at hand"
)


def write_paper(found: PaperResult, out: Path) -> tuple[str, ...]:
    """Write paper.html, statements.csv, statements.json, curves.csv and fig*.png; return their names."""
    curves = {(one.name, number): _curves(one, number) for one in found.sets for number in found.figures}
    pictures = dict(_pictures(found, curves))
    contents = {
        "paper.html": html(paper_report(found, pictures)).encode(),
        "statements.json": (json.dumps(statement_json(found.results), indent=2, allow_nan=False) + "\n").encode(),
        "statements.csv": statement_csv(found.results),
        "curves.csv": _curves_csv(curves),
        **pictures,
    }
    return write_folder(out, contents)


def _curves(one: MaterialSet, number: int) -> PaperFigure | None:
    return curves_of(number, one.scenes, as_paper=one.as_paper)


def _pictures(found: PaperResult, curves: dict[tuple[str, int], PaperFigure | None]) -> Iterable[tuple[str, bytes]]:
    for number in found.figures:
        for k, one in enumerate(found.sets):
            if number in _SAME_FOR_ALL and k > 0:
                continue
            label = "model" if number in _SAME_FOR_ALL else one.name
            yield f"fig{number}-{label}.png", _picture(found, one, number, curves[one.name, number])


def _picture(found: PaperResult, one: MaterialSet, number: int, curves: PaperFigure | None) -> bytes:
    rows = [row for row in one.results if number in figures_of(row.statement)]
    of_what = "the same for all materials" if number in _SAME_FOR_ALL else f"materials: {one.name}"
    beneath = (of_what, *(verdict_lines(rows) or (NOTHING_STATED,)))
    points = [point for point in found.points if point.figure == number]
    if curves is not None:
        return curves_png(curves, beneath, points)
    if number == 2:
        return sky_picture(sky_map(one.scene), title=(_FIG2,), beneath=beneath)
    panels = one.scenes.rooftop.predictions
    return panels_png(panels, PANELS, beneath) if number == 6 else laws_figure_png(panels, PANELS, beneath, points)


def _curves_csv(curves: dict[tuple[str, int], PaperFigure | None]) -> bytes:
    """Return the points of all curves: a row a point."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("materials", "figure", "panel", "label", "x", "y"))
    for (name, number), figure in curves.items():
        if figure is None:
            continue
        for panel in figure.panels:
            for curve in panel.curves:
                writer.writerows(
                    (name, number, panel.letter, curve.label, x, y) for x, y in zip(curve.x, curve.y, strict=True)
                )
    return text.getvalue().encode()
