"""Requests to a running session, by signal or by command: hold, go on, stop. Always between frames."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Literal

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded

REQUEST_FILE = "request"
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
    like that of a frame, which whoever repairs the run would take away.
    """
    beside = run / f".{REQUEST_FILE}.{os.getpid()}"
    try:
        beside.write_text(request, encoding="ascii")
        beside.replace(run / REQUEST_FILE)
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
        self._file = None if run is None else run / REQUEST_FILE
        self._request: Request | None = None
        self._seen_ns: int | None = None
        self._is_stop_seen = False
        self.was_interrupted = False
        self.is_terminal_lost = False

    def put(self, request: Request) -> None:
        """Ask for something."""
        self._request = request

    def poll(self) -> Request | None:
        """Return what was asked for since the last call, or None."""
        if self._file is not None:
            try:
                # A look costs nothing on a disk that hangs; to take away what is not there would wait for it.
                if self._file.exists():
                    self._take(self._file)
            except OSError:
                self._look_without_taking()
        request, self._request = self._request, None
        self._is_stop_seen = self._is_stop_seen or request == "stop"
        return request

    def _take(self, file: Path) -> None:
        """Take a request away in one step: one that is put down meanwhile is another file, for the next look."""
        taken = file.with_name(f".{REQUEST_FILE}.taken")
        file.replace(taken)
        self._request = _WORDS.get(_text_of(taken))
        taken.unlink()

    def _look_without_taking(self) -> None:
        """See a request that cannot be taken away, as in a folder that is read-only by now: each is answered once."""
        try:
            stat = self._file.stat() if self._file is not None else None
        except OSError:
            return
        if self._file is not None and stat is not None and stat.st_mtime_ns != self._seen_ns:
            self._seen_ns = stat.st_mtime_ns
            self._request = _WORDS.get(_text_of(self._file))

    def forget(self) -> None:
        """Drop what was asked of an earlier session that ended before it looked."""
        if self._file is not None:
            with suppress(OSError):
                self._file.unlink(missing_ok=True)
        self._request = None

    def is_stop_asked(self) -> bool:
        """Return whether a stop was asked for, now or before; the request stays."""
        return (
            self._is_stop_seen or self._request == "stop" or (self._file is not None and _text_of(self._file) == "stop")
        )

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
        self._request = _SIGNALS[signal.Signals(number)]


def _text_of(file: Path) -> str:
    try:
        return read_bounded(file, MOST_RECORD_BYTES).decode("ascii", errors="replace").strip()
    except OSError:
        return ""
