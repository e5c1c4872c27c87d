"""`rigctl doctor`: checks whether machine and devices are fit for a session, and says what to change."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, note
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result, Writes

if TYPE_CHECKING:
    from rigctl.files.rig_file import MonitorSection, NotifySection
    from rigctl.rig.checkup import Finding

_SAMPLE_BYTES = 2
_USUAL_PIXELS = 782 * 582
_USUAL_PERIOD_S = 1.0 / 60.0
# Subjects of findings: those that stop a session come first, then those that spoil it.
_ORDER = (
    "devices", "room", "loss", "disk", "receive buffer", "MTU", "stage", "serial adapter", "clock", "monitor",
)  # fmt: skip


def doctor(
    rig: FilePath | None = None,
    session: FilePath | None = None,
    /,
    *,
    folder: Annotated[FilePath, Writes(kind="folder")] = Path(),
    frames: Annotated[int, Parameter(validator=Number(gte=1))] = 20,
    try_notices: bool = False,
) -> "CheckUp":
    """Check network, disk, clock and, with a rig file, its devices, and say what to change.

    The stage reports its position and does not move. Without a session file, the disk is checked for 60 frames a
    second. The exit code is 3 if something has to be changed.

    Example: rigctl doctor examples/rig-sim.toml examples/session.toml --folder /data/runs

    Parameters
    ----------
    rig : path
        Rig file: check its devices too.
    session : path
        Session file: check that the disk is fast and large enough for the session.
    folder : path
        Folder for runs, to check its disk.
    frames : int
        Number of pictures to take as a test.
    try_notices : bool
        Only send a test notice, by [notify] of the rig file.
    """
    from rigctl.files.rig_file import load_rig

    rig_path, session_path = (None if given is None else Path(given) for given in (rig, session))
    if try_notices:
        notices = None if rig_path is None else load_rig(rig_path).notify
        if notices is None:
            raise ConfigError(
                f'--try-notices: {rig or "no rig file"}: has no [notify]; write one with webhook = "https://..." or '
                'command = ["program"]'
            )
        return CheckUp(findings=(_notice_finding(notices),))
    if rig_path is not None:
        note(f"checking the devices of {rig_path}")
    return CheckUp(findings=tuple(check_up(rig_path, session_path, folder=Path(folder), frames=frames)))


@dataclass(frozen=True, kw_only=True)
class CheckUp(Result):
    """Findings of machine and devices."""

    findings: "tuple[Finding, ...]"

    @property
    def to_change(self) -> "tuple[Finding, ...]":
        """Findings that need a change, the most important first."""
        return most_important_first(self.findings)

    @property
    def exit_code(self) -> int:
        """3 if something has to be changed."""
        from rigctl.console import EXIT_DEVICE

        return EXIT_DEVICE if self.to_change else 0

    def content(self) -> Iterable[Part]:
        """Return necessary changes, then every finding."""
        changes = self.to_change
        yield f"{len(changes)} to change, the most important first:" if changes else "Ready: nothing to change."
        yield from (f"  {number}. {one.what}: {one.advice}" for number, one in enumerate(changes, 1))
        for finding in self.findings:
            yield f"{finding.what}: {finding.found}"
            if finding.hint is not None:
                yield f"  hint: {finding.hint}"

    def as_json(self) -> dict[str, Json]:
        """Return the findings, and those that need a change."""
        return {
            "findings": [vars(finding) for finding in self.findings],
            "to_change": [vars(finding) for finding in self.to_change],
        }


def check_up(rig: Path | None, session: Path | None, *, folder: Path, frames: int) -> "Iterator[Finding]":
    """Yield findings on devices and machine; wrong files are refused before a device is opened."""
    from drivers.errors import DeviceError
    from rigctl.calibrations.store import store_doubts
    from rigctl.files.rig_file import load_rig, placeholder_doubt
    from rigctl.files.session_file import load_session
    from rigctl.rig.checkup import Finding, RigCheckup, clock, disk, receive_buffer, room
    from rigctl.session.plan import demand_of

    rig_file = None if rig is None else load_rig(rig)
    session_file = None if session is None else load_session(session)
    pixels, camera_s = _USUAL_PIXELS, None
    if rig_file is not None and rig is not None:
        doubt = placeholder_doubt(rig_file)
        if doubt is not None:
            yield Finding(what="polarizer", found=doubt, hint="docs/how-to/calibrate.md has the two runs that it takes")
        for doubt in store_doubts(rig_file, rig, now_ns=time.time_ns()):
            yield Finding(what="calibrations", found=doubt, hint="docs/how-to/calibrate.md has how each is made")
        checkup = RigCheckup(rig_file, frames=frames)
        try:
            yield from checkup.findings()
        except DeviceError as error:
            yield Finding(
                what="devices", found="cannot be checked", advice=f"{error}. Correct this, and run the check again"
            )
        pixels, camera_s = checkup.pixels or _USUAL_PIXELS, checkup.camera_s
        yield from monitor_findings(rig_file.monitors)
    yield receive_buffer(frame_bytes=_SAMPLE_BYTES * pixels)
    if rig_file is None or session_file is None:
        yield disk(folder, frame_bytes=_SAMPLE_BYTES * pixels, period_s=_USUAL_PERIOD_S)
    else:
        frame_bytes, period_s, total_bytes = demand_of(
            rig_file, session_file, pixels=pixels, now_ns=time.time_ns(), camera_s=camera_s
        )
        yield disk(folder, frame_bytes=frame_bytes, period_s=period_s)
        yield room(folder, total_bytes=total_bytes)
    yield clock()


def monitor_findings(sections: "Sequence[MonitorSection]") -> "Iterator[Finding]":
    """Yield the reading of each monitor, or its problem."""
    from rigctl.rig.checkup import Finding
    from rigctl.runs.records import RunEvent, monitor_traces
    from rigctl.session.monitors import Monitors

    events: list[RunEvent] = []
    monitors = Monitors(
        sections, lambda event, **facts: events.append(RunEvent(event=event, facts=facts)), time.time_ns
    )
    monitors.look(0)
    monitors.finish()
    for trace in monitor_traces(events):
        if trace.values:
            reading = f"{trace.monitor}: {trace.values[-1]:.6g} {trace.unit} ({trace.device})"
            yield Finding(what="monitor", found=reading)
        else:
            advice = "correct its table in the rig file, or remove it: frames are taken without it"
            yield Finding(what="monitor", found=f"{trace.monitor}: {'; '.join(trace.problems)}", advice=advice)


def _notice_finding(section: "NotifySection") -> "Finding":
    """Send a test notice."""
    from rigctl.rig.checkup import Finding
    from rigctl.session.control import notice_of, send

    problems = send(section, notice_of("none", "test", "rigctl doctor"))
    if not problems:
        return Finding(what="notices", found="a notice was sent")
    return Finding(what="notices", found="; ".join(problems), advice="correct [notify] in the rig file")


def most_important_first(findings: "Sequence[Finding]") -> "tuple[Finding, ...]":
    """Return the findings that need a change: first those that would stop a session, then those that would spoil it."""

    def rank(finding: "Finding") -> int:
        places = (place for place, name in enumerate(_ORDER) if finding.what.startswith(name))
        return next(places, len(_ORDER))

    return tuple(sorted((finding for finding in findings if finding.advice is not None), key=rank))
