"""Requests to a running session, by signal or by command: hold, go on, stop. Always between frames.

By command they are files in the folder `requests` of the run, named by when they were made: requests of the same moment
do not overwrite each other, and are answered one after the other, each with an event.
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
    """Ask something of the session that writes into a run folder; it answers between two frames.

    Nobody needs a request after a power cut, so that it is not waited for the disk. Its unfinished file does not look
    like that of a frame, which a repair of the run would take away.
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
    """Ask something of the process that writes into a run: by its folder, or by signal where that cannot be written."""
    try:
        ask(run, request)
    except OSError:
        if process <= 0:
            raise  # 0 is "not known", and to the system the whole group of this process
        # The disk may be full or read-only, which is just when somebody wants to stop.
        number = next(number for number, wanted in _SIGNALS.items() if wanted == request)
        os.kill(process, number)


@contextmanager
def outliving_terminal() -> Iterator[None]:
    """Go on where the terminal hangs up, from before the devices are opened until the context is left."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


class Control:
    """Remembers what was asked for, until the session looks.

    A terminal that hangs up asks for nothing: the session goes on without it.
    """

    def __init__(self, run: Path | None = None) -> None:
        self._folder = None if run is None else run / REQUESTS_FOLDER
        self._requests: deque[Request] = deque()
        self._seen: set[Path] = set()
        self._is_stop_seen = False
        self.was_interrupted = False
        self.is_terminal_lost = False

    def put(self, request: Request) -> None:
        """Ask for something."""
        self._requests.append(request)

    def poll(self) -> Request | None:
        """Return the oldest request that was not returned before, or None."""
        for file in self._files():
            request = _WORDS.get(_text_of(file))
            # One that cannot be taken away, as in a folder that is read-only by now, is answered once all the same.
            self._seen.add(file)
            with suppress(OSError):
                file.unlink()
            if request is not None:
                self._requests.append(request)
        request = self._requests.popleft() if self._requests else None
        self._is_stop_seen = self._is_stop_seen or request == "stop"
        return request

    def forget(self) -> None:
        """Drop what was asked of an earlier session that ended before it looked."""
        for file in self._files():
            with suppress(OSError):
                file.unlink()
        self._requests.clear()

    def is_stop_asked(self) -> bool:
        """Return whether a stop was asked for, now or before; the request stays."""
        return self._is_stop_seen or "stop" in self._requests or any(_text_of(file) == "stop" for file in self._files())

    def _files(self) -> list[Path]:
        """Return the requests that wait, the oldest first."""
        try:
            # A look at a folder that is not there costs nothing, even on a disk that hangs.
            if self._folder is None or not self._folder.exists():
                return []
            found = [file for file in self._folder.iterdir() if not file.name.startswith(".")]
        except OSError:
            return []
        return sorted(file for file in found if file not in self._seen)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Answer to signals until the context is left: USR1 hold, USR2 go on, TERM and INT stop; INT twice is at once.

        HUP, of a terminal that is gone, is noted and the session goes on.

        Signals reach the main thread of a program only; elsewhere this does nothing.
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
