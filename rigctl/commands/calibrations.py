"""``rigctl calibrations``: the store of calibrations."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.base.numbers import time_option
from rigctl.console.terminal import print_json, progress, results, warn
from rigctl.report.table import Column, Table, terminal_table

if TYPE_CHECKING:
    from rigctl.jobs.calibrations import CalibrationsOverview, StoredRow


def command(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="FOLDER", help="The store, or the rig file that it stands beside; ./calibrations."),
    ] = None,
    *,
    used_by: Annotated[
        Path | None,
        typer.Option("--for", metavar="RUN|RIG.toml", help="Which of them a run or a rig is given, and why."),
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw gain, read noise, dark current, axis with control limits."),
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Ages as of then, with a zone; now if left out.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """List the store of calibrations: of which devices, from when, how long each holds, how their numbers move.

    The store is the folder `calibrations` beside the rig file: whatever `rigctl calibrate` writes there. Where it
    exists, `acquire`, `stokes`, `compare` and `predict` pick from it what is not named.

    Example: rigctl calibrations --for runs/2026-05-04 --history history.png
    """
    from rigctl.jobs.calibrations import CalibrationsRequest, look_at_calibrations

    request = CalibrationsRequest(folder=folder, used_by=used_by, history=history, now_ns=time_option("--at", at))
    found = look_at_calibrations(request)
    if as_json:
        print_json(found.as_json())
        return
    _print(found)
    if history is not None:
        progress().print(f"history: {history}", markup=False)


def _print(found: "CalibrationsOverview") -> None:
    columns: tuple[Column[StoredRow], ...] = (
        Column(title="kind", text=lambda row: "+".join(row.calibration.parts), left=True),
        Column(title="taken", text=lambda row: (row.calibration.made_for.taken_utc or "not known")[:10], left=True),
        Column(title="age [d]", text=lambda row: "" if row.age_days is None else f"{row.age_days:.0f}"),
        Column(title="holds [d]", text=_holds),
        Column(title="camera", text=lambda row: row.calibration.made_for.camera_serial or "not stated", left=True),
        Column(title="stage", text=lambda row: row.calibration.made_for.stage_serial or "", left=True),
        Column(title="gain [dB]", text=lambda row: _number(row.calibration.made_for.gain_db)),
        Column(title="deg C", text=lambda row: _number(row.calibration.made_for.temperature_c)),
        Column(title="file", text=lambda row: str(row.calibration.file.relative_to(found.store.folder)), left=True),
    )
    console = results()
    console.print(terminal_table(Table(columns=columns, rows=found.rows)))
    for history in found.histories:
        console.print(history.line, markup=False)
    for choice in found.choices or ():
        if choice.pick is not None or choice.others:
            console.print(choice.line, markup=False)
    for unread in found.store.unread:
        warn(f"{unread.file}: {unread.problem}")


def _holds(row: "StoredRow") -> str:
    return f"{row.calibration.made_for.valid_days:g}{'' if row.holds else ' EXPIRED'}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
