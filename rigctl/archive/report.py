"""Results of a job over an archive: table, figure against time, page and files; also health and found rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

from rigctl.archive.index import COLUMNS, Fact
from rigctl.archive.rows import RegionNumbers
from rigctl.base.numbers import wrapped
from rigctl.report.document import Column, Picture, Report, Section, Shown, Table, text_columns
from rigctl.report.drawing import legend_of_all, png, subplots
from rigctl.report.files import write_folder
from rigctl.version import VERSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rigctl.archive.health import RunHealth
    from rigctl.archive.index import IndexColumn
    from rigctl.archive.rows import RunRow, Verb
    from rigctl.console import Json


# Rows on a terminal; programs get all.
_FOR_PEOPLE = ("run", "utc", "sun_zenith", "state", "verdict", "region", "dolp", "dolp_sigma", "aolp_deg")
_UTC_MINUTES = 16
# Length of a reason on a terminal.
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


# A run of a job over an archive with one of its regions, if any.
RowOfRegion = tuple["RunRow", "RegionNumbers | None"]


def rows_by_region(rows: Sequence[RunRow]) -> tuple[RowOfRegion, ...]:
    """Return rows of runs, one per region, or one without regions."""
    return tuple((row, region) for row in rows for region in (row.regions or (None,)))


def archive_table(rows: Sequence[RunRow], verb: Verb) -> Table[RowOfRegion]:
    """Return the results of each run and region: all for programs, those of the job for people."""
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
        columns=(*(column.of(lambda one: one[0]) for column in of_run), *of_region),
        rows=rows_by_region(rows),
        is_off=lambda one: one[0].exit_code != 0,
    )


def in_short(row: RunRow) -> str:
    """Return the reason of a run without the folders above the run."""
    place = row.reason.find(row.run)
    return row.reason if place < 0 else f"RUN{row.reason[place + len(row.run) :]}"


def _of_region(name: str, is_shown: bool) -> Column[RowOfRegion]:
    def value(one: RowOfRegion) -> str | float | None:
        return None if one[1] is None else getattr(one[1], name)

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


# Most regions in a figure; the tables have all.
_MOST_REGIONS = 7
_Points = list[tuple[datetime, RegionNumbers]]
# A drawn quantity: label, value, error.
_Panel = tuple[str, Callable[[RegionNumbers], float | None], Callable[[RegionNumbers], float | None]]


def archive_figure(rows: Sequence[RunRow], verb: Verb) -> bytes | None:
    """Return the regions' numbers against time; None if no run has both."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    points: dict[str, _Points] = {}
    for row in rows:
        for region in row.regions if row.utc else ():
            points.setdefault(region.region, []).append((datetime.fromisoformat(row.utc), region))
    if verb == "verify" or not points:
        return None
    panels = _PANELS[verb]
    figure, axes = subplots(len(panels), 1, size=(8.0, 2.6 * len(panels)))
    for ax, panel in zip(axes, panels, strict=True):
        for name in sorted(points)[:_MOST_REGIONS]:
            _draw(ax, name, points[name], panel)
        ax.set_ylabel(panel[0])
        ax.xaxis.set_major_locator(locator := AutoDateLocator())  # type: ignore[no-untyped-call]
        ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes[-1].set_xlabel("begun, UTC")
    legend_of_all(figure, axes[0])
    return png(figure)


def _draw(ax: Axes, name: str, points: _Points, panel: _Panel) -> None:
    _, value, error = panel
    known = [(at, found, error(region)) for at, region in points if (found := value(region)) is not None]
    if not known:
        return
    times, values, errors = zip(*known, strict=True)
    bars = [0.0 if one is None else one for one in errors]
    ax.errorbar(times, values, yerr=bars if any(bars) else None, fmt="o", markersize=3, label=name, linewidth=0.8)


def _change_of_dolp(region: RegionNumbers) -> float | None:
    return None if region.dolp is None or region.dolp_before is None else region.dolp - region.dolp_before


