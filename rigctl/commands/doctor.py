"""``rigctl doctor``: whether this machine and these devices are fit for a session."""

import ipaddress
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli import EXIT_DEVICE
from rigctl.files.rig_file import RigFile, load_rig
from rigctl.sessions.device_checkup import camera_frames, interface_mtu, stage_latency
from rigctl.sessions.finding import Finding
from rigctl.sessions.host_checkup import clock, disk, receive_buffer
from rigctl.sessions.rig import open_rig
from rigctl.terminal import print_json, results

_EXPOSURE_S = 0.01
_SAMPLE_BYTES = 2
_LARGE_FRAME_BYTES = 782 * 582 * _SAMPLE_BYTES
_USUAL_PERIOD_S = 1.0 / 60.0


def command(
    rig: Annotated[Path | None, typer.Argument(metavar="RIG.toml", help="Look at its devices too.")] = None,
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where runs will be.")] = Path(),
    frames: Annotated[int, typer.Option(metavar="N", min=1, help="Pictures to take.")] = 20,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Check network, disk, clock and, with a rig file, its devices; each line says what to change.

    The stage is asked for its position and not moved. Exit code 3 if something has to be changed.

    Example: rigctl doctor examples/rig-sim.toml --folder /data/runs
    """
    findings = [*_of_host(folder), *([] if rig is None else _of_devices(load_rig(rig), frames))]
    if as_json:
        print_json({"findings": [vars(finding) for finding in findings]})
    else:
        for finding in findings:
            _show(finding)
    if any(finding.advice is not None for finding in findings):
        raise typer.Exit(EXIT_DEVICE)


def _of_host(folder: Path) -> Iterator[Finding]:
    yield receive_buffer(frame_bytes=_LARGE_FRAME_BYTES)
    yield disk(folder, frame_bytes=_LARGE_FRAME_BYTES, period_s=_USUAL_PERIOD_S)
    yield clock()


def _of_devices(rig_file: RigFile, frames: int) -> Iterator[Finding]:
    scheme, _, place = rig_file.camera.address.partition(":")
    where = place.partition("?")[0]
    if scheme == "gige" and _is_ip(where):
        yield interface_mtu(where)
    with open_rig(rig_file, session_name="doctor") as rig:
        yield Finding(what="stage", found=f"{rig.stage_identity.model}, serial {rig.stage_identity.serial_number}")
        yield stage_latency(rig.stage)
        yield Finding(what="camera", found=f"{rig.camera_identity.model}, serial {rig.camera_identity.serial_number}")
        rig.camera.configure(exposure_s=_EXPOSURE_S, gain_db=rig_file.camera.gain_db)
        yield from camera_frames(rig.camera, frames=frames, timeout_s=rig_file.camera.timeout_s + _EXPOSURE_S)


def _is_ip(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _show(finding: Finding) -> None:
    results().print(f"{finding.what}: {finding.found}", markup=False)
    if finding.advice is not None:
        results().print(f"  change: {finding.advice}", markup=False)
    if finding.hint is not None:
        results().print(f"  hint: {finding.hint}", markup=False)
