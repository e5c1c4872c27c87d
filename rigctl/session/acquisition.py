"""Takes a session: turn, expose, store; each frame durable, and labelled with what the devices say of themselves."""

from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFaultError, DeviceTimeoutError
from drivers.interfaces import Camera, ReportingCamera
from model.processing.mosaic import samples_per_pixel
from rigctl.devices.rig import REQUESTS, Rig
from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import RigFile
from rigctl.live.frame_summary import coarse_picture, frame_summary
from rigctl.numbers.utc_time import NS_PER_S
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_events import TALLY_EVENT
from rigctl.runs.run_writer import RunWriter
from rigctl.session.captured_frame import CapturedFrame, record_of
from rigctl.session.frame_store import FrameStore, StoredFrame, WriterThread
from rigctl.session.interlocks import FrameAsTaken, Interlocks, InterlockViolation, Thermometer
from rigctl.session.metering import RoundExposures
from rigctl.session.monitors import Monitors
from rigctl.session.planning.session_steps import BYTES_BESIDE_PIXELS, Step, exposures_of
from rigctl.session.rig_work import RigWork
from rigctl.session.session_clock import SteadyUtc
from rigctl.session.session_context import SessionContext
from rigctl.session.timing import Pause, StopAskedError, Timing

Progress = Callable[[Step], None]


