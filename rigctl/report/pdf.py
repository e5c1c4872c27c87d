"""A report as PDF, by reportlab."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Iterable
from typing import Any
from xml.sax.saxutils import escape

from reportlab import rl_config
from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.platypus import Image, KeepTogether, Paragraph, Preformatted, SimpleDocTemplate, Spacer
from reportlab.platypus import Table as Grid

from rigctl.console import anonymized
from rigctl.report.document import AnyTable, Column, Picture, Report, Section, Shown, block_kind

# Raw bytes: base 85 makes a file a quarter longer and doubles the time.
rl_config.useA85 = 0

_MARGIN = 17 * mm
_WIDTH = A4[0] - 2 * _MARGIN
_HEIGHT = A4[1] - 2 * _MARGIN - 12 * mm
# Most printed lines of provenance; the JSON file has all.
_VERBATIM_LINES, _VERBATIM_COLUMNS = 120, 118
# A small picture stays small.
_POINTS_PER_PIXEL = 0.6
_TABLE_POINTS, _LEAST_POINTS, _CELL_PADDING = 7.0, 4.6, 5.5
_BLUE, _ORANGE, _PALE = colors.HexColor("#0072b2"), colors.HexColor("#d55e00"), colors.HexColor("#fbe9df")
# Characters of the standard fonts of PDF.
_TRANSLATED = str.maketrans({"–": "-", "−": "-", "±": "±"})

_BODY = ParagraphStyle("body", fontName="Helvetica", fontSize=8.5, leading=11.5, spaceAfter=4)
_CELL = ParagraphStyle("cell", fontName="Helvetica", fontSize=_TABLE_POINTS, leading=_TABLE_POINTS + 1.5)
_CAPTION = ParagraphStyle("caption", parent=_BODY, fontSize=7.5, leading=9.5, textColor=colors.HexColor("#444444"))
_TITLE = ParagraphStyle("title", fontName="Helvetica-Bold", fontSize=15, leading=19, spaceAfter=3)
_HEADING = ParagraphStyle("heading", fontName="Helvetica-Bold", fontSize=11, leading=14, spaceBefore=9, spaceAfter=4)
_CODE = ParagraphStyle("code", fontName="Courier", fontSize=6, leading=7.2)


def pdf(report: Report) -> bytes:
    """Return the report as the bytes of a PDF file with today's date, or that of SOURCE_DATE_EPOCH: the same bytes."""
    buffer = io.BytesIO()
    document = SimpleDocTemplate(
        buffer,
        pagesize=A4,
        leftMargin=_MARGIN,
        rightMargin=_MARGIN,
        topMargin=_MARGIN,
        bottomMargin=_MARGIN,
        title=_plain(report.title),
        author="rigctl",
    )
    document.build(list(_flow(report)), onFirstPage=_page_number, onLaterPages=_page_number)
    return buffer.getvalue()


def _flow(report: Report) -> Iterable[Any]:
    yield Paragraph(_safe(report.title), _TITLE)
    yield Paragraph(_safe(report.source), _CAPTION)
    yield Spacer(1, 4)
    if report.verdict:
        yield from (_verdict(report), Spacer(1, 6))
    for section in filter(lambda section: section.printed, report.sections):
        yield from _section(section)


def _verdict(report: Report) -> Grid:
    lines = [Paragraph(f"<b>{_safe(report.verdict)}</b>", ParagraphStyle("v", parent=_BODY, fontSize=11, leading=14))]
    lines += [Paragraph(_bold_before(word, text), _BODY) for word, text in report.reasons]
    style = [
        ("BACKGROUND", (0, 0), (-1, -1), colors.HexColor("#f4f6f8")),
        ("LINEBEFORE", (0, 0), (0, -1), 4, _BLUE if report.good else _ORANGE),
        ("LEFTPADDING", (0, 0), (-1, -1), 9),
    ]
    return Grid([[line] for line in lines], colWidths=[_WIDTH], style=style)


