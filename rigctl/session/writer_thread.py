"""Stores frames while the next is taken: a bounded queue that makes the session wait, and never drops."""

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from rigctl.runs.run_folder import FrameRecord

# Frames that may wait for the disk: enough to ride over one slow flush, few enough to lose little in a power cut.
QUEUE_FRAMES = 4

Store = Callable[[FrameRecord, NDArray[np.uint16]], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Job:
    record: FrameRecord
    counts: NDArray[np.uint16]


class WriterThread:
    """Hands frames to a store in another thread, in their order. A context manager: leaving it waits for all of them.

    Parameters
    ----------
    store : callable
        Returns once a frame is durable. Called in the other thread, one frame at a time.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._queue: queue.Queue[_Job | None] = queue.Queue(maxsize=QUEUE_FRAMES)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="frame writer")

    def __enter__(self) -> "WriterThread":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._queue.put(None)
        self._thread.join()
        if kind is None:
            self._raise_failure()

    @property
    def is_full(self) -> bool:
        """Whether the next frame has to wait for the disk."""
        return self._queue.full()

    @property
    def waiting(self) -> int:
        """How many frames wait for the disk."""
        return self._queue.qsize()

    def put(self, record: FrameRecord, counts: NDArray[np.uint16]) -> None:
        """Return once there is room for a frame; it is durable later.

        Raises
        ------
        Exception
            What the store raised at an earlier frame: none is taken any more.
        """
        self._raise_failure()
        self._queue.put(_Job(record=record, counts=counts))

    def flush(self) -> None:
        """Return once every frame is durable.

        Raises
        ------
        Exception
            What the store raised.
        """
        self._queue.join()
        self._raise_failure()

    def _raise_failure(self) -> None:
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while True:
            job = self._queue.get()
            try:
                # After a failure the rest is taken off the queue, so that nobody waits for ever.
                if job is not None and self._error is None:
                    self._store(job.record, job.counts)
            except Exception as error:
                self._error = error
            finally:
                self._queue.task_done()
            if job is None:
                return
