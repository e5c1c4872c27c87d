"""One session from its files to its run folder, and on from there after an interruption."""

import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path

from pydantic import JsonValue

from rigctl.devices.rig import open_rig
from rigctl.errors import ConfigError
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import SessionFile
from rigctl.numbers.utc_time import NS_PER_S, unix_ns, utc_moment
from rigctl.runs.repair import Repair, repair_run
from rigctl.runs.run_folder import Run, read_contents, read_run
from rigctl.runs.run_inputs import files_of, read_inputs
from rigctl.runs.run_writer import RunWriter
from rigctl.runs.session_record import SessionNoise
from rigctl.runs.wholeness import wholeness
from rigctl.session.continuation import continuation
from rigctl.session.control import Control
from rigctl.session.notices import notices
from rigctl.session.planning.schedule import round_times_ns
from rigctl.session.planning.session_steps import Step, plan_steps
from rigctl.session.reconnect_loop import Opener, Outcome, ReconnectLoop, require_same_devices
from rigctl.session.session_clock import SessionClock, clock_of
from rigctl.session.session_context import session_context
from rigctl.session.session_description import describe_session


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
    """Take a session into a new run folder; return how it went.

    Parameters
    ----------
    rig_file, session
        What to take, and with which devices.
    out : Path
        Run folder to make.
    files : mapping
        What the two were read from; names and hashes go into the run.
    at_ns, until_ns : int, optional
        When to begin, and from when on no frame is taken [ns since 1970 UTC].
    noise : SessionNoise, optional
        What the sum rule needs of a noise calibration, as `noise_numbers` gives it.
    clock : SessionClock, optional
        The host's clocks.
    opener : callable, optional
        Gives the open rig, instead of the one that the rig file describes.
    asks_by_hold : bool
        Where hands are needed, such as to cover the lens, hold until somebody says to go on; else ask at the terminal.
    calibrations : mapping, optional
        Which were picked from the store, as the run keeps it.

    Raises
    ------
    ConfigError, DeviceError, RunFolderError
        The rig cannot be, a device fails, or the folder cannot be written.
    KeyboardInterrupt
        Somebody pressed Ctrl-C twice. After the first the frame in hand is stored and the session ends, unfinished.
    """
    clock = clock_of(rig_file) if clock is None else clock
    now_ns = clock.utc_ns() if at_ns is None else at_ns
    rounds = round_times_ns(session, rig_file.site, now_ns=now_ns, until_ns=until_ns)
    rounds = (at_ns,) if rounds == (None,) else rounds
    steps = plan_steps(session, rounds, cell_deg=rig_file.cell_deg)
    opener = opener or (lambda: open_rig(rig_file, session_name=session.name, run=out, clock=clock.simulated))
    with notices(rig_file.notify, out) as notifier, ExitStack() as devices:
        rig = devices.enter_context(opener())
        require_hands(steps, are_asked=rig.origin != "device" or asks_by_hold)
        inputs = read_inputs(rig_file, files)
        description = describe_session(rig, rig_file, session, files, inputs) | {
            "rounds_ns": list(rounds),
            "until_ns": until_ns,
            "noise": None if noise is None else asdict(noise),
            **(calibrations or {}),
        }
        with RunWriter.create(
            out, description, inputs=inputs, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns
        ) as writer:
            writer.listener = None if notifier is None else notifier.tell
            context = session_context(
                session,
                rig_file,
                clock=clock,
                control=Control(out),
                until_ns=until_ns,
                noise=noise,
                asks_by_hold=asks_by_hold,
            )
            loop = ReconnectLoop(rig_file, steps, writer, context, opener)
            return loop.take(rig, devices, title=session.name)


def resume_session(
    path: Path, *, clock: SessionClock | None = None, opener: Opener | None = None, asks_by_hold: bool = False
) -> Outcome:
    """Go on with a session that was interrupted; return how it went.

    Parameters
    ----------
    path : Path
        Its run folder.
    clock : SessionClock, optional
        The host's clocks.
    opener : callable, optional
        Gives the open rig, instead of the one that the run describes.
    asks_by_hold : bool
        As `take_session`.

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
    rig_file, session = files_of(run)
    clock = clock_of(rig_file, after_ns=_last_ns(run)) if clock is None else clock
    until_ns = run.session.until_ns
    steps = plan_steps(session, run.session.rounds_ns, cell_deg=rig_file.cell_deg)
    rest = continuation(run, steps)
    if not rest.steps and rest.is_finished:
        _close_again(path, clock)
        return Outcome(frames=len(run.frames), planned=len(steps), is_finished=True, repair=repair, was_finished=True)
    opener = opener or (lambda: open_rig(rig_file, session_name=session.name, run=path, clock=clock.simulated))
    with notices(rig_file.notify, path) as notifier, ExitStack() as devices:
        rig = devices.enter_context(opener())
        require_hands(rest.steps, are_asked=rig.origin != "device" or asks_by_hold)
        require_same_devices(rig, run)
        with RunWriter.append(path, utc_ns=clock.utc_ns, monotonic_ns=clock.monotonic_ns) as writer:
            writer.listener = None if notifier is None else notifier.tell
            _note_resumed(writer, repair, rest.steps)
            control = Control(path)
            control.forget()
            context = session_context(
                session,
                rig_file,
                clock=clock,
                control=control,
                until_ns=until_ns,
                noise=run.session.noise,
                asks_by_hold=asks_by_hold,
            )
            loop = ReconnectLoop(rig_file, steps, writer, context, opener)
            return replace(loop.take(rig, devices, title=session.name), repair=repair)


def _last_ns(run: Run) -> int | None:
    """Return when the last frame of a run ended; None where it has none [ns since 1970 UTC]."""
    ends = [frame.end_utc for frame in run.frames if frame.end_utc is not None]
    return unix_ns(utc_moment(max(ends))) + NS_PER_S if ends else None


def require_hands(steps: Sequence[Step], *, are_asked: bool) -> None:
    """Refuse a session that needs hands at the rig where there are none, before it has begun."""
    kinds = sorted({step.kind for step in steps})
    if not are_asked and len(kinds) > 1 and not sys.stdin.isatty():
        raise ConfigError(
            f"the session takes {', '.join(kinds)} frames, and nobody is at a terminal to cover the lens in between: "
            "take darks and flats by hand, and the scene alone unattended"
        )


def _close_again(path: Path, clock: SessionClock) -> None:
    """Close a run that had finished over the frames as they are now, where a repair has made its manifest again."""
    if wholeness(path, read_contents(path)).state == "whole":
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
