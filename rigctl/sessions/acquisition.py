"""Takes a session: turn, expose, store; each frame durable, and labelled with what the devices say of themselves."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFaultError, DeviceTimeoutError
from rigctl.files.rig_file import RigFile
from rigctl.runs.run_folder import FrameRecord
from rigctl.runs.run_writer import RunWriter
from rigctl.sessions.conduct import Conduct
from rigctl.sessions.frame_record import record_of
from rigctl.sessions.frame_store import FrameStore
from rigctl.sessions.guard import Guard
from rigctl.sessions.interlocks import Taken, drift_trip, frame_trips
from rigctl.sessions.pause import Pause, StopAskedError
from rigctl.sessions.plan import BYTES_BESIDE_PIXELS, Step
from rigctl.sessions.rig import Rig
from rigctl.sessions.rig_work import RigWork
from rigctl.sessions.round_exposures import RoundExposures
from rigctl.sessions.session_clock import SteadyUtc
from rigctl.sessions.shot import Shot
from rigctl.sessions.sighting import sighting_of
from rigctl.sessions.sum_rule import SumRule
from rigctl.sessions.surroundings import Surroundings
from rigctl.sessions.thermometer import Thermometer
from rigctl.sessions.timing import Timing
from rigctl.sessions.trip import Trip
from rigctl.sessions.writer_thread import WriterThread
from rigctl.utc_time import NS_PER_S

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
        self._conduct, self._thread = conduct, thread
        self._pause = Pause(conduct.control, conduct.clock, writer.event)
        self._utc = SteadyUtc(conduct.clock) if conduct.utc is None else conduct.utc
        self._timing = Timing(conduct, self._utc, self._pause, writer)
        self._guard = Guard(conduct.interlocks, self._pause, writer)
        self._work = RigWork(rig, rig_file, writer, next_number=conduct.next_camera_frame)
        self._thermometer = Thermometer(rig.camera, conduct.clock)
        self._surroundings = Surroundings(writer.path, self._guard, self._utc, self._thermometer, note=writer.event)
        self._exposures = RoundExposures(
            steps, self._work, writer, metering=conduct.metering, metered_s=conduct.metered_s
        )
        self._sum_rule = SumRule(conduct.interlocks, conduct.noise)
        self._last_counts: NDArray[np.uint16] | None = None
        self._was_queue_full = False

    def run(self) -> int:
        """Go through the steps; return how many rounds were missed."""
        self._home()
        if self._rig.origin == "device":
            self._surroundings.look_first(self._conduct.clock)
        if self._conduct.sun is not None:
            # The first position loads the libraries that know it, which takes a second: not between two frames.
            self._conduct.sun.at(self._utc.now_ns())
        last: Step | None = None
        for step in self._steps:
            self._pause.answer()
            self._surroundings.look()
            if self._timing.is_time_for(step):
                self._bring_camera_to(step, last)
                self._take(step)
                last = step
        return self._timing.missed

    def _home(self) -> None:
        trip = self._work.home()
        for watched in self._guard.watched(() if trip is None else (trip,)):
            self._guard.react(watched, cleared=lambda: self._work.home() is None)

    def _bring_camera_to(self, step: Step, last: Step | None) -> None:
        """Bring a simulated camera to the number that keys a step's noise, where steps are left out before it."""
        if self._work.next_number is None:
            return
        number = self._work.next_number + (0 if last is None else step.sequence - last.sequence - 1)
        if last is None or number > self._work.next_number:
            self._work.bring_camera_to(number)

    def _take(self, step: Step) -> None:
        """Take one frame until its interlocks are satisfied, and hand it on to be stored."""
        exposure_s = self._exposures.of(step)
        self._work.present(step.kind)
        shot, remarks = self._satisfying_shot(step, exposure_s)
        record = self._record(step, shot, remarks)
        trips = self._guard.watched(self._cycle_trips(step, record, shot))
        record = replace(record, remarks=(*record.remarks, *(trip.message for trip in trips)))
        if self._last_counts is None:
            self._surroundings.look_ahead(len(self._steps), frame_bytes=shot.frame.counts.nbytes + BYTES_BESIDE_PIXELS)
        self._last_counts = shot.frame.counts
        self._note_full_queue()
        self._thread.put(record, shot.frame.counts)
        for trip in trips:
            # Only now: the frame is as good as its cycle, and is not lost by a stop.
            self._guard.react(trip, cleared=lambda: False)

    def _record(self, step: Step, shot: Shot, remarks: tuple[str, ...]) -> FrameRecord:
        sun = self._conduct.sun
        return record_of(
            step,
            shot,
            rig=self._rig,
            rig_file=self._rig_file,
            sun=None if sun is None else sun.at(self._utc.at_ns(shot.frame.start_monotonic_ns)),
            site=None if sun is None else sun.site,
            camera_temperature_c=self._thermometer.temperature_c(),
            remarks=(*self._surroundings.remarks, *remarks),
        )

    def _cycle_trips(self, step: Step, record: FrameRecord, shot: Shot) -> list[Trip]:
        """Tell whoever watches of a frame; return what is wrong with its cycle where it ends one."""
        seen = sighting_of(
            record,
            self._conduct.regions.of(shot.frame.counts),
            time_s=shot.frame.start_monotonic_ns / NS_PER_S,
            saturated_fraction=shot.saturated_fraction,
        )
        drift = self._conduct.live.add(seen, ends_cycle=step.ends_cycle)
        found = (self._sum_rule.add(seen, ends_cycle=step.ends_cycle), drift_trip(drift, self._guard.locks))
        return [trip for trip in found if trip is not None]

    def _satisfying_shot(self, step: Step, exposure_s: float) -> tuple[Shot, tuple[str, ...]]:
        tries_left = self._guard.locks.retries
        while True:
            shot = self._shot_or_none(step, exposure_s, tries_left)
            if shot is not None:
                trips = self._frame_trips(step, shot)
                again = [self._guard.wants_again(trip, step, tries_left=tries_left) for trip in trips]
                if not any(again):
                    return shot, tuple(trip.message for trip in trips)
                self._work.distrust()
            tries_left -= 1

    def _shot_or_none(self, step: Step, exposure_s: float, tries_left: int) -> Shot | None:
        locks = self._guard.locks
        try:
            return self._work.shoot(exposure_s=exposure_s, polarizer_angle_deg=step.polarizer_angle_deg)
        except DeviceTimeoutError as error:
            self._guard.note(Trip(name="gone", message=str(error)), sequence=step.sequence)
            if locks.gone == "stop" or tries_left <= 0:
                raise
        except DeviceFaultError as error:
            self._guard.note(Trip(name="fault", message=str(error)), sequence=step.sequence)
            if locks.fault == "stop" or (locks.fault == "retry" and tries_left <= 0):
                raise
            if locks.fault == "hold":
                self._pause.hold(str(error), cleared=lambda: False)
            # What it knew of its place may be wrong after a fault.
            self._home()
        return None

    def _frame_trips(self, step: Step, shot: Shot) -> tuple[Trip, ...]:
        taken = Taken(
            kind=step.kind,
            shot=shot,
            tolerance_deg=self._rig_file.stage.tolerance_deg,
            last_counts=self._last_counts,
        )
        return self._guard.watched(frame_trips(taken, self._guard.locks))

    def _note_full_queue(self) -> None:
        is_full = self._thread.is_full
        if is_full and not self._was_queue_full:
            text = f"{self._thread.waiting} frames wait for the disk: the session waits for it"
            for trip in self._guard.watched([Trip(name="queue", message=text)]):
                self._guard.note(trip)
        self._was_queue_full = is_full
