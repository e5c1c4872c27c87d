"""Calls into a library or the kernel that are abandoned if they do not return in time."""

import queue
import threading
from collections.abc import Callable
from typing import Any, TypeVar

Result = TypeVar("Result")


class LeftBehindError(Exception):
    """A call that has not come back in time."""


def _wait(event: threading.Event, timeout_s: float) -> bool:
    return event.wait(timeout_s)


class Caller:
    """A thread that makes calls, one after the other.

    `wait` waits for an event, at most so long [s], and returns whether it is set; a test has a clock of its own.
    """

    def __init__(self, name: str, *, wait: Callable[[threading.Event, float], bool] = _wait) -> None:
        # A call, a place for its result or exception, and the event that it has ended.
        self._jobs: queue.SimpleQueue[tuple[Callable[[], Any], list[Any], threading.Event] | None] = queue.SimpleQueue()
        self._wait = wait
        self._has_ended = threading.Event()
        threading.Thread(target=self._work, name=name, daemon=True).start()

    def call(self, job: Callable[[], Result], *, within_s: float) -> Result:
        """Return what a call returns, or raise what it raises; raise LeftBehindError where it does not end in time."""
        answer, is_there = self._put(job)
        if not self._wait(is_there, within_s):
            raise LeftBehindError
        result, error = answer
        if error is not None:
            raise error
        returned: Result = result
        return returned

    def end(self, last: Callable[[], object]) -> None:
        """Make a last call once all others have ended, without waiting for it."""
        self._put(last)
        self._jobs.put(None)

    def has_ended(self, *, within_s: float) -> bool:
        """Return whether the last call has been made, waiting at most so long for it."""
        return self._wait(self._has_ended, within_s)

    def _put(self, job: Callable[[], object]) -> tuple[list[Any], threading.Event]:
        answer: list[Any] = []
        is_there = threading.Event()
        self._jobs.put((job, answer, is_there))
        return answer, is_there

    def _work(self) -> None:
        while (waiting := self._jobs.get()) is not None:
            job, answer, is_there = waiting
            try:
                answer += [job(), None]
            except BaseException as error:
                answer += [None, error]
            is_there.set()
            del job, answer, is_there, waiting
        self._has_ended.set()
