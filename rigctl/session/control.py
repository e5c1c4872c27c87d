"""Requests to a running session, by signal or by command: hold, continue, stop. They are answered between two frames.

A command writes a file into the folder `requests` of the run. The name of the file is the time of the request, so
simultaneous requests do not overwrite each other. The session answers them in order, each with an event.
"""

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Literal

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded

REQUESTS_FOLDER = "requests"
Request = Literal["hold", "go on", "stop"]
_WORDS: dict[str, Request] = {"hold": "hold", "go on": "go on", "stop": "stop"}
_SIGNALS: dict[signal.Signals, Request] = {
    signal.SIGUSR1: "hold",
    signal.SIGUSR2: "go on",
    signal.SIGTERM: "stop",
    signal.SIGINT: "stop",
}


def ask(run: Path, request: Request) -> None:
    """Send a request to the session that writes into a run folder; it is answered between two frames.

    A request has no value after a power cut, so it is not flushed to the disk. The name of its unfinished file differs
    from that of a frame, so a repair of the run does not move it.
    """
    folder = run / REQUESTS_FOLDER
    folder.mkdir(exist_ok=True)
    name = f"{time.time_ns():020d}-{os.getpid()}-{threading.get_ident()}"
    beside = folder / f".{name}"
    try:
        beside.write_text(request, encoding="ascii")
        beside.replace(folder / name)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


def ask_process(run: Path, process: int, request: Request) -> None:
    """Send a request to the process that writes into a run: by its folder, or by a signal if that cannot be written."""
    try:
        ask(run, request)
    except OSError:
        if process <= 0:
            raise  # 0 means "not known" here, and the whole process group to the system
        # The disk may be full or read-only, which is a reason to stop.
        number = next(number for number, wanted in _SIGNALS.items() if wanted == request)
        os.kill(process, number)


@contextmanager
def outliving_terminal() -> Iterator[None]:
    """Keep running if the terminal hangs up, from before the devices are opened until the context is left."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


class Control:
    """Collects requests until the session polls them.

    A terminal that hangs up is no request: the session continues without it.
    """

    def __init__(self, run: Path | None = None) -> None:
        self._folder = None if run is None else run / REQUESTS_FOLDER
        self._requests: deque[Request] = deque()
        self._seen: set[Path] = set()
        self._is_stop_seen = False
        self.was_interrupted = False
        self.is_terminal_lost = False

    def put(self, request: Request) -> None:
        """Add a request."""
        self._requests.append(request)

    def poll(self) -> Request | None:
        """Return the oldest request that was not returned before, or None."""
        for file in self._files():
            request = _WORDS.get(_text_of(file))
            # A file that cannot be removed, as in a folder that has become read-only, is answered only once.
            self._seen.add(file)
            with suppress(OSError):
                file.unlink()
            if request is not None:
                self._requests.append(request)
        request = self._requests.popleft() if self._requests else None
        self._is_stop_seen = self._is_stop_seen or request == "stop"
        return request

    def forget(self) -> None:
        """Drop requests to an earlier session that ended before it answered them."""
        for file in self._files():
            with suppress(OSError):
                file.unlink()
        self._requests.clear()

    def is_stop_asked(self) -> bool:
        """Return whether a stop was requested, now or before; the request stays."""
        return self._is_stop_seen or "stop" in self._requests or any(_text_of(file) == "stop" for file in self._files())

    def _files(self) -> list[Path]:
        """Return the waiting requests, the oldest first."""
        try:
            # A missing folder costs nothing, even on a hanging disk.
            if self._folder is None or not self._folder.exists():
                return []
            found = [file for file in self._folder.iterdir() if not file.name.startswith(".")]
        except OSError:
            return []
        return sorted(file for file in found if file not in self._seen)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take signals as requests until the context is left: USR1 hold, USR2 continue, TERM and INT stop.

        A second INT stops at once. HUP, of a terminal that is gone, is noted and the session continues. Signals reach
        only the main thread of a program; in another thread this does nothing.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._on_signal) for number in (*_SIGNALS, signal.SIGHUP)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            self.is_terminal_lost = True
            return
        if number == signal.SIGINT:
            if self.was_interrupted:
                raise KeyboardInterrupt
            self.was_interrupted = True
        self._requests.append(_SIGNALS[signal.Signals(number)])


def _text_of(file: Path) -> str:
    try:
        return read_bounded(file, MOST_RECORD_BYTES).decode("ascii", errors="replace").strip()
    except OSError:
        return ""
