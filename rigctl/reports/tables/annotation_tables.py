"""What people noted of a run, as a section of reports and as JSON."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from rigctl.console.json_text import Json
from rigctl.reports.report import Section
from rigctl.reports.table import Column, Table
from rigctl.runs.annotation_record import Annotation, frames_text

if TYPE_CHECKING:
    from rigctl.runs.run_folder import Run

_TITLE = "Notes and exclusions"


def annotation_table(annotations: Sequence[Annotation]) -> Table[Annotation]:
    """Return what is noted of a run, line by line."""
    columns: tuple[Column[Annotation], ...] = (
        Column(title="when", text=lambda one: f"{one.utc[:19]}Z", left=True),
        Column(title="by", text=lambda one: one.by, left=True),
        Column(title="what", text=lambda one: one.kind, left=True),
        Column(title="frames", text=lambda one: frames_text(one.frames), left=True),
        Column(title="text", text=lambda one: one.text, left=True, wide=True),
    )
    return Table(columns=columns, rows=tuple(annotations))


def annotation_sections(annotations: Sequence[Annotation]) -> Iterable[Section]:
    """Give the section of a report on what is noted of a run; none where nothing is."""
    if annotations:
        yield Section(title=_TITLE, blocks=(annotation_table(annotations),))


def annotations_json(annotations: Sequence[Annotation]) -> list[Json]:
    """Return what is noted of a run as JSON holds it."""
    return [asdict(one) for one in annotations]


def annotations_of(run: "Run", left_out: Sequence[str]) -> dict[str, Json]:
    """Return what a result in JSON says of an annotated run: all that is noted, and which frames are not used."""
    return {"annotations": annotations_json(run.annotations), "left_out": list(left_out)} if run.annotations else {}
