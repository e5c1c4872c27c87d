"""The loop of a session: turn, expose, check, store.

A thread of its own stores a frame while the next is taken. The queue to this thread is bounded, so the session waits
for a slow or full disk.
"""

import errno
import queue
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFaultError, DeviceTimeoutError
from drivers.interfaces import Camera, ReportingCamera
from model.processing.mosaic import samples_per_pixel
from rigctl.base.durable import DiskCalls
from rigctl.base.numbers import NS_PER_S
from rigctl.console import warn
from rigctl.errors import RunFolderError
from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import RigFile
from rigctl.rig.rig import REQUESTS, Rig
from rigctl.runs.records import TALLY_EVENT, FrameRecord
from rigctl.runs.writer import RunWriter
from rigctl.session.interlocks import Interlocks, Thermometer, Violation
from rigctl.session.monitors import Monitors
from rigctl.session.numbers import coarse_picture, frame_summary
from rigctl.session.plan import BYTES_BESIDE_PIXELS, Step, exposures_of
from rigctl.session.rig_work import CapturedFrame, RigWork, RoundExposures, record_of
from rigctl.session.timing import Pause, SessionContext, StopAskedError, Timing

_RETRY_S = 1.0
_LOOK_S, _LAST_WORD_S = 0.2, 5.0
_FULL = (errno.ENOSPC, errno.EDQUOT)
# Frames that may wait for the disk: enough to ride over one slow flush, few enough to lose little in a power cut.
QUEUE_FRAMES = 4
# Frames of one exposure with their records, on their way to the disk.
Frames = tuple[tuple[FrameRecord, NDArray[np.uint16]], ...]
Store = Callable[[Frames], None]
Progress = Callable[[Step], None]


def acquire(
    rig: Rig,
    rig_file: RigFile,
    steps: tuple[Step, ...],
    writer: RunWriter,
    *,
    progress: Progress,
    context: SessionContext,
) -> bool:
    """Take the frames of a session one after the other; return whether it was completed.

    False means that a stop was requested. All frames that were taken are on the disk when this returns
    or raises, unless the disk failed.
    """
    by_sequence = {step.sequence: step for step in steps}
    store = FrameStore(writer, context, lambda record: progress(by_sequence[record.sequence]))
    with WriterThread(store.store, disk=writer.disk, last_sign_s=store.last_sign_s) as thread:
        session = _Acquisition(rig, rig_file, steps, writer, context, thread)
        try:
            missed = session.run()
            thread.flush()
            session.pause.answer_rest("the session has finished")
        except StopAskedError:
            session.pause.answer_rest("the session stops")
            dropped = thread.flush_or_drop()
            not_stored = {"not_stored": list(dropped)} if dropped else {}
            writer.event("stopped", reason="requested", **not_stored)
            return False
        finally:
            if not (thread.is_stalled or writer.disk.is_hung):
                _note_tally(rig.camera, writer)
    # The last event of a run: any event after it means that the run was continued.
    writer.closing_event("finished", frames=store.frames, rounds_missed=missed)
    return True


