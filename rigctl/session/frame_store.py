"""Stores frames while the next is taken: a bounded queue that makes the session wait, for a full disk too."""

import errno
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from rigctl.console.terminal import warn
from rigctl.errors import RunFolderError
from rigctl.runs.frame_record import FrameRecord
from rigctl.runs.run_writer import RunWriter
from rigctl.session.session_context import SessionContext
from rigctl.session.timing import StopAskedError
from rigctl.storage.disk_calls import DiskCalls

_RETRY_S = 1.0
_LOOK_S = 0.2
_FULL = (errno.ENOSPC, errno.EDQUOT)
# Frames that may wait for the disk: enough to ride over one slow flush, few enough to lose little in a power cut.
QUEUE_FRAMES = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredFrame:
    """A frame and its record, on its way to the disk."""

    record: FrameRecord
    counts: NDArray[np.uint16]


Frames = tuple[StoredFrame, ...]
Store = Callable[[Frames], None]


class WriterThread:
    """Hands frames to a store in another thread, in their order. A context manager: leaving it waits for all of them.

    Parameters
    ----------
    store : callable
        Returns once the frames of an exposure are durable. Called in the other thread, one exposure at a time.
    disk : DiskCalls or None
        What else is written goes through; it says how long a disk may take for the frames of an exposure before it
        hangs and is not waited for any more, and is told so.
    last_sign_s : callable
        When the store said last that it is only waiting, as it does for a full disk [s of the monotonic clock].
    """

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

    def __enter__(self) -> "WriterThread":
        self._thread.start()
        # A disk that hangs may hold the session itself at its next look into the run's folder: somebody has to say so.
        threading.Thread(target=self._watch, name="disk watch", daemon=True).start()
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
        if kind is None:
            self._raise_failure()

    @property
    def is_stalled(self) -> bool:
        """True where the disk has hung for so long that nothing more is written."""
        busy_s = self._busy_since_s
        if busy_s is not None and self._disk.is_hung:
            return True
        return busy_s is not None and time.monotonic() - max(busy_s, self._last_sign_s()) > self._stalled_s

    @property
    def is_full(self) -> bool:
        """True where the next frame has to wait for the disk."""
        return self._queue.full()

    @property
    def waiting(self) -> int:
        """Frames that wait for the disk."""
        return self._queue.qsize()

    def put(self, *frames: StoredFrame) -> None:
        """Return once there is room for the frames of an exposure; they are durable later, all or none.

        Raises
        ------
        RunFolderError
            The disk hangs.
        Exception
            What the store raised at an earlier frame: none is taken any more.
        """
        self._raise_failure()
        self._put(frames)

    def flush(self) -> None:
        """Return once every frame is durable.

        Raises
        ------
        Exception
            What the store raised.
        """
        self._wait_for_all()
        self._raise_failure()

    def flush_or_drop(self) -> tuple[int, ...]:
        """Return which frames were dropped when a stop was asked for on a full disk; the others are durable.

        Raises
        ------
        Exception
            What the store raised otherwise.
        """
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
            # What waits is dropped, should the disk come back: whoever resumes takes it again.
            self._error = RunFolderError(self._stall())
            raise self._error

    def _watch(self) -> None:
        while not self._is_over.wait(_LOOK_S):
            if self.is_stalled:
                warn(f"{self._stall()}. Where it comes back meanwhile, the session goes on")
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
                # After a failure the rest is taken off the queue, so that nobody waits for ever.
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


def _sequences(frames: Frames | None) -> list[int]:
    return [frame.record.sequence for frame in frames or ()]


class FrameStore:
    """Writes frames, and tells of each.

    Parameters
    ----------
    writer : RunWriter
        Where to.
    context : SessionContext
        What is done about a full disk, and who may stop the waiting.
    stored : callable
        Told of each record once it is durable, in the writer's thread.
    """

    def __init__(self, writer: RunWriter, context: SessionContext, stored: Callable[[FrameRecord], None]) -> None:
        self._writer, self._context, self._stored = writer, context, stored
        self.frames = 0
        self._waited_s = 0.0

    def last_sign_s(self) -> float:
        """Return when it said last that it waits for a full disk [s of the monotonic clock]."""
        return self._waited_s

    def store(self, frames: Frames) -> None:
        """Return once the frames of an exposure are durable.

        Raises
        ------
        RunFolderError
            They cannot be written, and waiting is not wanted.
        StopAskedError
            Somebody asked to stop while the disk was full: these frames are not stored.
        """
        first = frames[0].record
        waited = 0
        while True:
            try:
                written = self._writer.write_frames((frame.record, frame.counts) for frame in frames)
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
            self._note("go on")
        self.frames += len(written)
        for record in written:
            self._stored(record)

    def _note(self, name: str, **facts: str | int) -> None:
        # The disk may be too full for a line, too: the frame goes first.
        with suppress(RunFolderError):
            self._writer.event(name, **facts)

    def _waits(self, error: RunFolderError) -> bool:
        cause = error.__cause__
        is_full = isinstance(cause, OSError) and cause.errno in _FULL
        return is_full and self._context.interlocks.disk == "hold"
