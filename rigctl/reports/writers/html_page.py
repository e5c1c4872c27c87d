"""A report as one HTML page that needs no other file."""

import base64
from importlib.resources import files
from itertools import groupby

from jinja2 import Environment, StrictUndefined

from rigctl.reports.report import Block, Report
from rigctl.reports.table import AnyTable, Shown


def html(report: Report) -> str:
    """Return the report as HTML that needs no other file."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.tests["kind"] = _is_kind
    environment.filters["base64"] = _embedded
    environment.globals.update(groups=column_groups, page=Shown.PAGE)
    template = environment.from_string((files("rigctl") / "data" / "report.html.j2").read_text(encoding="utf-8"))
    return template.render(report=report)


def column_groups(table: AnyTable) -> list[tuple[str, int]]:
    """Return the headings over columns of a page and how many columns each spans; nothing where there are none."""
    groups = [column.group for column in table.shown(Shown.PAGE)]
    return [(name, len(list(same))) for name, same in groupby(groups)] if any(groups) else []


def _is_kind(block: Block, kind: str) -> bool:
    return type(block).__name__ == kind


def _embedded(png: bytes) -> str:
    return base64.b64encode(png).decode("ascii")
