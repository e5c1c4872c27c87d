"""Results as files in a folder: pages, PDF, CSV, JSON, FITS; and as pieces of HTML for a notebook.

The name of a file says how its content is written: a `Report` as .html or .pdf, a `Table` as .csv, a mapping as .json.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from markupsafe import Markup

from rigctl.base.destination import require_replaceable
from rigctl.base.durable import write_durably
from rigctl.console import Json, anonymized, anonymized_content, json_text
from rigctl.report.document import AnyTable, Report, Shown, Table, block_kind
from rigctl.version import VERSION

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rigctl.runs.fits import CardValue

Content: TypeAlias = "bytes | AnyTable | Report | Mapping[str, Json]"


def write_folder(out: Path, contents: Mapping[str, Content]) -> tuple[str, ...]:
    """Write files into a folder, which is created if needed; return their names.

    Results of rigctl with the same names are replaced, those of other commands only if forced.
    """
    require_replaceable(out / name for name in contents)
    out.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_durably(out / name, encoded(content, name))
    return tuple(contents)


def encoded(content: Content, name: str) -> bytes:
    """Return the bytes of a file with this name; bytes are as they are."""
    if isinstance(content, bytes):
        return content
    if isinstance(content, Table):
        return content.csv().encode()
    if not isinstance(content, Report):
        return json_text(anonymized_content(content)).encode()
    if name.lower().endswith(".pdf"):
        from rigctl.report.pdf import pdf

        return pdf(content)
    return html(content).encode()


def html(report: Report) -> str:
    """Return the report as one self-contained HTML page."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_finished
    )
    environment.filters.update(kind=block_kind, base64=_base64)
    environment.globals.update(page=Shown.PAGE)
    template = environment.from_string((files("rigctl") / "data" / "report.html.j2").read_text(encoding="utf-8"))
    return template.render(report=report)


def _base64(png: bytes) -> Markup:
    return Markup(base64.b64encode(png).decode("ascii"))


def _finished(value: object) -> object:
    return anonymized(value) if isinstance(value, str) and not isinstance(value, Markup) else value


# Rows of a table and width of a picture in a notebook.
_MOST_ROWS, _WIDTH_PX = 60, 640


def notebook_html(parts: Iterable[str | AnyTable | Callable[[], bytes]]) -> str:
    """Return sentences, tables and pictures as pieces of HTML that need no other file."""
    return "".join(map(_fragment, parts))


def _fragment(part: str | AnyTable | Callable[[], bytes]) -> str:
    if isinstance(part, str):
        return f"<p>{escape(part)}</p>"
    if callable(part):
        return f'<img style="max-width:{_WIDTH_PX}px;width:100%" src="data:image/png;base64,{_base64(part())}">'
    title = f"<caption>{escape(part.title)}</caption>" if part.title else ""
    head = "".join(f"<th>{escape(column.title)}</th>" for column in part.shown(Shown.TERMINAL))
    texts = part.texts(Shown.TERMINAL)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in texts[:_MOST_ROWS])
    rest = _fragment(f"{_MOST_ROWS} of {len(texts)} rows") if len(texts) > _MOST_ROWS else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{rest}"


def fits_image(image: NDArray[np.generic], *, unit: str, what: str) -> bytes:
    """Return an image, or a stack of them, as the bytes of a FITS file."""
    from rigctl.runs.fits import encode_image

    cards: dict[str, tuple[CardValue, str]] = {
        "BUNIT": (unit, "unit of the samples"),
        "ROWORDER": ("TOP-DOWN", "first row is the top of the picture"),
        "CONTENT": (what, ""),
        "SWVER": (f"rigctl {VERSION}", ""),
    }
    return encode_image(image, cards)
