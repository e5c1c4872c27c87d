"""A report as one HTML file that holds all of it."""

import base64
from importlib.resources import files

from jinja2 import Environment, StrictUndefined

from rigctl.reports.report import Block, Report


def render(report: Report) -> str:
    """Return the report as HTML that needs no other file."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.tests["kind"] = _is_kind
    environment.filters["base64"] = _embedded
    template = environment.from_string((files("rigctl") / "data" / "report.html.j2").read_text(encoding="utf-8"))
    return template.render(report=report)


def _is_kind(block: Block, kind: str) -> bool:
    return type(block).__name__ == kind


def _embedded(png: bytes) -> str:
    return base64.b64encode(png).decode("ascii")