def _bold_before(word: str, text: str) -> str:
    return (f"<b>{_safe(word)}</b> " if word else "") + _safe(text)


def _section(section: Section) -> Iterable[Any]:
    if not section.title:
        for block in section.blocks:
            yield from _drawn(block)
        return
    heading = Paragraph(_safe(section.title), _HEADING)
    for place, block in enumerate(section.blocks):
        drawn = _drawn(block)
        # A heading stays with its content, a picture with its caption; a table may be longer than a page.
        if block_kind(block) in ("table", "verbatim"):
            heading.keepWithNext = place == 0
            yield from [heading, *drawn] if place == 0 else drawn
        else:
            yield KeepTogether([heading, *drawn] if place == 0 else drawn)


def _drawn(block: Any) -> list[Any]:
    match block_kind(block):
        case "paragraph":
            return [Paragraph(_safe(block), _BODY)]
        case "bullets":
            return [Paragraph(_safe(text), _BODY, bulletText="-") for text in block]
        case "picture":
            return _picture(block)
        case "pictures":
            return _pictures(block)
        case "verbatim":
            return _verbatim(block)
    return _table(block)


def _picture(block: Picture) -> list[Any]:
    width, height = ImageReader(io.BytesIO(block.png)).getSize()
    scale = min(_WIDTH / width, 0.8 * _HEIGHT / height, _POINTS_PER_PIXEL)
    image = Image(io.BytesIO(block.png), width=scale * width, height=scale * height)
    return [image, Paragraph(_safe(block.caption), _CAPTION)] if block.caption else [image]


def _pictures(pictures: tuple[Picture, ...]) -> list[Any]:
    sizes = [ImageReader(io.BytesIO(one.png)).getSize() for one in pictures]
    scale = min(_WIDTH / sum(width for width, _ in sizes), _POINTS_PER_PIXEL)
    images = [
        Image(io.BytesIO(one.png), width=scale * width, height=scale * height)
        for one, (width, height) in zip(pictures, sizes, strict=True)
    ]
    return [
        Grid(
            [images],
            colWidths=[scale * width for width, _ in sizes],
            style=[
                ("VALIGN", (0, 0), (-1, -1), "TOP"),
                *((f"{side}PADDING", (0, 0), (-1, -1), 0) for side in ("LEFT", "RIGHT")),
            ],
        )
    ]


def _verbatim(text: str) -> list[Any]:
    lines = _plain(text).splitlines()
    shown = [line[:_VERBATIM_COLUMNS] for line in lines[:_VERBATIM_LINES]]
    if len(lines) > len(shown):
        shown.append(f"... {len(lines) - len(shown)} more lines in comparison.json")
    return [Preformatted("\n".join(shown), _CODE)]


def _table(block: AnyTable) -> list[Any]:
    if not block.rows:
        return []
    columns, texts = block.shown(Shown.PAGE), block.texts(Shown.PAGE)
    points, widths, breaks = _fitted(columns, texts)
    head = _head(block, columns, points)
    # Text without line breaks is drawn ten times as fast as a paragraph.
    grid: list[list[Any]] = [
        [
            _cell(text, column, points) if broken else _plain(text)
            for text, column, broken in zip(row, columns, breaks, strict=True)
        ]
        for row in texts
    ]
    last = len(head) - 1
    style: list[Any] = [
        ("FONT", (0, 0), (-1, -1), "Helvetica", points, points + 1.5),
        *(("ALIGN", (k, 0), (k, -1), "LEFT" if column.left else "RIGHT") for k, column in enumerate(columns)),
        *([("LINEBELOW", (0, 0), (-1, last), 0.6, colors.grey)] if head else []),
        ("LINEBELOW", (0, last + 1), (-1, -1), 0.2, colors.lightgrey),
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        *((side, (0, 0), (-1, -1), 2) for side in ("LEFTPADDING", "RIGHTPADDING")),
        *((side, (0, 0), (-1, -1), 1) for side in ("TOPPADDING", "BOTTOMPADDING")),
        *_spans(block),
        *(("BACKGROUND", (0, k), (-1, k), _PALE) for k, row in enumerate(block.rows, last + 1) if block.is_off(row)),
    ]
    return [Grid([*head, *grid], colWidths=widths, style=style, repeatRows=len(head), hAlign="LEFT"), Spacer(1, 4)]


