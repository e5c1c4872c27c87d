"""One session from its files to its run folder, and on from there after an interruption."""

import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from drivers.errors import DeviceTimeoutError, NotConnectedError
from drivers.interfaces import DeviceIdentity
from rigctl.config import describe, sha256_of
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.runs.repair import Repair, repair_run
from rigctl.runs.run_description import SESSION_FILE
from rigctl.runs.run_folder import Run, read_run
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.acquisition import acquire
from rigctl.sessions.conduct import Conduct, conduct_of
from rigctl.sessions.continuation import continuation
from rigctl.sessions.control import Control
from rigctl.sessions.plan import Step, plan_steps
from rigctl.sessions.rig import Rig, open_rig
from rigctl.sessions.schedule import round_times_ns
from rigctl.sessions.session_clock import SessionClock
from rigctl.sessions.watch import Watch
from rigctl.utc_time import NS_PER_S

# What decides the numbers in a run; their versions go into it.
_PACKAGES = ("rigctl", "numpy", "pyserial")
INPUTS_FOLDER = "inputs"
_RECONNECT_PAUSE_S = 2.0

Opener = Callable[[], AbstractContextManager[Rig]]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a session went.

    Attributes
    ----------
    frames : int
        How many frames the run has now.
    is_finished : bool
        It went to its end; False where somebody asked it to stop.
    repair : Repair or None
        What was done to the run before it was gone on with.
    """

    frames: int
    is_finished: bool
    repair: Repair | None = None


def take_session(
    rig_file: RigFile,
    session: SessionFile,
    out: Path,
    *,
    files: dict[str, Path],
    at_ns: int | None = None,
    until_ns: int | None = None,
    noise: dict[str, float] | None = None,
    clock: SessionClock | None = None,
    opener: Opener | None = None,
) -> Outcome:
    """Take a session into a new run folder; return how it went.

    Parameters
    ----------
    rig_file, session
        What to take, and with which devices.
    out : Path
        Run folder to make.
    files : dict
        What the two were read from; names and hashes go into the run.
    at_ns, until_ns : int, optional
        When to begin, and from when on no frame is taken [ns since 1970 UTC].
    noise : dict, optional
        What the sum rule needs of a noise calibration, as `noise_numbers` gives it.
    clock : SessionClock, optional
        The host's clocks.
    opener : callable, optional
        Gives the open rig, instead of the one that the rig file describes.

    Raises
    ------
    ConfigError, DeviceError, RunFolderError
        The rig cannot be, a device fails, or the folder cannot be written.
    KeyboardInterrupt
        Somebody pressed Ctrl-C; the frame in hand is stored.
    """
    clock = SessionClock() if clock is None else clock
    now_ns = clock.utc_ns() if at_ns is None else at_ns
    rounds = round_times_ns(session, rig_file.site, now_ns=now_ns, until_ns=until_ns)
    rounds = (at_ns,) if rounds == (None,) else rounds
    steps = plan_steps(session, rounds)
    opener = opener or (lambda: open_rig(rig_file, session_name=session.name))
    with ExitStack() as devices:
        rig = devices.enter_context(opener())
        _refuse_nobody_there(rig, steps)
        description = _describe(rig, rig_file, session, files) | {
            "rounds_ns": list(rounds),
            "until_ns": until_ns,
            "noise": noise,
        }
        with RunWriter.create(out, description, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns) as writer:
            _keep_inputs(rig_file, files, out)
            conduct = conduct_of(
                session, rig_file.site, clock=clock, control=Control(out), until_ns=until_ns, noise=noise
            )
            sitting = _Sitting(rig_file, steps, writer, conduct, opener)
            return sitting.take(rig, devices, title=session.name)


def resume_session(path: Path, *, clock: SessionClock | None = None, opener: Opener | None = None) -> Outcome:
    """Go on with a session that was interrupted; return how it went.

    Parameters
    ----------
    path : Path
        Its run folder.
    clock : SessionClock, optional
        The host's clocks.
    opener : callable, optional
        Gives the open rig, instead of the one that the run describes.

    Raises
    ------
    ConfigError, DeviceError, RunFolderError
        As `take_session`; the run was not made by a session, or its devices are others now.

    Notes
    -----
    Whole frames that were not acknowledged are adopted, damaged ones are set aside and taken again.
    """
    repair = repair_run(path)
    run = read_run(path)
    rig_file, session = _files_of(run)
    clock = SessionClock() if clock is None else clock
    until_ns = run.session.get("until_ns")
    steps = plan_steps(session, run.session.get("rounds_ns", [None]))
    rest = continuation(run, steps)
    if not rest.steps and rest.is_finished:
        return Outcome(frames=len(run.frames), is_finished=True, repair=repair)
    opener = opener or (lambda: open_rig(rig_file, session_name=session.name))
    with ExitStack() as devices:
        rig = devices.enter_context(opener())
        _refuse_nobody_there(rig, rest.steps)
        _require_same_devices(rig, run)
        with RunWriter.append(path, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns) as writer:
            _note_resumed(writer, repair, rest.steps)
            conduct = conduct_of(
                session,
                rig_file.site,
                clock=clock,
                control=Control(path),
                until_ns=until_ns,
                noise=run.session.get("noise"),
            )
            sitting = _Sitting(rig_file, steps, writer, conduct, opener)
            return replace(sitting.take(rig, devices, title=session.name), repair=repair)


class _Sitting:
    """Takes what is left of a session, and opens the devices again where one goes away meanwhile."""

    def __init__(
        self, rig_file: RigFile, steps: tuple[Step, ...], writer: RunWriter, conduct: Conduct, opener: Opener
    ) -> None:
        self._rig_file, self._steps, self._writer = rig_file, steps, writer
        self._conduct, self._opener = conduct, opener
        self._gone_since_s: float | None = None
        self._frames = 0

    def take(self, rig: Rig, devices: ExitStack, *, title: str) -> Outcome:
        opened: Rig | None = rig
        conduct = self._conduct
        show = Watch(self._writer.path, self._steps, title=title, clock=conduct.clock, live=conduct.live)
        with show as watch, self._conduct.control.listening():
            while True:
                try:
                    opened = opened or self._opened_again(devices)
                    finished = self._take_rest(opened, watch)
                    if self._conduct.control.was_interrupted and not finished:
                        raise KeyboardInterrupt
                    return Outcome(frames=len(read_run(self._writer.path).frames), is_finished=finished)
                except (NotConnectedError, DeviceTimeoutError) as error:
                    devices.close()
                    opened = None
                    self._wait_or_give_up(error)

    def _take_rest(self, rig: Rig, watch: Watch) -> bool:
        rest = continuation(read_run(self._writer.path), self._steps)
        watch.begin(left=len(rest.steps))
        is_simulated = rig.origin == "simulated"
        conduct = replace(
            self._conduct,
            metered_s=rest.metered_s,
            next_camera_frame=rest.next_camera_frame if is_simulated else None,
        )
        return acquire(rig, self._rig_file, rest.steps, self._writer, progress=watch.stored, conduct=conduct)

    def _opened_again(self, devices: ExitStack) -> Rig:
        rig = devices.enter_context(self._opener())
        self._writer.event("devices opened again")
        return rig

    def _wait_or_give_up(self, error: Exception) -> None:
        """Note that a device is gone; raise the error where it stays so for too long."""
        clock, locks = self._conduct.clock, self._conduct.interlocks
        now_s = clock.monotonic_ns() / NS_PER_S
        frames = len(read_run(self._writer.path).frames)
        if self._gone_since_s is None or frames > self._frames:
            self._gone_since_s, self._frames = now_s, frames
            self._writer.event("interlock", interlock="gone", action=locks.gone, message=str(error))
        if locks.gone == "stop" or now_s - self._gone_since_s > locks.reconnect_s:
            raise error
        if self._conduct.control.is_stop_asked():
            raise error
        clock.sleep(_RECONNECT_PAUSE_S)


def _refuse_nobody_there(rig: Rig, steps: Sequence[Step]) -> None:
    """Refuse a session that needs hands at the rig where there are none, before it has begun."""
    kinds = sorted({step.kind for step in steps})
    if rig.origin == "device" and len(kinds) > 1 and not sys.stdin.isatty():
        raise ConfigError(
            f"the session takes {', '.join(kinds)} frames, and nobody is at a terminal to cover the lens in between: "
            "take darks and flats by hand, and the scene alone unattended"
        )


def _require_same_devices(rig: Rig, run: Run) -> None:
    found: dict[str, DeviceIdentity] = {"stage": rig.stage_identity, "camera": rig.camera_identity}
    for what, identity in found.items():
        before = run.session.get(what, {})
        if before.get("serial_number") != identity.serial_number:
            raise NotConnectedError(
                f"the {what} is {identity.model} with serial number {identity.serial_number}, and this run began with "
                f"{before.get('model')}, {before.get('serial_number')}: connect that one"
            )


def _note_resumed(writer: RunWriter, repair: Repair, left: tuple[Step, ...]) -> None:
    writer.event(
        "resumed",
        adopted=[finding.file for finding in repair.adopted],
        set_aside=[f"{finding.file}: {finding.problem}" for finding in repair.set_aside],
        first_missing=left[0].sequence if left else None,
        missing=len(left),
    )


def _describe(rig: Rig, rig_file: RigFile, session: SessionFile, files: dict[str, Path]) -> dict[str, Any]:
    """Return all that a reader of the run must know of how it came about, as JSON can hold it."""
    return {
        "origin": rig.origin,
        "rig": rig_file.model_dump(mode="json"),
        "session": session.model_dump(mode="json"),
        "files": {what: {"name": path.name, "sha256": sha256_of(path)} for what, path in files.items()},
        "stage": vars(rig.stage_identity),
        "camera": vars(rig.camera_identity),
        "versions": {package: version(package) for package in _PACKAGES},
    }


def _keep_inputs(rig_file: RigFile, files: dict[str, Path], out: Path) -> None:
    """Copy the files that a person wrote into the run, and the scene that a simulated rig looks at."""
    folder = out / INPUTS_FOLDER
    scene = {} if rig_file.simulation is None else {"scene": rig_file.simulation.scene}
    for what, path in (files | scene).items():
        folder.mkdir(exist_ok=True)
        shutil.copyfile(path, folder / f"{what}.toml")


def _files_of(run: Run) -> tuple[RigFile, SessionFile]:
    if "rig" not in run.session or "session" not in run.session:
        raise RunFolderError(f"{run.path}: was not made by `rigctl acquire`: there is nothing to go on with")
    try:
        rig_file = RigFile.model_validate(run.session["rig"])
        session = SessionFile.model_validate(run.session["session"])
    except ValidationError as error:
        raise ConfigError(describe(run.path / SESSION_FILE, error)) from error
    kept = run.path / INPUTS_FOLDER / "scene.toml"
    if rig_file.simulation is None or rig_file.simulation.scene.exists() or not kept.exists():
        return rig_file, session
    return rig_file.model_copy(
        update={"simulation": rig_file.simulation.model_copy(update={"scene": kept.resolve()})}
    ), session
