"""Takes a session into its run folder, and resumes it. Lost devices are opened again."""

import hashlib
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pydantic import JsonValue
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from drivers.errors import DeviceTimeoutError, NotConnectedError
from drivers.interfaces import Camera, DeviceIdentity, ReportingCamera
from rigctl.base.durable import DiskCalls
from rigctl.base.numbers import NS_PER_S, unix_ns, utc_moment, utc_text
from rigctl.console import progress as progress_console
from rigctl.console import visible, warn
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.rig_file import NotifySection, RigFile, load_rig
from rigctl.files.session_file import SessionFile
from rigctl.rig.rig import Rig, open_rig
from rigctl.runs.check import Repair, repair_run, wholeness
from rigctl.runs.folder import Run, files_of, read_contents, read_inputs, read_run
from rigctl.runs.records import FrameRecord, SessionNoise, metered_exposures, read_events
from rigctl.runs.writer import RunWriter
from rigctl.session.acquisition import acquire
from rigctl.session.control import Control, notices
from rigctl.session.numbers import LiveNumbers
from rigctl.session.plan import Step, plan_steps, round_times_ns, step_times_ns
from rigctl.session.status import LiveContent, LiveStatus, live_lines, write_status
from rigctl.session.timing import SessionClock, SessionContext, clock_of

# Packages that determine the numbers in a run; it stores their versions.
_PACKAGES = ("rigctl", "numpy", "pyserial")
_ANGLE_TOLERANCE_DEG = 1e-6
# File systems flush a file that replaces another, which costs as much as storing a frame; this is often enough.
_TELL_EACH_S = 1.0
_RECONNECT_PAUSE_S = 2.0

Opener = Callable[[], AbstractContextManager[Rig]]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """End of a session."""

    frames: int  #: Number of frames in the run, and in the session.
    planned: int
    is_finished: bool  #: False if a stop was requested.
    repair: Repair | None = None  #: Repair of the run before it was resumed.
    was_finished: bool = False  #: Nothing was left to take.


def take_session(
    rig_file: RigFile,
    session: SessionFile,
    out: Path,
    *,
    files: dict[str, Path],
    at_ns: int | None = None,
    until_ns: int | None = None,
    noise: SessionNoise | None = None,
    clock: SessionClock | None = None,
    opener: Opener | None = None,
    asks_by_hold: bool = False,
    calibrations: Mapping[str, JsonValue] | None = None,
) -> Outcome:
    """Take a session into a new run folder; return how it ended."""
    clock = clock_of(rig_file) if clock is None else clock
    now_ns = clock.utc_ns() if at_ns is None else at_ns
    rounds = round_times_ns(session, rig_file.site, now_ns=now_ns, until_ns=until_ns)
    rounds = (at_ns,) if rounds == (None,) else rounds
    steps = plan_steps(session, rounds, cell_deg=rig_file.cell_deg)
    context = SessionContext(
        session, rig_file, clock=clock, control=Control(out), until_ns=until_ns, noise=noise, asks_by_hold=asks_by_hold
    )

    def begun(rig: Rig) -> RunWriter:
        inputs = read_inputs(rig_file, files)
        description = _description(rig, rig_file, session, files, inputs) | {
            "rounds_ns": list(rounds),
            "until_ns": until_ns,
            "noise": None if noise is None else asdict(noise),
            **(calibrations or {}),
        }
        return RunWriter.create(out, description, inputs=inputs, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns)

    return _Taking(rig_file, session, out, steps, context, opener).take(steps, begun, notify=rig_file.notify)


def resume_session(
    path: Path, *, clock: SessionClock | None = None, opener: Opener | None = None, asks_by_hold: bool = False
) -> Outcome:
    """Resume an interrupted session; return how it ended.

    Whole frames that were not acknowledged are adopted, damaged ones are set aside and taken again.
    """
    repair = repair_run(path)
    run = read_run(path)
    rig_file, session = files_of(run)
    clock = clock_of(rig_file, after_ns=_last_ns(run)) if clock is None else clock
    steps = plan_steps(session, run.session.rounds_ns, cell_deg=rig_file.cell_deg)
    left = _left_of(run, steps)
    if not left and any(event.event == "finished" for event in read_events(path)):
        _close_again(path, clock)
        return Outcome(frames=len(run.frames), planned=len(steps), is_finished=True, repair=repair, was_finished=True)
    context = SessionContext(
        session,
        rig_file,
        clock=clock,
        control=Control(path),
        until_ns=run.session.until_ns,
        noise=run.session.noise,
        asks_by_hold=asks_by_hold,
    )

    def begun(rig: Rig) -> RunWriter:
        _require_same_devices(rig, run)
        return RunWriter.append(path, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns)

    taking = _Taking(rig_file, session, path, steps, context, opener)
    return replace(taking.take(left, begun, notify=_notices_of(run), repair=repair), repair=repair)


