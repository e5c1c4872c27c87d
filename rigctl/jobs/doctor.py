"""A check-up before a session: files and a folder in; what was found of machine and devices out."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DeviceError
from rigctl.devices.host_checkup import Finding, clock, disk, receive_buffer, room
from rigctl.devices.rig_checkup import RigCheckup
from rigctl.files.rig_file import load_rig, placeholder_doubt
from rigctl.files.session_file import load_session
from rigctl.session.planning.disk_demand import DiskDemand, demand_of

_SAMPLE_BYTES = 2
_USUAL_PIXELS = 782 * 582
_USUAL_PERIOD_S = 1.0 / 60.0


@dataclass(frozen=True, kw_only=True)
class DoctorRequest:
    """Files and folder that are looked at.

    Attributes
    ----------
    rig, session : Path or None
        Files: devices, and what the disk has to hold; None looks at the machine alone.
    folder : Path
        Where runs will be.
    frames : int
        Pictures to take, at least 1.
    """

    rig: Path | None
    session: Path | None
    folder: Path
    frames: int


def check_up(request: DoctorRequest) -> Iterator[Finding]:
    """Give what is found, as it is found; files that are wrong are said to be so before anything else.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the folder cannot be written.
    """
    rig_file = None if request.rig is None else load_rig(request.rig)
    session_file = None if request.session is None else load_session(request.session)
    pixels, camera_s = _USUAL_PIXELS, None
    if rig_file is not None:
        doubt = placeholder_doubt(rig_file)
        if doubt is not None:
            yield Finding(what="polarizer", found=doubt, hint="docs/how-to/calibrate.md has the two runs that it takes")
        checkup = RigCheckup(rig_file, frames=request.frames)
        try:
            yield from checkup.findings()
        except DeviceError as error:
            yield Finding(what="devices", found=str(error), advice="mend this, and call the doctor again")
        pixels, camera_s = checkup.pixels or _USUAL_PIXELS, checkup.camera_s
    demand = DiskDemand(frame_bytes=_SAMPLE_BYTES * pixels, period_s=_USUAL_PERIOD_S)
    if rig_file is not None and session_file is not None:
        demand = demand_of(rig_file, session_file, pixels=pixels, now_ns=time.time_ns(), camera_s=camera_s)
    yield receive_buffer(frame_bytes=_SAMPLE_BYTES * pixels)
    yield disk(request.folder, frame_bytes=demand.frame_bytes, period_s=demand.period_s)
    if demand.total_bytes is not None:
        yield room(request.folder, total_bytes=demand.total_bytes)
    yield clock()
