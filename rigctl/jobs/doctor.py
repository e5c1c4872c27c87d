"""A check-up before a session: files and a folder in; what was found of machine and devices out."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DeviceError
from rigctl.calibrations.rig_picks import store_doubts
from rigctl.devices.host_checkup import Finding, clock, disk, receive_buffer, room
from rigctl.devices.rig_checkup import RigCheckup
from rigctl.files.rig_file import MonitorSection, load_rig, placeholder_doubt
from rigctl.files.session_file import load_session
from rigctl.runs.monitor_readings import monitor_traces
from rigctl.runs.run_events import RunEvent
from rigctl.session.monitors import Monitors
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


def monitor_findings(sections: Sequence[MonitorSection]) -> Iterator[Finding]:
    """Give what each sensor beside the frames says now, or why it says nothing."""
    events: list[RunEvent] = []
    monitors = Monitors(
        sections, lambda event, **facts: events.append(RunEvent(event=event, facts=facts)), time.time_ns
    )
    monitors.look(0)
    monitors.finish()
    for trace in monitor_traces(events):
        facts = trace.facts
        if trace.values:
            yield Finding(
                what="monitor", found=f"{facts.monitor}: {trace.values[-1]:.6g} {facts.unit} ({facts.device})"
            )
        else:
            advice = "mend its table in the rig file, or leave it out: frames are taken without it"
            yield Finding(what="monitor", found=f"{facts.monitor}: {'; '.join(trace.problems)}", advice=advice)


# What a finding is of, what stops a session first.
_ORDER = ("devices", "room", "loss", "disk", "receive buffer", "MTU", "stage", "serial adapter", "clock", "monitor")


def most_important_first(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return those findings that ask for a change: what would stop a session first, then what would spoil it."""

    def rank(finding: Finding) -> int:
        places = (place for place, name in enumerate(_ORDER) if finding.what.startswith(name))
        return next(places, len(_ORDER))

    return tuple(sorted((finding for finding in findings if finding.advice is not None), key=rank))


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
    if rig_file is not None and request.rig is not None:
        doubt = placeholder_doubt(rig_file)
        if doubt is not None:
            yield Finding(what="polarizer", found=doubt, hint="docs/how-to/calibrate.md has the two runs that it takes")
        for doubt in store_doubts(rig_file, request.rig, now_ns=time.time_ns()):
            yield Finding(what="calibrations", found=doubt, hint="docs/how-to/calibrate.md has how each is made")
        checkup = RigCheckup(rig_file, frames=request.frames)
        try:
            yield from checkup.findings()
        except DeviceError as error:
            yield Finding(what="devices", found=str(error), advice="mend this, and call the doctor again")
        pixels, camera_s = checkup.pixels or _USUAL_PIXELS, checkup.camera_s
        yield from monitor_findings(rig_file.monitors)
    demand = DiskDemand(frame_bytes=_SAMPLE_BYTES * pixels, period_s=_USUAL_PERIOD_S)
    if rig_file is not None and session_file is not None:
        demand = demand_of(rig_file, session_file, pixels=pixels, now_ns=time.time_ns(), camera_s=camera_s)
    yield receive_buffer(frame_bytes=_SAMPLE_BYTES * pixels)
    yield disk(request.folder, frame_bytes=demand.frame_bytes, period_s=demand.period_s)
    if demand.total_bytes is not None:
        yield room(request.folder, total_bytes=demand.total_bytes)
    yield clock()