def _change_of_aolp(region: RegionNumbers) -> float | None:
    if region.aolp_deg is None or region.aolp_before_deg is None:
        return None
    return float(wrapped(region.aolp_deg - region.aolp_before_deg, turn=180.0))


def _no_error(_: RegionNumbers) -> None:
    return None


_DOLP: _Panel = ("DoLP", lambda region: region.dolp, lambda region: region.dolp_sigma)
_PANELS: dict[Verb, tuple[_Panel, ...]] = {
    "compare": (_DOLP, ("z of DoLP", lambda region: region.dolp_z, _no_error)),
    "stokes": (_DOLP, ("AoLP [deg]", lambda region: region.aolp_deg, lambda region: region.aolp_sigma_deg)),
    "recalibrate": (
        ("change of DoLP", _change_of_dolp, _no_error),
        ("change of AoLP [deg]", _change_of_aolp, _no_error),
    ),
}


SCHEMA_VERSION = 1
_TITLES: dict[Verb, str] = {
    "compare": "compared with the model",
    "stokes": "measured",
    "verify": "verified",
    "recalibrate": "measured again with other calibrations",
}
_GOOD = {"agrees", "agrees_with_reservations", "sound", "flagged", "whole"}


def write_archive_rows(rows: Sequence[RunRow], verb: Verb, out: Path, *, runs: int, alpha: float) -> None:
    """Write archive.csv, archive.json and archive.html."""
    table = archive_table(rows, verb)
    content: dict[str, Json] = {
        "schema_version": SCHEMA_VERSION,
        "created_by": f"rigctl {VERSION}",
        "job": verb,
        "runs": runs,
        "done": len(rows),
        "verdicts": dict(Counter(row.verdict for row in rows)),
        "rows": table.json(),
    }
    page = _report(rows, verb, runs=runs, alpha=alpha)
    write_folder(out, {"archive.csv": table, "archive.json": content, "archive.html": page})


def _report(rows: Sequence[RunRow], verb: Verb, *, runs: int, alpha: float) -> Report:
    counted = Counter(row.verdict for row in rows).most_common()
    left = runs - len(rows)
    said = ", ".join(f"{times} {verdict}" for verdict, times in counted) or "no run matches"
    picture = archive_figure(rows, verb)
    return Report(
        title=f"{runs} runs {_TITLES[verb]}",
        source="A row for each run of the archive and each of its regions; a run that failed has its reason.",
        verdict=f"{said}{f'; {left} not done yet' if left else ''}.",
        good=left == 0 and all(row.verdict in _GOOD for row in rows),
        reasons=tuple(_reasons(rows, verb, alpha)),
        sections=[
            *(() if picture is None else (Section(title="Against time", blocks=(Picture(png=picture),)),)),
            *_failed(rows),
            Section(title="All runs", blocks=(archive_table(rows, verb),)),
        ],
    )


def _reasons(rows: Sequence[RunRow], verb: Verb, alpha: float) -> Iterable[tuple[str, str]]:
    if verb == "compare":
        judged = sum(row.exit_code in (0, 5) for row in rows)
        yield "", f"alpha = {alpha:g} applies to each run: of {judged} runs {judged * alpha:.2g} disagree by chance."
    if verb == "recalibrate":
        yield (
            "",
            "before: with the run's own angles and dark level, without calibrations; after: with those of each row.",
        )


def _failed(rows: Sequence[RunRow]) -> Iterable[Section]:
    """Yield the reasons of runs without a result, each with their number."""
    failed = Counter(in_short(row) for row in rows if row.exit_code not in (0, 5) and row.reason)
    if failed:
        table = Table(
            columns=text_columns("runs", "why", left=(1,)),
            rows=tuple((str(times), reason) for reason, times in failed.most_common()),
        )
        note = "Equal reasons of several runs are listed once, without their folder."
        yield Section(title="Runs without a result", blocks=(table, note))