class WriterThread:
    """Stores frames in order in a thread of its own. Leaving the context waits until all are stored."""

    def __init__(
        self, store: Store, *, disk: DiskCalls | None = None, last_sign_s: Callable[[], float] = lambda: 0.0
    ) -> None:
        self._store = store
        self._disk = DiskCalls() if disk is None else disk
        self._stalled_s, self._last_sign_s = self._disk.stalled_s, last_sign_s
        self._busy_since_s: float | None = None
        self._queue: queue.Queue[Frames | None] = queue.Queue(maxsize=QUEUE_FRAMES)
        self._error: Exception | None = None
        self._dropped: list[int] = []
        self._is_over = threading.Event()
        # A daemon: one that hangs in the system's kernel is left behind.
        self._thread = threading.Thread(target=self._run, name="frame writer", daemon=True)
        # A hanging disk may block the session itself at its next access to the run's folder; this thread reports it.
        self._watcher = threading.Thread(target=self._watch, name="disk watch", daemon=True)

    def __enter__(self) -> "WriterThread":
        self._thread.start()
        self._watcher.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._put(None)
            while self._thread.is_alive():
                self._thread.join(_LOOK_S)
                self._raise_stall()
        except RunFolderError:
            if kind is None:
                raise
        finally:
            self._is_over.set()
            # Nothing is reported of a session that is over.
            self._watcher.join(_LAST_WORD_S)
        if kind is None:
            self._raise_failure()

    @property
    def is_stalled(self) -> bool:
        """True if the disk has hung for so long that nothing more is written."""
        busy_s = self._busy_since_s
        if busy_s is not None and self._disk.is_hung:
            return True
        return busy_s is not None and time.monotonic() - max(busy_s, self._last_sign_s()) > self._stalled_s

    @property
    def is_full(self) -> bool:
        """True if the next frame has to wait for the disk."""
        return self._queue.full()

    @property
    def waiting(self) -> int:
        """Frames that wait for the disk."""
        return self._queue.qsize()

    def put(self, *frames: tuple[FrameRecord, NDArray[np.uint16]]) -> None:
        """Queue the frames of an exposure, waiting for room if necessary. Later all or none of them become durable."""
        self._raise_failure()
        self._put(frames)

    def flush(self) -> None:
        """Return once every frame is durable."""
        self._wait_for_all()
        self._raise_failure()

    def flush_or_drop(self) -> tuple[int, ...]:
        """Wait for the disk; return the frames that a requested stop dropped on a full disk. The others are durable."""
        self._wait_for_all()
        if not isinstance(self._error, StopAskedError):
            self._raise_failure()
        self._error = None
        return tuple(self._dropped)

    def _put(self, frames: Frames | None) -> None:
        while True:
            try:
                self._queue.put(frames, timeout=_LOOK_S)
                return
            except queue.Full:
                self._raise_failure()
                self._raise_stall()

    def _wait_for_all(self) -> None:
        with self._queue.all_tasks_done:
            while self._queue.unfinished_tasks:
                self._queue.all_tasks_done.wait(_LOOK_S)
                self._raise_stall()

    def _raise_stall(self) -> None:
        if self.is_stalled:
            self._disk.give_up()
            # Waiting frames are dropped even if the disk comes back: `rigctl resume` takes them again.
            self._error = RunFolderError(self._stall())
            raise self._error

    def _watch(self) -> None:
        while not self._is_over.wait(_LOOK_S):
            if self.is_stalled and self._error is None:
                warn(f"{self._stall()}. If it comes back, the session continues")
                return

    def _stall(self) -> str:
        waiting = self._queue.unfinished_tasks
        return (
            f"the disk hangs: it has not taken a frame for {self._stalled_s:g} s, and {waiting} frames are not stored. "
            "Look at its cable and at `dmesg`, then `rigctl resume`"
        )

    def _raise_failure(self) -> None:
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while True:
            job = self._queue.get()
            self._busy_since_s = time.monotonic()
            try:
                # After a failure the queue is emptied, so that no caller waits for ever.
                if job is not None and self._error is None:
                    self._store(job)
                else:
                    self._dropped += _sequences(job)
            except Exception as error:
                self._error = error
                self._dropped += _sequences(job)
            finally:
                self._busy_since_s = None
                self._queue.task_done()
            if job is None:
                return


class FrameStore:
    """Writes frames and reports each one that is stored."""

    def __init__(self, writer: RunWriter, context: SessionContext, stored: Callable[[FrameRecord], None]) -> None:
        self._writer, self._context, self._stored = writer, context, stored
        self.frames = 0
        self._waited_s = 0.0

    def last_sign_s(self) -> float:
        """Return when it last waited for a full disk [s of the monotonic clock]."""
        return self._waited_s

    def store(self, frames: Frames) -> None:
        """Return once the frames of an exposure are durable."""
        first, _ = frames[0]
        waited = 0
        while True:
            try:
                written = self._writer.write_frames(frames)
                break
            except RunFolderError as error:
                if not self._waits(error):
                    raise
                if self._context.control.is_stop_asked():
                    raise StopAskedError(f"frame {first.sequence} is not stored: {error}") from error
                if not waited:
                    warn(f"holding: {error}: make room, or stop")
                    self._note("hold", reason="the disk is full", sequence=first.sequence)
                waited += 1
                self._waited_s = time.monotonic()
                self._context.clock.sleep(_RETRY_S)
        if waited:
            self._note("disk was full", sequence=first.sequence, tries=waited + 1)
            self._note("continue")
        self.frames += len(written)
        for record in written:
            self._stored(record)

    def _note(self, name: str, **facts: str | int) -> None:
        # The disk may be too full even for a line; the frame has priority.
        with suppress(RunFolderError):
            self._writer.event(name, **facts)

    def _waits(self, error: RunFolderError) -> bool:
        cause = error.__cause__
        is_full = isinstance(cause, OSError) and cause.errno in _FULL
        return is_full and self._context.interlocks.disk == "hold"