def require_person(steps: Sequence[Step], *, are_asked: bool) -> None:
    """Raise ConfigError if a session needs a person at the rig and there is no terminal."""
    kinds = sorted({step.kind for step in steps})
    if not are_asked and len(kinds) > 1 and not sys.stdin.isatty():
        raise ConfigError(
            f"the session takes {', '.join(kinds)} frames, and nobody is at a terminal to cover the lens in between: "
            "take darks and flats by hand, and the scene alone unattended"
        )


class Watch:
    """Progress bar and status.json of a session. The bar is shown while the context lasts."""

    def __init__(
        self,
        run: Path,
        steps: Sequence[Step],
        *,
        title: str,
        clock: SessionClock,
        live: LiveNumbers,
        disk: DiskCalls | None = None,
    ) -> None:
        self._disk = DiskCalls() if disk is None else disk
        self._run, self._steps, self._clock, self._live = run, steps, clock, live
        self._planned_ns = step_times_ns(steps, start_ns=clock.utc_ns())
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns)
        self._task = self._bar.add_task(title, total=len(steps))
        self._lock = threading.Lock()
        self._told_s = -_TELL_EACH_S
        self._status = LiveStatus(session=title, frames_planned=len(steps), frames=0)
        self._is_blind = False
        self._screen = Live(get_renderable=self._shown, console=progress_console(), transient=True)

    def __enter__(self) -> Self:
        self._screen.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._tell(numbers=self._numbers())
        self._screen.stop()

    def begin(self, *, left: int) -> None:
        """Begin with this number of steps."""
        done = len(self._steps) - left
        self._bar.update(self._task, completed=done)
        self._tell(frames=done)

    def stored(self, step: Step) -> None:
        """Count a step whose frame is on the disk."""
        self._bar.advance(self._task)
        frames = self._status.frames + 1
        now_s = time.monotonic()
        is_last = frames == len(self._steps)
        if now_s - self._told_s >= _TELL_EACH_S or is_last:
            self._told_s = now_s
            self._tell(frames=frames, numbers=self._numbers(), **self._progress(step))
        else:
            self._status = replace(self._status, frames=frames)

    def _numbers(self) -> LiveContent | None:
        """Return the live numbers; None if they cannot be computed, because an error here must not cost a frame."""
        try:
            return self._live.content()
        except Exception as error:
            if not self._is_blind:
                warn(f"no live numbers: {type(error).__name__}: {error}; the frames are stored all the same")
            self._is_blind = True
            return None

    def _shown(self) -> Group:
        numbers = self._status.numbers
        lines = "" if numbers is None else "\n".join(live_lines(numbers))
        return Group(self._bar, Text(visible(lines)))

    def _progress(self, step: Step) -> dict[str, Any]:
        """Return the progress, with the remaining time by the plan."""
        now_ns = self._clock.utc_ns()
        end_ns = now_ns + self._planned_ns[-1] - self._planned_ns[step.sequence]
        if self._steps[-1].due_ns is not None:
            end_ns = max(end_ns, self._planned_ns[-1])
        last = {
            "sequence": step.sequence,
            "kind": step.kind,
            "cycle": step.cycle,
            "angle_deg": step.polarizer_angle_deg,
        }
        remaining_s = round((end_ns - now_ns) / NS_PER_S, 1)
        return {"last": last, "remaining_s": remaining_s, "end_utc": utc_text(end_ns)}

    def _tell(self, **changes: Any) -> None:
        with self._lock:
            status = self._status = replace(self._status, **changes, written_utc=utc_text(self._clock.utc_ns()))
            # No status on a full or hanging disk: the frames report it.
            with suppress(OSError, RunFolderError):
                self._disk.call(lambda: write_status(self._run, status))


