"""Requests to a running session, by signal or by command: hold, go on, stop. Always between frames."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Literal

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

    Raises
    ------
    OSError
        The folder cannot be written.

    Notes
    -----
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
    """Ask something of the process that writes into a run: by its folder, or by signal where that cannot be written.

    Parameters
    ----------
    run : Path
        The run folder.
    process : int
        Who writes into it, on this machine.
    request : str
        What is asked.

    Raises
    ------
    OSError
        Neither way is open.
    """
    try:
        ask(run, request)
    except OSError:
        if process <= 0:
            raise  # 0 is "not known", and to the system the whole group of this process
        # The disk may be full or read-only, which is just when somebody wants to stop.
        number = next(number for number, wanted in _SIGNALS.items() if wanted == request)
        os.kill(process, number)


class Control:
    """Remembers what was asked for, until the session looks.

    Parameters
    ----------
    run : Path or None
        The run folder in which commands leave their requests; None listens to signals only.
    """

    def __init__(self, run: Path | None = None) -> None:
        self._file = None if run is None else run / REQUEST_FILE
        self._request: Request | None = None
        self.was_interrupted = False

    def put(self, request: Request) -> None:
        """Ask for something."""
        self._request = request

    def poll(self) -> Request | None:
        """Return what was asked for since the last call, or None."""
        if self._file is not None and self._file.exists():
            self._request = _WORDS.get(self._file.read_text(encoding="ascii", errors="replace").strip())
            self._file.unlink(missing_ok=True)
        request, self._request = self._request, None
        return request

    def forget(self) -> None:
        """Drop what was asked of an earlier session that ended before it looked."""
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        self._request = None

    def is_stop_asked(self) -> bool:
        """Return whether a stop was asked for; the request stays."""
        if self._file is not None and self._file.exists():
            return self._file.read_text(encoding="ascii", errors="replace").strip() == "stop"
        return self._request == "stop"

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Answer to signals until the context is left: USR1 hold, USR2 go on, TERM and INT stop; INT twice is at once.

        Notes
        -----
        Signals reach the main thread of a program only; elsewhere this does nothing.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._on_signal) for number in _SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if number == signal.SIGINT:
            if self.was_interrupted:
                raise KeyboardInterrupt
            self.was_interrupted = True
        self._request = _SIGNALS[signal.Signals(number)]