def acquire(
    rig: Rig,
    rig_file: RigFile,
    steps: tuple[Step, ...],
    writer: RunWriter,
    *,
    progress: Progress,
    context: SessionContext | None = None,
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
    context : SessionContext, optional
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
    context = SessionContext() if context is None else context
    by_sequence = {step.sequence: step for step in steps}
    store = FrameStore(writer, context, lambda record: progress(by_sequence[record.sequence]))
    with WriterThread(store.store, disk=writer.disk, last_sign_s=store.last_sign_s) as thread:
        session = _Acquisition(rig, rig_file, steps, writer, context, thread)
        try:
            missed = session.run()
            thread.flush()
        except StopAskedError:
            dropped = thread.flush_or_drop()
            not_stored = {"not_stored": list(dropped)} if dropped else {}
            writer.event("stopped", reason="somebody asked for it", **not_stored)
            return False
        finally:
            if not (thread.is_stalled or writer.disk.is_hung):
                _note_tally(rig.camera, writer)
    # The last word of a run: whatever is noted later says that it goes on.
    writer.closing_event("finished", frames=store.frames, rounds_missed=missed)
    return True


def _note_tally(camera: Camera, writer: RunWriter) -> None:
    """Note as an event what became of the pictures since the camera was opened, where it counts them.

    Raises
    ------
    RunFolderError
        The run cannot be written.
    """
    if isinstance(camera, ReportingCamera):
        writer.event(TALLY_EVENT, **asdict(camera.tally()))


class _Acquisition:
    """Memory from one step to the next."""

    def __init__(
        self,
        rig: Rig,
        rig_file: RigFile,
        steps: tuple[Step, ...],
        writer: RunWriter,
        context: SessionContext,
        thread: WriterThread,
    ) -> None:
        self._rig, self._rig_file, self._steps = rig, rig_file, steps
        self._context, self._thread = context, thread
        self._pause = Pause(context.control, context.clock, writer.event)
        self._utc = SteadyUtc(context.clock) if context.utc is None else context.utc
        self._timing = Timing(context, self._utc, self._pause, writer)
        self._work = RigWork(rig, rig_file, writer, self._hold_for if context.asks_by_hold else rig.ask)
        self._thermometer = Thermometer(rig.camera, context.clock)
        self._locks = Interlocks(context.interlocks, self._pause, writer, self._utc, self._thermometer, context.noise)
        self._exposures = RoundExposures(
            steps, self._work, writer, metering=context.metering, metered_s=context.metered_s
        )
        self._last_counts: tuple[NDArray[np.uint16], ...] | None = None
        self._is_cell_looked_at = False
        self._was_queue_full = False
        self._monitors = Monitors(rig_file.monitors, writer.event, context.clock.utc_ns)
        self._own_samples = samples_per_pixel(rig_file.camera.interpolation)

    def run(self) -> int:
        """Go through the steps; return how many rounds were missed."""
        self._locks.look_at_home(self._work.home)
        if self._rig.origin == "device":
            self._locks.look_at_clock(self._context.clock)
        if self._context.sun is not None:
            # The first position loads the libraries that know it, which takes a second: not between two frames.
            self._context.sun.at(self._utc.now_ns())
        try:
            for exposure in exposures_of(self._steps):
                self._pause.answer()
                self._locks.look_around()
                if self._timing.is_time_for(exposure[0]):
                    self._work.begin_step(exposure[0].sequence // len(exposure))
                    self._monitors.look(exposure[0].sequence)
                    self._take(exposure)
        finally:
            self._monitors.finish()
        return self._timing.missed

    def _hold_for(self, kind: FrameKind) -> None:
        """Hold until somebody has put something before the camera, and says to go on from wherever they are."""
        self._pause.hold(REQUESTS[kind], cleared=lambda: False)

    def _take(self, exposure: tuple[Step, ...]) -> None:
        """Take one exposure until its interlocks are satisfied, and hand its frames on to be stored."""
        step = exposure[0]
        exposure_s = self._exposures.of(step)
        self._work.present(step.kind)
        parts, remarks = self._satisfying_parts(step, exposure_s)
        frames: list[StoredFrame] = []
        violations: list[InterlockViolation] = []
        for part_step, captured in zip(exposure, parts, strict=True):
            record = self._record(part_step, captured, remarks)
            found = self._cycle_violations(part_step, record, captured)
            record = replace(record, remarks=(*record.remarks, *(violation.message for violation in found)))
            frames.append(StoredFrame(record=record, counts=captured.frame.counts))
            violations += found
        if self._last_counts is None:
            frame_bytes = frames[0].counts.nbytes + BYTES_BESIDE_PIXELS
            self._locks.look_ahead(len(self._steps), frame_bytes=frame_bytes)
        self._last_counts = tuple(frame.counts for frame in frames)
        self._note_full_queue()
        self._thread.put(*frames)
        # Only now: the frame is as good as its cycle, and is not lost by a stop.
        self._locks.react_all(tuple(violations))

    def _record(self, step: Step, captured: CapturedFrame, remarks: tuple[str, ...]) -> FrameRecord:
        sun = self._context.sun
        return record_of(
            step,
            captured,
            rig=self._rig,
            rig_file=self._rig_file,
            sun=None if sun is None else sun.at(self._utc.at_ns(captured.frame.start_monotonic_ns)),
            site=None if sun is None else sun.site,
            camera_temperature_c=self._thermometer.temperature_c(),
            remarks=(*self._locks.remarks, *remarks),
        )

    def _cycle_violations(
        self, step: Step, record: FrameRecord, captured: CapturedFrame
    ) -> tuple[InterlockViolation, ...]:
        """Tell whoever watches of a frame; return what is wrong with its cycle where it ends one."""
        seen = frame_summary(
            record,
            self._context.regions.of(captured.frame.counts, share=self._own_samples),
            time_s=captured.frame.start_monotonic_ns / NS_PER_S,
            saturated_fraction=captured.saturated_fraction,
            coarse=coarse_picture(captured.frame.counts, record) if step.kind == "scene" else None,
        )
        drift = self._context.live.add(seen, ends_cycle=step.ends_cycle)
        return self._locks.of_cycle(seen, drift, ends_cycle=step.ends_cycle)

    def _satisfying_parts(self, step: Step, exposure_s: float) -> tuple[tuple[CapturedFrame, ...], tuple[str, ...]]:
        tries_left = self._locks.section.retries
        while True:
            captured = self._captured_or_none(step, exposure_s, tries_left)
            if captured is not None:
                if step.kind == "scene" and not self._is_cell_looked_at:
                    self._is_cell_looked_at = True
                    self._locks.look_at_cell(captured, self._rig_file.camera.mosaic_deg)
                parts = captured.parts(self._rig_file.camera)
                violations = self._locks.of_frames(self._as_taken(step, parts))
                again = [self._locks.wants_again(violation, step, tries_left=tries_left) for violation in violations]
                if not any(again):
                    return parts, tuple(violation.message for violation in violations)
                self._work.distrust()
            tries_left -= 1

    def _captured_or_none(self, step: Step, exposure_s: float, tries_left: int) -> CapturedFrame | None:
        locks = self._locks.section
        try:
            return self._work.capture(exposure_s=exposure_s, polarizer_angle_deg=step.polarizer_angle_deg)
        except DeviceTimeoutError as error:
            self._locks.note(InterlockViolation(name="gone", message=str(error)), sequence=step.sequence)
            if locks.gone == "stop" or tries_left <= 0:
                raise
        except DeviceFaultError as error:
            self._locks.note(InterlockViolation(name="fault", message=str(error)), sequence=step.sequence)
            if locks.fault == "stop" or (locks.fault == "retry" and tries_left <= 0):
                raise
            if locks.fault == "hold":
                self._pause.hold(str(error), cleared=lambda: False)
            # What it knew of its place may be wrong after a fault.
            self._locks.look_at_home(self._work.home)
        return None

    def _as_taken(self, step: Step, parts: tuple[CapturedFrame, ...]) -> tuple[FrameAsTaken, ...]:
        stage, before = self._rig_file.stage, self._last_counts
        return tuple(
            FrameAsTaken(
                kind=step.kind,
                captured=captured,
                tolerance_deg=0.0 if stage is None else stage.tolerance_deg,
                last_counts=None if before is None else before[place],
            )
            for place, captured in enumerate(parts)
        )

    def _note_full_queue(self) -> None:
        is_full = self._thread.is_full
        if is_full and not self._was_queue_full:
            text = f"{self._thread.waiting} frames wait for the disk: the session waits for it"
            for violation in self._locks.found("queue", text):
                self._locks.note(violation)
        self._was_queue_full = is_full
