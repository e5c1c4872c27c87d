"""Calls that are left behind where they do not come back in time: into a library, or into the system's kernel."""

import queue
import threading
from collections.abc import Callable
from typing import Any, TypeVar

Result = TypeVar("Result")


class LeftBehindError(Exception):
    """A call that has not come back in time."""


class Caller:
    """A thread that makes calls, one after the other."""

    def __init__(self, name: str) -> None:
        self._jobs: queue.SimpleQueue[tuple[Callable[[], Any], _Answer] | None] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._work, name=name, daemon=True)
        self.thread.start()

    def call(self, job: Callable[[], Result], *, within_s: float) -> Result:
        """Return what a call returns, or raise what it raises; raise LeftBehindError where it does not end in time."""
        answer = _Answer()
        self._jobs.put((job, answer))
        if not answer.is_there.wait(within_s):
            raise LeftBehindError
        if answer.error is not None:
            raise answer.error
        result: Result = answer.result
        return result

    def end(self, last: Callable[[], object]) -> None:
        """Make a last call once all others have ended; nobody waits for it."""
        self._jobs.put((last, _Answer()))
        self._jobs.put(None)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            call, answer = job
            try:
                answer.result = call()
            except BaseException as error:
                answer.error = error
            answer.is_there.set()
            del call, answer, job


class _Answer:
    """What a call came to."""

    def __init__(self) -> None:
        self.is_there = threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None
