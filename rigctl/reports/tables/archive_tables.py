"""Rows of an archive as a table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from textwrap import shorten

from rigctl.archive.columns import COLUMNS, IndexColumn
from rigctl.archive.health import RunHealth
from rigctl.archive.run_facts import Fact
from rigctl.archive.run_rows import RegionNumbers, RunRow, Verb
from rigctl.reports.table import Column, Shown, Table

# What fits a terminal; programs get all.
_FOR_PEOPLE = ("run", "utc", "sun_zenith", "state", "verdict", "region", "dolp", "dolp_sigma", "aolp_deg")
_UTC_MINUTES = 16
# As much of a reason stands in a terminal.
_WHY = 60
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


@dataclass(frozen=True, kw_only=True)
class RowOfRegion:
    """A run of a job over an archive and, where it has any, one of its regions."""

    run: RunRow
    region: RegionNumbers | None


def rows_by_region(rows: Sequence[RunRow]) -> tuple[RowOfRegion, ...]:
    """Return rows of runs, each as often as it has regions, once where it has none."""
    return tuple(RowOfRegion(run=row, region=region) for row in rows for region in (row.regions or (None,)))


def archive_table(rows: Sequence[RunRow], verb: Verb) -> Table[RowOfRegion]:
    """Return what came of each run and region: for programs all, for people what the job is about."""
    numbers: dict[Verb, tuple[str, ...]] = {
        "verify": (),
        "stokes": ("dolp", "dolp_sigma", "aolp_deg", "aolp_sigma_deg"),
        "compare": ("dolp", "dolp_sigma", "dolp_predicted", "dolp_z"),
        "recalibrate": ("dolp_before", "dolp", "dolp_sigma", "aolp_before_deg", "aolp_deg"),
    }
    on_page = Shown.PAGE | Shown.PROGRAMS
    of_run: tuple[Column[RunRow], ...] = (
        Column(title="run", key="run", left=True),
        Column(title="begun", key="utc", text=lambda row: row.utc[:_UTC_MINUTES], left=True, shown=on_page),
        Column(title="sun zenith [deg]", key="sun_zenith", text=lambda row: _short(row.sun_zenith), shown=on_page),
        Column(title="verdict", key="verdict", left=True),
        Column(key="exit_code", shown=Shown.PROGRAMS),
        Column(title="why", key="reason", brief=lambda row: shorten(in_short(row), _WHY), left=True, wide=True),
        Column(title="calibrations", key="calibrations", left=True, shown=on_page),
        Column(key="seconds", shown=Shown.PROGRAMS),
    )
    shown = numbers[verb]
    names = [] if verb == "verify" else [one.name for one in fields(RegionNumbers)]
    of_region = (_of_region(name, name in (*shown, "region")) for name in names)
    return Table(
        columns=(*(column.of(lambda one: one.run) for column in of_run), *of_region),
        rows=rows_by_region(rows),
        is_off=lambda one: one.run.exit_code != 0,
    )


def in_short(row: RunRow) -> str:
    """Return the reason of a run without the folders that the run lies in."""
    place = row.reason.find(row.run)
    return row.reason if place < 0 else f"RUN{row.reason[place + len(row.run) :]}"


def _of_region(name: str, is_shown: bool) -> Column[RowOfRegion]:
    def value(one: RowOfRegion) -> str | float | None:
        return None if one.region is None else getattr(one.region, name)

    is_text = name in ("region", "verdict")
    return Column(
        title=name,
        key=f"region_{name}" if name == "verdict" else name,
        value=value,
        text=lambda one: str(value(one) or "") if is_text else _short(value(one)),
        left=is_text,
        shown=Shown.EVERYWHERE if is_shown else Shown.PROGRAMS,
    )


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


def _short(value: str | float | None) -> str:
    return "" if value is None else value if isinstance(value, str) else f"{value:.4g}"