class _Acquisition:
    """The state of the loop from one step to the next."""

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
        self.pause = Pause(context.control, context.clock, writer.event)
        self._utc = context.utc
        self._timing = Timing(context, self.pause, writer)
        self._work = RigWork(rig, rig_file, writer, self._hold_for if context.asks_by_hold else rig.ask)
        self._thermometer = Thermometer(rig.camera, context.clock)
        self._locks = Interlocks(context.interlocks, self.pause, writer, self._utc, self._thermometer, context.noise)
        self._exposures = RoundExposures(
            steps, self._work, writer, metering=context.metering, metered_s=context.metered_s
        )
        self._last_counts: tuple[NDArray[np.uint16], ...] | None = None
        self._is_cell_looked_at = False
        self._exposed_s: set[float] = set()
        self._was_queue_full = False
        self._monitors = Monitors(rig_file.monitors, writer.event, context.clock.utc_ns)
        self._own_samples = samples_per_pixel(rig_file.camera.interpolation)

    def run(self) -> int:
        """Go through the steps; return how many rounds were missed."""
        self._locks.look_at_home(self._work.home)
        if self._rig.origin == "device":
            self._locks.look_at_clock(self._context.clock)
        if self._context.sun is not None:
            # The first position of the sun loads libraries for a second: not between two frames.
            self._context.sun.at(self._utc.now_ns())
        try:
            for exposure in exposures_of(self._steps):
                self.pause.answer()
                self._locks.look_around()
                if self._timing.is_time_for(exposure[0]):
                    self._work.begin_step(exposure[0].sequence // len(exposure))
                    self._monitors.look(exposure[0].sequence)
                    self._take(exposure)
        finally:
            self._monitors.finish()
        return self._timing.missed

    def _hold_for(self, kind: FrameKind) -> None:
        """Hold until the requested object is before the camera and the session is continued."""
        self.pause.hold(REQUESTS[kind], cleared=lambda: False)

    def _take(self, exposure: tuple[Step, ...]) -> None:
        """Repeat an exposure until its interlocks are satisfied, then queue its frames to be stored."""
        step = exposure[0]
        exposure_s = self._exposures.of(step)
        self._work.present(step.kind)
        parts, remarks = self._satisfying_parts(step, exposure_s)
        frames: list[tuple[FrameRecord, NDArray[np.uint16]]] = []
        violations: list[Violation] = []
        for part_step, captured in zip(exposure, parts, strict=True):
            record = self._record(part_step, captured, remarks)
            found = self._cycle_violations(part_step, record, captured)
            record = replace(record, remarks=(*record.remarks, *(message for _, message in found)))
            frames.append((record, captured.frame.counts))
            violations += found
        if self._last_counts is None:
            frame_bytes = frames[0][1].nbytes + BYTES_BESIDE_PIXELS
            self._locks.look_ahead(len(self._steps), frame_bytes=frame_bytes)
        self._last_counts = tuple(counts for _, counts in frames)
        self._note_full_queue()
        self._thread.put(*frames)
        # React after the frames are queued, so that a stop does not lose them.
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

    def _cycle_violations(self, step: Step, record: FrameRecord, captured: CapturedFrame) -> tuple[Violation, ...]:
        """Update the live numbers; return the violations of a cycle that ends with this frame."""
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
                if self._is_held_for_exposure(step, captured):
                    self._work.distrust()
                    continue
                before = self._last_counts
                parts = tuple(
                    replace(part, last_counts=None if before is None else before[place])
                    for place, part in enumerate(captured.parts(self._rig_file.camera))
                )
                violations = self._locks.of_frames(parts)
                again = [self._locks.wants_again(violation, step, tries_left=tries_left) for violation in violations]
                if not any(again):
                    return parts, tuple(message for _, message in violations)
                self._work.distrust()
            tries_left -= 1

    def _is_held_for_exposure(self, step: Step, captured: CapturedFrame) -> bool:
        """Check the first frame of each stated exposure for saturation; longer ones of a bracket may saturate."""
        exposure_s = step.exposure_s
        if step.kind != "scene" or exposure_s is None or step.exposure_factor > 1.0 or exposure_s in self._exposed_s:
            return False
        self._exposed_s.add(exposure_s)
        return self._locks.is_held_for_exposure(
            captured,
            lambda: self._exposures.proposed_s(captured, step.polarizer_angle_deg),
            is_attended=self._is_attended(),
        )

    def _is_attended(self) -> bool:
        """Return True if a person is at the terminal, or if time is simulated and no person is needed."""
        if self._context.clock.simulated is not None:
            return True
        return not self._context.asks_by_hold and sys.stdin is not None and sys.stdin.isatty()

    def _captured_or_none(self, step: Step, exposure_s: float, tries_left: int) -> CapturedFrame | None:
        locks = self._locks.section
        try:
            return self._work.capture(exposure_s=exposure_s, polarizer_angle_deg=step.polarizer_angle_deg)
        except DeviceTimeoutError as error:
            self._locks.note(("gone", str(error)), sequence=step.sequence)
            if locks.gone == "stop" or tries_left <= 0:
                raise
        except DeviceFaultError as error:
            self._locks.note(("fault", str(error)), sequence=step.sequence)
            if locks.fault == "stop" or (locks.fault == "retry" and tries_left <= 0):
                raise
            if locks.fault == "hold":
                self.pause.hold(str(error), cleared=lambda: False)
            # After a fault the stage may have lost its position.
            self._locks.look_at_home(self._work.home)
        return None

    def _note_full_queue(self) -> None:
        is_full = self._thread.is_full
        if is_full and not self._was_queue_full:
            text = f"{self._thread.waiting} frames wait for the disk: the session waits for it"
            for violation in self._locks.found("queue", text):
                self._locks.note(violation)
        self._was_queue_full = is_full


def _note_tally(camera: Camera, writer: RunWriter) -> None:
    """Note how many pictures the camera has counted since it was opened, if it counts them."""
    if isinstance(camera, ReportingCamera):
        writer.event(TALLY_EVENT, **asdict(camera.tally()))


def _sequences(frames: Frames | None) -> list[int]:
    return [record.sequence for record, _ in frames or ()]
