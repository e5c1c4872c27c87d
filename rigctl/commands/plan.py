"""``rigctl plan``: what a session will take, and what it can give."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from model.prediction.quantity_table import angle_of
from rigctl.commands.time_option import time_option
from rigctl.errors import ConfigError
from rigctl.reports.table import Column, Table
from rigctl.reports.writers.terminal_table import terminal_table
from rigctl.terminal import print_json, progress, results

_MOST_STEPS = 100
_SECONDS_A_MINUTE = 60
_UTC_DIGITS = 19
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
    content = plan(request).content()
    if as_json:
        print_json(content)
    else:
        _print(content, all_steps=all_steps)


def _pixels(frame: str) -> int:
    width, times, height = frame.partition("x")
    if not (times and width.isdecimal() and height.isdecimal() and int(width) * int(height)):
        raise ConfigError(f"--frame: {frame!r} is no size; write it like 782x582")
    return int(width) * int(height)


def _print(content: dict[str, Any], *, all_steps: bool) -> None:
    console = results()
    sun = [column for column in _SUN_COLUMNS if column in content["steps"][0]]
    if len(content["rounds"]) > 1:
        console.print(terminal_table(_table(content["rounds"], ("round", "utc", *sun))))
    steps = content["steps"] if all_steps else content["steps"][:_MOST_STEPS]
    console.print(
        terminal_table(_table(steps, ("sequence", "round", "utc", *sun, "kind", "cycle", "angle_deg", "exposure_ms")))
    )
    if len(steps) < len(content["steps"]):
        console.print(f"... and {len(content['steps']) - len(steps)} more; --all prints them", markup=False)
    for row in content.get("predictions", []):
        console.print(_prediction_line(row), markup=False)
    _print_need(content)


_SUN_COLUMNS = ("sun_zenith_deg", "sun_azimuth_deg", "phi_deg")


def _table(rows: list[dict[str, Any]], names: tuple[str, ...]) -> Table[dict[str, Any]]:
    columns = tuple(Column[dict[str, Any]](title=name, text=partial(_cell, name=name)) for name in names)
    return Table(columns=columns, rows=tuple(rows))


def _cell(row: dict[str, Any], name: str) -> str:
    value = row.get(name)
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)[:_UTC_DIGITS]


def _prediction_line(row: dict[str, Any]) -> str:
    where = f"round {row['round']}, {row['exposure_ms']:.3g} ms, {row['region']}"
    if "problem" in row:
        return f"{where}: {row['problem']}"
    counts = ", ".join(f"{angle_of(name)} deg {mean:.0f}" for name, mean in row["mean_dn"].items())
    saturated = row["saturated_fraction"]
    snr = "not known" if row["dolp_snr"] is None else f"{row['dolp_snr']:.3g}"
    snr = snr if saturated <= _MOST_SATURATED else "none, since it saturates"
    return f"{where}: counts above black [DN] {counts}; saturated {100 * saturated:.1f} %; DoLP SNR {snr}"


def _print_need(content: dict[str, Any]) -> None:
    console = results()
    disk = content["disk_bytes"]
    size = "not known: give --frame" if disk is None else f"{disk / 1e6:.0f} MB"
    minutes, seconds = divmod(round(content["duration_s"]), _SECONDS_A_MINUTE)
    frames = len(content["steps"])
    console.print(f"{frames} frames, {minutes} min {seconds} s until the last is taken, disk {size}", markup=False)
    if content["false_dolp_per_percent_a_minute"] is not None:
        cost = content["false_dolp_per_percent_a_minute"]
        console.print(f"light that drifts by 1 % a minute shows a false DoLP of {cost:.2g} in a round", markup=False)
    for remark in content["remarks"]:
        progress().print(remark, markup=False)
