"""A report as one self-contained HTML page, as pieces for a notebook, and as files in a folder."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from rigctl.base.destination import require_replaceable
from rigctl.base.durable import write_durably
from rigctl.console import told
from rigctl.report.table import Shown

if TYPE_CHECKING:
    from rigctl.report.document import Block, Report
    from rigctl.report.table import AnyTable


def html(report: Report) -> str:
    """Return the report as self-contained HTML."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_finished
    )
    environment.tests["kind"] = _is_kind
    environment.filters["base64"] = _embedded
    environment.globals.update(page=Shown.PAGE)
    template = environment.from_string((files("rigctl") / "data" / "report.html.j2").read_text(encoding="utf-8"))
    return template.render(report=report)


def _is_kind(block: Block, kind: str) -> bool:
    return type(block).__name__ == kind


def _embedded(png: bytes) -> Markup:
    return Markup(base64.b64encode(png).decode("ascii"))


def _finished(value: object) -> object:
    """Return a value for display."""
    return told(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def table_fragment(table: AnyTable, *, most: int = 60) -> str:
    """Return a table, shortened to `most` rows with the total number."""
    columns = table.shown(Shown.TERMINAL)
    title = f"<caption>{escape(table.title)}</caption>" if table.title else ""
    head = "".join(f"<th>{escape(column.title)}</th>" for column in columns)
    texts = table.texts(Shown.TERMINAL)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in texts[:most])
    rest = lines_fragment([f"{most} of {len(texts)} rows"]) if len(texts) > most else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{rest}"


def lines_fragment(lines: Iterable[str]) -> str:
    """Return lines of text, each a paragraph."""
    return "".join(f"<p>{escape(line)}</p>" for line in lines)


def picture_fragment(png: bytes, *, width_px: int = 640) -> str:
    """Return a picture that needs no other file."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img style="max-width:{width_px}px;width:100%" src="data:image/png;base64,{data}">'


def report_file(report: Report, path: Path) -> bytes:
    """Return the report as PDF if the file's name ends in .pdf, as HTML otherwise."""
    if path.suffix.lower() == ".pdf":
        from rigctl.report.pdf import pdf

        return pdf(report)

    return html(report).encode()


def write_folder(out: Path, contents: Mapping[str, bytes]) -> tuple[str, ...]:
    """Write files into a folder, which is created if needed; return their names.

    Results of rigctl with the same names are replaced, those of other commands only if forced.
    """
    require_replaceable(out / name for name in contents)
    out.mkdir(parents=True, exist_ok=True)
    for name, data in contents.items():
        write_durably(out / name, data)
    return tuple(contents)