def _head(block: AnyTable, columns: tuple[Column[Any], ...], points: float) -> list[list[Any]]:
    """Return the lines of headings: of groups of columns, if any, and of columns."""
    rows = []
    if groups := block.groups():
        centred = ParagraphStyle("group", parent=_style(points, "Helvetica-Bold"), alignment=1)
        rows.append([cell for name, span in groups for cell in (Paragraph(_safe(name), centred), *[""] * (span - 1))])
    if any(column.title for column in columns):
        rows.append([_cell(column.title, column, points, font="Helvetica-Bold") for column in columns])
    return rows


def _spans(block: AnyTable) -> Iterable[tuple[Any, ...]]:
    first = 0
    for _, span in block.groups():
        yield "SPAN", (first, 0), (first + span - 1, 0)
        first += span


def _cell(text: str, column: Column[Any], points: float, *, font: str = "Helvetica") -> Paragraph:
    style = _style(points, font)
    return Paragraph(_safe(text), style if column.left else ParagraphStyle("right", parent=style, alignment=2))


def _style(points: float, font: str) -> ParagraphStyle:
    return ParagraphStyle(font, parent=_CELL, fontName=font, fontSize=points, leading=points + 1.5)


def _fitted(columns: tuple[Column[Any], ...], texts: list[tuple[str, ...]]) -> tuple[float, list[float], list[bool]]:
    """Return font size, column widths for a table on the page, and the columns whose cells wrap."""
    points = _TABLE_POINTS
    natural = [_natural_width(column, [row[k] for row in texts]) for k, column in enumerate(columns)]
    widths = [width + _CELL_PADDING for width in natural]
    wide = next((k for k, column in enumerate(columns) if column.wide), None)
    if wide is not None:
        widths[wide] = max(_WIDTH - sum(widths) + widths[wide], 0.25 * _WIDTH)
    elif sum(widths) > _WIDTH:
        room = _WIDTH - _CELL_PADDING * len(columns)
        points = max(_LEAST_POINTS, _TABLE_POINTS * room / sum(natural))
        widths = [points / _TABLE_POINTS * width + _CELL_PADDING for width in natural]
    scale = min(1.0, _WIDTH / sum(widths))
    return points, [scale * width for width in widths], [scale < 1.0 or column.wide for column in columns]


def _natural_width(column: Column[Any], cells: list[str]) -> float:
    """Return the width of a column: headers wrap between words, cells only in the wide column."""
    widths = [stringWidth(word, "Helvetica-Bold", _TABLE_POINTS) for word in _plain(column.title).split()]
    widths += [stringWidth(_plain(cell), "Helvetica", _TABLE_POINTS) for cell in cells]
    return float(max(widths, default=0.0))


def _page_number(canvas: Any, document: Any) -> None:
    canvas.saveState()
    canvas.setFont("Helvetica", 7)
    canvas.drawString(
        _MARGIN,
        10 * mm,
        time.strftime("%Y-%m-%d", time.gmtime(float(os.environ.get("SOURCE_DATE_EPOCH") or time.time()))),
    )
    canvas.drawRightString(A4[0] - _MARGIN, 10 * mm, f"page {document.page}")
    canvas.restoreState()


def _plain(text: str) -> str:
    return anonymized(text).translate(_TRANSLATED)


def _safe(text: str) -> str:
    return escape(_plain(text))