class _Taking:
    """Takes the remaining steps of a session, and opens the devices again if one is lost."""

    def __init__(
        self,
        rig_file: RigFile,
        session: SessionFile,
        run: Path,
        steps: tuple[Step, ...],
        context: SessionContext,
        opener: Opener | None,
    ) -> None:
        self._rig_file, self._title, self._run, self._steps = rig_file, session.name, run, steps
        self._context, clock = context, context.clock.simulated
        self._opener = opener or (lambda: open_rig(rig_file, session_name=session.name, run=run, clock=clock))
        self._disconnected_since_s: float | None = None
        self._frames = 0

    def take(
        self,
        left: tuple[Step, ...],
        begun: Callable[[Rig], RunWriter],
        *,
        notify: NotifySection | None,
        repair: Repair | None = None,
    ) -> Outcome:
        """Take the remaining steps into the run that `begun` makes or opens; return how the session ended."""
        with notices(notify, self._run) as notifier, ExitStack() as devices:
            rig = devices.enter_context(self._opener())
            require_person(left, are_asked=rig.origin != "device" or self._context.asks_by_hold)
            with begun(rig) as self._writer:
                if notifier is not None:
                    self._writer.listener, notifier.note = notifier.tell, self._writer.event
                if repair is not None:
                    _note_resumed(self._writer, repair, left)
                    self._context.control.forget()
                return self._take_all(rig, devices)

    def _take_all(self, rig: Rig, devices: ExitStack) -> Outcome:
        opened: Rig | None = rig
        context = self._context
        show = Watch(
            self._run,
            self._steps,
            title=self._title,
            clock=context.clock,
            live=context.live,
            disk=self._writer.disk,
        )
        with show as watch, context.control.listening():
            while True:
                try:
                    opened = opened or self._opened_again(devices)
                    finished = self._take_rest(opened, watch)
                    frames = len(read_run(self._run).frames)
                    return Outcome(frames=frames, planned=len(self._steps), is_finished=finished)
                except (NotConnectedError, DeviceTimeoutError) as error:
                    devices.close()
                    opened = None
                    self._wait_or_give_up(error)

    def _take_rest(self, rig: Rig, watch: Watch) -> bool:
        run = read_run(self._run)
        left = _left_of(run, self._steps)
        watch.begin(left=len(left))
        metered = metered_exposures(read_events(run.path))
        self._context.metered_s = {number: exposure_s for number, exposure_s, _ in metered}
        return acquire(rig, self._rig_file, left, self._writer, progress=watch.stored, context=self._context)

    def _opened_again(self, devices: ExitStack) -> Rig:
        rig = devices.enter_context(self._opener())
        _require_same_devices(rig, read_run(self._run))
        self._writer.event("devices opened again")
        return rig

    def _wait_or_give_up(self, error: Exception) -> None:
        """Wait for a lost device; raise the error if it is not back in time."""
        clock, locks = self._context.clock, self._context.interlocks
        now_s = clock.monotonic_ns() / NS_PER_S
        frames = len(read_run(self._run).frames)
        if self._disconnected_since_s is None or frames > self._frames:
            self._disconnected_since_s, self._frames = now_s, frames
            self._writer.event("interlock", interlock="gone", action=locks.gone, message=str(error))
            if locks.gone == "hold":
                self._writer.event("hold", reason="until the device is back")
        is_too_long = locks.gone == "retry" and now_s - self._disconnected_since_s > locks.reconnect_s
        if locks.gone == "stop" or is_too_long:
            raise error
        if self._context.control.is_stop_asked():
            raise error
        clock.sleep(_RECONNECT_PAUSE_S)


