"""``rigctl doctor``: whether this machine and these devices are fit for a session."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import DeviceError
from rigctl.cli import EXIT_DEVICE
from rigctl.devices.host_checkup import Finding, clock, disk, receive_buffer, room
from rigctl.devices.rig_checkup import RigCheckup
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.session.planning.disk_demand import DiskDemand, demand_of
from rigctl.terminal import print_json, results

_SAMPLE_BYTES = 2
_USUAL_PIXELS = 782 * 582
_USUAL_PERIOD_S = 1.0 / 60.0


def command(
    rig: Annotated[Path | None, typer.Argument(metavar="RIG.toml", help="Look at its devices too.")] = None,
    session: Annotated[
        Path | None, typer.Argument(metavar="SESSION.toml", help="Hold the disk against what it needs.")
    ] = None,
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where runs will be.")] = Path(),
    frames: Annotated[int, typer.Option(metavar="N", min=1, help="Pictures to take.")] = 20,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Check network, disk, clock and, with a rig file, its devices; each line says what to change.

    The stage is asked for its position and not moved. Without a session file the disk is held against 60 frames a
    second. Exit code 3 if something has to be changed.

    Example: rigctl doctor examples/rig-sim.toml examples/session.toml --folder /data/runs
    """
    found = []
    for finding in _findings(rig, session, folder, frames):
        found.append(finding)
        if not as_json:
            _show(finding)
    if as_json:
        print_json({"findings": [vars(finding) for finding in found]})
    if any(finding.advice is not None for finding in found):
        raise typer.Exit(EXIT_DEVICE)


def _findings(rig: Path | None, session: Path | None, folder: Path, frames: int) -> Iterator[Finding]:
    """Give what is found, as it is found; files that are wrong are said to be so before anything else."""
    rig_file = None if rig is None else load_rig(rig)
    session_file = None if session is None else load_session(session)
    pixels, camera_s = _USUAL_PIXELS, None
    if rig_file is not None:
        checkup = RigCheckup(rig_file, frames=frames)
        try:
            yield from checkup.findings()
        except DeviceError as error:
            yield Finding(what="devices", found=str(error), advice="mend this, and call the doctor again")
        pixels, camera_s = checkup.pixels or _USUAL_PIXELS, checkup.camera_s
    demand = DiskDemand(frame_bytes=_SAMPLE_BYTES * pixels, period_s=_USUAL_PERIOD_S)
    if rig_file is not None and session_file is not None:
        demand = demand_of(rig_file, session_file, pixels=pixels, now_ns=time.time_ns(), camera_s=camera_s)
    yield receive_buffer(frame_bytes=_SAMPLE_BYTES * pixels)
    yield disk(folder, frame_bytes=demand.frame_bytes, period_s=demand.period_s)
    if demand.total_bytes is not None:
        yield room(folder, total_bytes=demand.total_bytes)
    yield clock()


def _show(finding: Finding) -> None:
    results().print(f"{finding.what}: {finding.found}", markup=False)
    if finding.advice is not None:
        results().print(f"  change: {finding.advice}", markup=False)
    if finding.hint is not None:
        results().print(f"  hint: {finding.hint}", markup=False)
