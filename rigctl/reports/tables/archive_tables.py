"""Rows of an archive as a table."""

from collections.abc import Callable, Mapping, Sequence

from rigctl.archive.columns import COLUMNS, IndexColumn
from rigctl.archive.health import RunHealth
from rigctl.archive.run_facts import Fact
from rigctl.reports.table import Column, Shown, Table

# What fits a terminal; programs get all.
_FOR_PEOPLE = ("run", "utc", "sun_zenith", "state", "verdict", "region", "dolp", "dolp_sigma", "aolp_deg")
_UTC_MINUTES = 16
_Row = Mapping[str, Fact]


def found_table(rows: Sequence[_Row]) -> Table[_Row]:
    """Return rows of an archive, every column of the index for programs."""
    return Table(columns=tuple(map(_column, COLUMNS)), rows=tuple(rows))


def _column(column: IndexColumn) -> Column[_Row]:
    shown = Shown.EVERYWHERE if column.name in _FOR_PEOPLE else Shown.PROGRAMS
    return Column(
        title=column.name,
        key=column.name,
        value=lambda row: row[column.name],
        text=_text(column.name),
        left=column.kind == "text",
        shown=shown,
    )


def _text(name: str) -> Callable[[_Row], str]:
    def text(row: _Row) -> str:
        value = row[name]
        if value is None:
            return ""
        if isinstance(value, str):
            return value[:_UTC_MINUTES] if name == "utc" else value
        return f"{value:.5g}"

    return text


def health_table(runs: Sequence[RunHealth]) -> Table[RunHealth]:
    """Return how a rig fared, run by run."""
    columns: tuple[Column[RunHealth], ...] = (
        Column(title="run", text=lambda one: one.run, left=True),
        Column(title="begun", text=lambda one: one.utc[:16], left=True),
        Column(title="camera", text=lambda one: one.camera, left=True),
        Column(title="stage", text=lambda one: one.stage, left=True),
        Column(title="off target [deg]", text=lambda one: _short(one.stage_error_deg)),
        Column(title="tries", text=lambda one: _short(one.stage_tries)),
        Column(title="lost", text=lambda one: _short(one.lost_frames)),
        Column(title="dark [DN]", text=lambda one: _short(one.dark_dn)),
        Column(title="gain [DN/e]", text=lambda one: _short(one.gain_dn_per_e)),
        Column(title="axis [deg]", text=lambda one: _short(one.axis_deg)),
        Column(title="clock [ppm]", text=lambda one: _short(one.clock_ppm)),
        Column(title="deg C", text=lambda one: _short(one.temperature_c)),
    )
    return Table(columns=columns, rows=tuple(runs))


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