def _description(
    rig: Rig, rig_file: RigFile, session: SessionFile, files: dict[str, Path], inputs: dict[str, bytes]
) -> dict[str, JsonValue]:
    """Return the origin of the run, as JSON."""
    scene = {} if rig_file.simulation is None else {"scene": rig_file.simulation.scene}
    names = {what: path.name for what, path in (files | scene).items()}
    stage = {} if rig.stage_identity is None else {"stage": vars(rig.stage_identity)}
    # Folder of the rig file, next to which is its store of calibrations. The key marks it as private.
    place = {"host_folder": str(files["rig"].absolute().parent)} if "rig" in files else {}
    light = {} if rig.light is None else {"simulated_light": asdict(rig.light)}
    return {
        "origin": rig.origin,
        "rig": rig_file.model_dump(mode="json") | {"notify": None},
        **({} if rig_file.notify is None else {"has_notices": True}),
        "session": session.model_dump(mode="json"),
        "files": {
            what: {"name": names[what], "sha256": hashlib.sha256(content).hexdigest()}
            for what, content in inputs.items()
        },
        **stage,
        "camera": vars(rig.camera_identity),
        "camera_facts": _facts_of(rig.camera),
        "versions": {package: version(package) for package in _PACKAGES},
        **light,
        **place,
    }


def _facts_of(camera: Camera) -> dict[str, JsonValue] | None:
    """Return the facts of a camera, with its features under their own names if it lists them."""
    if not isinstance(camera, ReportingCamera):
        return None
    facts = camera.facts()
    return {
        "sample_format": facts.sample_format,
        "justified": facts.justified,
        "linear": facts.linear,
        "features": dict(camera.features()),
    }


def _left_of(run: Run, steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Return the steps of a session that have no frame."""
    planned = {step.sequence: step for step in steps}
    for record in run.frames:
        _require_planned(record, planned.get(record.sequence))
    taken = {record.sequence for record in run.frames}
    return tuple(step for step in steps if step.sequence not in taken)


def _require_planned(record: FrameRecord, step: Step | None) -> None:
    if step is not None and record.kind == step.kind and _is_same_angle(record, step):
        return
    wanted = "no such step" if step is None else f"{step.kind} at {step.polarizer_angle_deg} deg"
    raise RunFolderError(
        f"{record.file}: is {record.kind} at {record.polarizer_angle_target_deg} deg, but the plan has {wanted} in its "
        "place: this run was not made by this session"
    )


def _is_same_angle(record: FrameRecord, step: Step) -> bool:
    target = record.polarizer_angle_target_deg
    if target is None or step.polarizer_angle_deg is None:
        return target is step.polarizer_angle_deg
    return abs(target - step.polarizer_angle_deg) <= _ANGLE_TOLERANCE_DEG


def _notices_of(run: Run) -> NotifySection | None:
    """Return [notify] of the present rig file, because a run folder stores no addresses."""
    stated: Any = run.session_json
    if not stated.get("has_notices"):
        return None
    file = Path(stated.get("host_folder", "")) / stated["files"].get("rig", {"name": "rig.toml"})["name"]
    try:
        return load_rig(file).notify
    except (ConfigError, OSError) as error:
        warn(f"no notices are sent: {error}")
        return None


def _last_ns(run: Run) -> int | None:
    """Return when the last frame of a run ended [ns since 1970 UTC]; None without frames."""
    ends = [frame.end_utc for frame in run.frames if frame.end_utc is not None]
    return unix_ns(utc_moment(max(ends))) + NS_PER_S if ends else None


def _require_same_devices(rig: Rig, run: Run) -> None:
    """Raise NotConnectedError if the devices are not those with which a run began."""
    found: dict[str, DeviceIdentity | None] = {"stage": rig.stage_identity, "camera": rig.camera_identity}
    for what, identity in found.items():
        if identity is None:
            continue
        before = run.session.stage if what == "stage" else run.session.camera
        if before.get("serial_number") != identity.serial_number:
            raise NotConnectedError(
                f"the {what} is {identity.model} with serial number {identity.serial_number}, and this run began with "
                f"{before.get('model')}, {before.get('serial_number')}: connect that one"
            )


def _close_again(path: Path, clock: SessionClock) -> None:
    """Close a finished run again after a repair has rewritten its manifest."""
    if wholeness(path, read_contents(path))[0] == "whole":
        return
    with RunWriter.append(path, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns) as writer:
        writer.closing_event("finished", frames=0, rounds_missed=0)


def _note_resumed(writer: RunWriter, repair: Repair, left: tuple[Step, ...]) -> None:
    writer.event(
        "resumed",
        adopted=[finding.file for finding in repair.adopted],
        set_aside=[f"{finding.file}: {finding.problem}" for finding in repair.set_aside],
        first_missing=left[0].sequence if left else None,
        missing=len(left),
    )
