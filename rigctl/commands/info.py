"""``rigctl info``: say what a run holds."""

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, results, warn
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.jobs.summarize_run import FrameGroup, RunSummary

_UNKNOWN = "-"
_ORIGINS = {
    "simulated": "simulated devices",
    "device": "real devices",
    "import": "imported images",
}


def command(
    run: Annotated[Path, typer.Argument(help="Run folder.", metavar="RUN")],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Say what a run holds: frames, angles, exposures, devices, time span, and what was noted.

    Example: rigctl info runs/2026-05-04
    """
    from rigctl.console.exclusion_option import are_exclusions_ignored
    from rigctl.jobs.summarize_run import summarize_run
    from rigctl.runs.wholeness import used_run

    summary = summarize_run(used_run(run, ignore_exclusions=are_exclusions_ignored()))
    if as_json:
        print_json(asdict(summary))
    else:
        _print(summary)
        for doubt in summary.doubts:
            warn(doubt)


def _print(summary: "RunSummary") -> None:
    console = results()
    for title, text in _facts(summary):
        console.print(f"{title:<14}{text}", markup=False)
    console.print(terminal_table(Table(columns=_columns(), rows=tuple(summary.groups))))
    for remark, frames in summary.remarks.items():
        console.print(f"note: {remark} ({frames} frames)", markup=False)
    for event, times in summary.events.items():
        console.print(f"event: {event} ({times} x)", markup=False)
    for annotation in summary.annotations:
        console.print(annotation.line, markup=False)


def _facts(summary: "RunSummary") -> Iterable[tuple[str, str]]:
    yield "run", summary.run
    yield "origin", _ORIGINS.get(summary.origin, summary.origin)
    yield "made by", f"{summary.created_by}, {summary.created_utc}"
    yield "frames", f"{summary.frames} of {_join(f'{w} x {h}' for w, h in summary.sizes)} pixels"
    yield "bits", _join(map(str, summary.bit_depths))
    yield "black [DN]", _join(f"{value:g}" for value in summary.black_levels_dn)
    yield "full [DN]", _join(f"{value:g}" for value in summary.saturations_dn)
    yield "missing [DN]", _join(f"{value:g}" for value in summary.missing_dn)
    yield "time", f"{summary.start_utc or _UNKNOWN} to {summary.end_utc or _UNKNOWN}"
    for text in (*summary.start_times, *filter(None, [summary.host_clock])):
        yield "starts", text
    yield "camera", _join(summary.cameras)
    yield "stage", _join(summary.stages)


def _join(texts: Iterable[str]) -> str:
    return ", ".join(texts) or _UNKNOWN


def _columns() -> tuple[Column["FrameGroup"], ...]:
    return (
        Column(title="kind", text=lambda group: group.kind, left=True),
        Column(title="angle [deg]", text=lambda group: _number(group.polarizer_angle_target_deg)),
        Column(title="readback [deg]", text=lambda group: _span(group.polarizer_angle_deg, digits=3)),
        Column(title="exposure [s]", text=lambda group: _number(group.exposure_s)),
        Column(title="gain [dB]", text=lambda group: _number(group.gain_db)),
        Column(title="frames", text=lambda group: str(group.frames)),
        Column(title="cycles", text=lambda group: str(group.cycles)),
        Column(title="saturated [%]", text=_saturated),
    )


def _saturated(group: "FrameGroup") -> str:
    low, high = group.saturated_fraction
    return _span((100.0 * low, 100.0 * high), digits=2)


def _number(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:g}"


def _span(values: tuple[float, float] | None, *, digits: int) -> str:
    if values is None:
        return _UNKNOWN
    low, high = (f"{value:.{digits}f}" for value in values)
    return low if low == high else f"{low} .. {high}"
