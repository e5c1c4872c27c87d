"""Takes a session: turn, expose, store; each frame durable, and labelled with what the devices say of themselves."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceTimeoutError
from rigctl.files.interlock_section import Action, Watched
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_folder import FrameRecord
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.conduct import Conduct
from rigctl.sessions.frame_numbers import skip_to
from rigctl.sessions.frame_record import record_of
from rigctl.sessions.frame_store import FrameStore
from rigctl.sessions.interlocks import Taken, Trip, clock_trip, disk_trip, failure_of, frame_trips
from rigctl.sessions.metering import bright_share, meter
from rigctl.sessions.pause import Pause, StopAskedError
from rigctl.sessions.plan import Step
from rigctl.sessions.rig import Rig
from rigctl.sessions.rig_work import RigWork
from rigctl.sessions.session_clock import SteadyUtc
from rigctl.sessions.shot import Shot
from rigctl.sessions.sum_rule import SumRule
from rigctl.sessions.timing import Timing
from rigctl.sessions.writer_thread import WriterThread

Progress = Callable[[Step], None]


def acquire(
    rig: Rig,
    rig_file: RigFile,
    steps: tuple[Step, ...],
    writer: RunWriter,
    *,
    progress: Progress,
    conduct: Conduct | None = None,
) -> bool:
    """Take the frames of a session, one after the other; return whether it went to its end.

    Parameters
    ----------
    rig : Rig
        Open devices.
    rig_file : RigFile
        How the polarizer sits, the camera's gain and deadline.
    steps : tuple of Step
        What to take.
    writer : RunWriter
        Where to.
    progress : callable
        Called with each step once its frame is on the disk; from another thread.
    conduct : Conduct, optional
        Clocks, interlocks, who may interrupt.

    Raises
    ------
    DeviceError
        A device fails, or an interlock stops the session; what was taken until then is in the run.
    RunFolderError
        The disk is full or cannot be written.

    Notes
    -----
    False is returned where somebody asked to stop. All frames that were taken are on the disk when this returns
    or raises, unless the disk failed.
    """
    conduct = Conduct() if conduct is None else conduct
    by_sequence = {step.sequence: step for step in steps}
    store = FrameStore(writer, conduct, lambda record: progress(by_sequence[record.sequence]))
    with WriterThread(store.store) as thread:
        session = _Acquisition(rig, rig_file, steps, writer, conduct, thread)
        try:
            missed = session.run()
        except StopAskedError:
            thread.flush()
            writer.event("stopped", reason="somebody asked for it")
            return False
        thread.flush()
    writer.event("finished", frames=store.frames, rounds_missed=missed)
    return True


class _Acquisition:
    """What is to be remembered from one step to the next."""

    def __init__(
        self,
        rig: Rig,
        rig_file: RigFile,
        steps: tuple[Step, ...],
        writer: RunWriter,
        conduct: Conduct,
        thread: WriterThread,
    ) -> None:
        self._rig, self._rig_file, self._steps = rig, rig_file, steps
        self._writer, self._conduct, self._thread = writer, conduct, thread
        self._locks = conduct.interlocks
        self._work = RigWork(rig, rig_file, writer, checks_settings=self._locks.settings != "off")
        self._pause = Pause(conduct.control, conduct.clock, writer.event)
        self._utc = SteadyUtc(conduct.clock) if conduct.utc is None else conduct.utc
        self._timing = Timing(conduct, self._utc, self._pause, writer)
        self._sum_rule = SumRule(self._locks, conduct.variance_of_mean)
        self._metered_s = dict(conduct.metered_s)
        self._last_counts: NDArray[np.uint16] | None = None
        self._next_number = conduct.next_camera_frame
        self._clock_remarks: tuple[str, ...] = ()
        self._was_queue_full = False

    def run(self) -> int:
        """Go through the steps; return how many rounds were missed."""
        self._work.home()
        if self._conduct.sun is not None:
            # The first position loads the libraries that know it, which takes a second: not between two frames.
            self._conduct.sun.at(self._utc.now_ns())
        last: Step | None = None
        for step in self._steps:
            self._pause.answer()
            self._watch_host()
            if self._timing.is_time_for(step):
                self._bring_camera_to(step, last)
                self._take(step)
                last = step
        return self._timing.missed

    def _watch_host(self) -> None:
        trip = None if self._locks.clock == "off" else clock_trip(self._utc.jump_s(), self._locks)
        if trip is not None:
            self._clock_remarks = (*self._clock_remarks, trip.message)
            self._react(trip, self._locks.clock, cleared=lambda: False)
        trip = None if self._locks.disk == "off" else disk_trip(self._writer.path, self._locks)
        if trip is not None:
            self._react(trip, self._locks.disk, cleared=lambda: disk_trip(self._writer.path, self._locks) is None)

    def _bring_camera_to(self, step: Step, last: Step | None) -> None:
        """Bring a simulated camera to the number that keys a step's noise, where steps are left out before it."""
        if self._next_number is None:
            return
        number = self._next_number + (0 if last is None else step.sequence - last.sequence - 1)
        if last is None or number > self._next_number:
            skip_to(self._rig.camera, number)
            self._next_number = number

    def _take(self, step: Step) -> None:
        """Take one frame until its interlocks are satisfied, and hand it on to be stored."""
        exposure_s = self._exposure_of(step)
        self._work.present(step.kind)
        shot, remarks = self._satisfying_shot(step, exposure_s)
        self._last_counts = shot.frame.counts
        sun = self._conduct.sun
        record = record_of(
            step,
            shot,
            rig=self._rig,
            rig_file=self._rig_file,
            sun=None if sun is None else sun.at(self._utc.at_ns(shot.frame.start_monotonic_ns)),
            site=None if sun is None else sun.site,
            remarks=(*self._clock_remarks, *remarks),
        )
        mean_dn = float(shot.frame.counts.mean())
        self._conduct.live.add(step, shot, mean_dn=mean_dn)
        trip = self._sum_rule_trip(step, record, mean_dn, shot.frame.counts.size)
        if trip is not None:
            record = replace(record, remarks=(*record.remarks, trip.message))
        self._note_full_queue()
        self._thread.put(record, shot.frame.counts)
        if trip is not None:
            # Only now: the frame is as good as its cycle, and is not lost by a stop.
            self._react(trip, self._locks.sum_rule, cleared=lambda: False)

    def _satisfying_shot(self, step: Step, exposure_s: float) -> tuple[Shot, tuple[str, ...]]:
        tries_left = self._locks.retries
        while True:
            shot = self._shot_or_none(step, exposure_s, tries_left)
            if shot is not None:
                trips = self._trips(step, shot)
                again = [self._is_taken_again(step, trip, tries_left) for trip in trips]
                if not any(again):
                    return shot, tuple(trip.message for trip in trips)
                self._work.distrust_angle()
            tries_left -= 1

    def _shot_or_none(self, step: Step, exposure_s: float, tries_left: int) -> Shot | None:
        try:
            shot = self._work.shoot(exposure_s=exposure_s, polarizer_angle_deg=step.polarizer_angle_deg)
        except DeviceTimeoutError as error:
            self._note_trip(Trip(name="gone", message=str(error)), self._locks.gone, sequence=step.sequence)
            if self._locks.gone == "stop" or tries_left <= 0:
                raise
            return None
        if self._next_number is not None:
            self._next_number = shot.frame.sequence + 1
        return shot

    def _trips(self, step: Step, shot: Shot) -> tuple[Trip, ...]:
        taken = Taken(
            kind=step.kind,
            shot=shot,
            tolerance_deg=self._rig_file.stage.tolerance_deg,
            last_counts=self._last_counts,
        )
        return tuple(trip for trip in frame_trips(taken, self._locks) if getattr(self._locks, trip.name) != "off")

    def _is_taken_again(self, step: Step, trip: Trip, tries_left: int) -> bool:
        action: Action = getattr(self._locks, trip.name)
        self._note_trip(trip, action, sequence=step.sequence)
        if action == "stop" or (action == "retry" and tries_left <= 0):
            raise failure_of(trip)
        if action == "hold":
            self._pause.hold(trip.message, cleared=lambda: False)
        return action in ("retry", "hold")

    def _react(self, trip: Trip, action: Watched, *, cleared: Callable[[], bool]) -> None:
        self._note_trip(trip, action)
        if action == "stop":
            raise failure_of(trip)
        if action == "hold":
            self._pause.hold(trip.message, cleared=cleared)

    def _note_trip(self, trip: Trip, action: str, **facts: int) -> None:
        self._writer.event("interlock", interlock=trip.name, action=action, message=trip.message, **facts)

    def _note_full_queue(self) -> None:
        is_full = self._thread.is_full
        if is_full and not self._was_queue_full and self._locks.queue == "note":
            text = f"{self._thread.waiting} frames wait for the disk: the session waits for it"
            self._note_trip(Trip(name="queue", message=text), "note")
        self._was_queue_full = is_full

    def _sum_rule_trip(self, step: Step, record: FrameRecord, mean_dn: float, pixels: int) -> Trip | None:
        if self._locks.sum_rule == "off":
            return None
        return self._sum_rule.add(step, mean_dn=mean_dn, exposure_s=record.exposure_s or 0.0, pixels=pixels)

    def _exposure_of(self, step: Step) -> float:
        if step.exposure_s is not None:
            return step.exposure_s
        if step.round not in self._metered_s:
            self._metered_s[step.round] = self._metered(step.round)
        return self._metered_s[step.round] * step.exposure_factor

    def _metered(self, number: int) -> float:
        angles = {s.polarizer_angle_deg for s in self._steps if s.round == number and s.kind == "scene"}
        ordered = sorted(angles, key=lambda angle: angle or 0.0)
        self._work.present("scene")
        found = meter(
            lambda exposure_s: {angle: self._bright_share(exposure_s, angle) for angle in ordered},
            self._conduct.metering,
        )
        self._writer.event(
            "metered",
            round=number,
            exposure_s=found.exposure_s,
            shares={str(angle): share for angle, share in found.shares.items()},
            remark=found.remark,
            next_camera_frame=self._next_number,
        )
        return found.exposure_s

    def _bright_share(self, exposure_s: float, angle_deg: float | None) -> float:
        shot = self._work.shoot(exposure_s=exposure_s, polarizer_angle_deg=angle_deg)
        if self._next_number is not None:
            self._next_number = shot.frame.sequence + 1
        return bright_share(
            shot.frame.counts,
            quantile=self._conduct.metering.quantile,
            full_dn=float(2**shot.frame.settings.bit_depth - 1),
        )
