"""``rigctl plan``: what a session will take, and what it can give."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from model.quantities import angle_of
from rigctl.console.options import time_option
from rigctl.console.terminal import print_json, progress, results, warn
from rigctl.errors import ConfigError
from rigctl.numbers.number_range import shown
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.terminal_table import terminal_table

if TYPE_CHECKING:
    from rigctl.jobs.plan import PlannedSession, Prediction
    from rigctl.session.planning.session_plan import PlannedRound, PlannedStep, SessionPlan

    _Row = PlannedRound | PlannedStep

_MOST_STEPS = 100
_SECONDS_A_MINUTE = 60
_UTC_DIGITS = 19
# Of the width or height of a picture.
_MOST_DIGITS = 6
# Share of saturated pixels beyond which a predicted DoLP says nothing.
_MOST_SATURATED = 0.01


def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file: devices, site, camera's direction.")],
    session: Annotated[Path, typer.Argument(metavar="SESSION.toml", help="Session file.")],
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Begin then, such as 2026-05-04T10:00Z; now if left out.")
    ] = None,
    until: Annotated[str | None, typer.Option(metavar="TIME", help="Take no frame from then on.")] = None,
    scene: Annotated[Path | None, typer.Option(metavar="FILE", help="Scene file: predict each round.")] = None,
    noise: Annotated[Path | None, typer.Option(metavar="FILE", help="Noise calibration for the prediction.")] = None,
    frame: Annotated[
        str | None, typer.Option(metavar="WIDTHxHEIGHT", help="Size of a real camera's pictures, for the disk.")
    ] = None,
    all_steps: Annotated[bool, typer.Option("--all", help="Print every step, however many.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Print the steps of a session with times, sun angles, disk and duration; with a scene, what it can give.

    A scene whose regions are given by materials is lit by the sun of each round.

    Example: rigctl plan examples/rig-rooftop.toml examples/session-rooftop.toml --at 2026-05-04T10:00Z
    """
    from rigctl.jobs.plan import PlanRequest, plan

    request = PlanRequest(
        rig=rig,
        session=session,
        at_ns=time_option("--at", at),
        until_ns=time_option("--until", until),
        scene=scene,
        noise=noise,
        pixels=None if frame is None else _pixels(frame),
    )
    planned = plan(request)
    for doubt in planned.doubts:
        warn(doubt)
    if as_json:
        print_json(planned.content())
    else:
        _print(planned, all_steps=all_steps)


def _pixels(frame: str) -> int:
    width, times, height = frame.partition("x")
    sizes = [int(text) if text.isdecimal() and len(text) <= _MOST_DIGITS else 0 for text in (width, height)]
    if not times or 0 in sizes:
        raise ConfigError(f"--frame: {shown(frame)} is no size; write it like 782x582")
    return sizes[0] * sizes[1]


def _print(planned: "PlannedSession", *, all_steps: bool) -> None:
    from rigctl.session.planning.session_plan import SUN_ANGLES

    console, rounds, steps = results(), planned.plan.planned_rounds(), planned.plan.planned_steps()
    sun = [name for name in SUN_ANGLES if getattr(steps[0], name) is not None]
    if len(rounds) > 1:
        console.print(terminal_table(_table(rounds, ("round", "utc", *sun))))
    shown = steps if all_steps else steps[:_MOST_STEPS]
    names = ("sequence", "round", "utc", *sun, "kind", "cycle", "angle_deg", "exposure_ms")
    console.print(terminal_table(_table(shown, names)))
    if len(shown) < len(steps):
        console.print(f"... and {len(steps) - len(shown)} more; --all prints them", markup=False)
    for prediction in planned.predictions or ():
        console.print(_prediction_line(prediction), markup=False)
    _print_need(planned.plan)


def _table(rows: Sequence["_Row"], names: tuple[str, ...]) -> Table["_Row"]:
    columns = tuple(Column["_Row"](title=name, text=partial(_cell, name=name)) for name in names)
    return Table(columns=columns, rows=tuple(rows))


def _cell(row: "_Row", name: str) -> str:
    value = getattr(row, name)
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)[:_UTC_DIGITS]


def _prediction_line(row: "Prediction") -> str:
    from rigctl.jobs.plan import UnpredictedRound

    where = f"round {row.round}, {row.exposure_ms:.3g} ms, {row.region}"
    if isinstance(row, UnpredictedRound):
        return f"{where}: {row.problem}"
    counts = ", ".join(f"{angle_of(name)} deg {mean:.0f}" for name, mean in row.mean_dn.items())
    snr = "not known" if row.dolp_snr is None else f"{row.dolp_snr:.3g}"
    snr = snr if row.saturated_fraction <= _MOST_SATURATED else "none, since it saturates"
    return f"{where}: counts above black [DN] {counts}; saturated {100 * row.saturated_fraction:.1f} %; DoLP SNR {snr}"


def _print_need(plan: "SessionPlan") -> None:
    console = results()
    size = "not known: give --frame" if plan.disk_bytes is None else f"{plan.disk_bytes / 1e6:.0f} MB"
    minutes, seconds = divmod(round(plan.duration_s), _SECONDS_A_MINUTE)
    frames = len(plan.steps)
    console.print(f"{frames} frames, {minutes} min {seconds} s until the last is taken, disk {size}", markup=False)
    if plan.false_dolp is not None:
        cost = plan.false_dolp
        console.print(f"light that drifts by 1 % a minute shows a false DoLP of {cost:.2g} in a round", markup=False)
    for remark in plan.remarks:
        progress().print(remark, markup=False)
