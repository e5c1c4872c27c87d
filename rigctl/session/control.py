"""Requests to a running session (hold, continue, stop), and notices that it sends.

Requests come by signal or by command. They are answered in order between two frames, each with an event. A command
writes a file into the folder `requests` of the run; the file's name is the time of the request.

Notices go to a webhook, a command or both. A slow receiver does not delay the session. A notice contains the name of
the run folder, the event (as in the run's events, or "failed" if the session ended with an error), its facts in words,
and its time by this machine's clock.
"""

import json
import os
import queue
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Literal, get_args

from pydantic import JsonValue

from rigctl.base.durable import MOST_RECORD_BYTES, read_bounded
from rigctl.base.numbers import utc_text
from rigctl.console import warn
from rigctl.files.rig_file import NotifySection
from rigctl.runs.records import NOTICE_EVENT, RunEvent, event_facts

REQUESTS_FOLDER = "requests"
_MOST_WAITING = 100
Request = Literal["hold", "continue", "stop"]
_REQUESTS: dict[str, Request] = {name: name for name in get_args(Request)}
_SIGNALS: dict[signal.Signals, Request] = {
    signal.SIGUSR1: "hold",
    signal.SIGUSR2: "continue",
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
    unfinished = folder / f".{name}"
    try:
        unfinished.write_text(request, encoding="ascii")
        unfinished.replace(folder / name)
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise


def ask_process(run: Path, process: int, request: Request) -> None:
    """Send a request to the process that writes into a run: by a file, or by a signal if no file can be written."""
    try:
        ask(run, request)
    except OSError:
        if process <= 0:
            raise  # 0 is an unknown process here, but the whole process group to os.kill
        # The disk may be full or read-only, which is a reason to stop.
        number = next(number for number, meaning in _SIGNALS.items() if meaning == request)
        os.kill(process, number)


@contextmanager
def outliving_terminal() -> Iterator[None]:
    """Keep running if the terminal hangs up while the context lasts."""
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
        """Return the oldest unanswered request, or None."""
        for file in self._files():
            request = _REQUESTS.get(_text_of(file))
            # A file that cannot be removed, as in a read-only folder, is answered only once.
            self._seen.add(file)
            with suppress(OSError):
                file.unlink()
            if request is not None:
                self._requests.append(request)
        request = self._requests.popleft() if self._requests else None
        self._is_stop_seen = self._is_stop_seen or request == "stop"
        return request

    def forget(self) -> None:
        """Drop requests that an earlier session did not answer before it ended."""
        for file in self._files():
            with suppress(OSError):
                file.unlink()
        self._requests.clear()

    def is_stop_asked(self) -> bool:
        """Return whether a stop was requested, without answering it."""
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
        """Take signals as requests while the context lasts: USR1 hold, USR2 continue, TERM and INT stop.

        A second INT stops at once. HUP (the terminal is gone) is noted and the session continues. Signals reach only
        the main thread of a program; in another thread this does nothing.
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


@contextmanager
def notices(section: NotifySection | None, run: Path) -> Iterator["Notifier | None"]:
    """Yield a notifier, or None without a section [notify]. An error that ends the context is sent as a notice, too."""
    if section is None:
        yield None
        return
    notifier = Notifier(section, run.resolve().name)
    try:
        yield notifier
    except Exception as error:
        notifier.tell("failed", {"error": str(error)})
        raise
    finally:
        notifier.close()


class Notifier:
    """Sends notices of the chosen events from a queue; a full queue drops further notices."""

    def __init__(self, section: NotifySection, run: str) -> None:
        self._section, self._run = section, run
        #: Stores an event of the run if a notice could not be sent.
        self.note: Callable[..., None] | None = None
        self._waiting: queue.Queue[Mapping[str, str] | None] = queue.Queue(maxsize=_MOST_WAITING)
        self._thread = threading.Thread(target=self._work, name="notices", daemon=True)
        self._thread.start()

    def tell(self, event: str, facts: Mapping[str, JsonValue]) -> None:
        """Queue a notice of an event if the section asks for it; returns at once."""
        if event not in self._section.events or event == NOTICE_EVENT:
            return
        text = event_facts(RunEvent(event=event, facts=dict(facts)))
        with suppress(queue.Full):
            self._waiting.put_nowait(notice_of(self._run, event, text))

    def close(self) -> None:
        """Wait for queued notices, no longer than two notices may take."""
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        self._thread.join(timeout=2.0 * self._section.timeout_s)

    def _work(self) -> None:
        while (notice := self._waiting.get()) is not None:
            try:
                problems = send(self._section, notice)
            except Exception as error:  # one notice that cannot be sent must not silence the next
                problems = (f"{type(error).__name__}: {error}",)
            for problem in problems:
                warn(f"a notice of {notice['event']!r} was not sent: {problem}")
                if self.note is not None:
                    with suppress(Exception):  # the run may be closed by now, or its disk be full
                        self.note(NOTICE_EVENT, notice=notice["event"], problem=problem)


def notice_of(run: str, event: str, text: str) -> dict[str, str]:
    """Return a notice of now."""
    return {"run": run, "event": event, "text": text, "utc": utc_text(time.time_ns())}


def send(section: NotifySection, notice: Mapping[str, str]) -> tuple[str, ...]:
    """Send one notice by webhook and command; return the errors."""
    content = json.dumps(notice).encode("ascii")
    problems = []
    if section.webhook is not None:
        problems.append(_posted(section.webhook, content, timeout_s=section.timeout_s))
    if section.command is not None:
        problems.append(_piped(section.command, content, timeout_s=section.timeout_s))
    return tuple(filter(None, problems))


def _posted(address: str, content: bytes, *, timeout_s: float) -> str:
    """Send to a webhook; return the error, without the parts of the address that may be secret."""
    from http.client import HTTPException, InvalidURL
    from urllib.parse import urlsplit
    from urllib.request import Request, urlopen

    request = Request(address, data=content, headers={"Content-Type": "application/json"})
    try:
        with urlopen(request, timeout=timeout_s):
            return ""
    except (OSError, ValueError, HTTPException) as error:  # URLError and HTTPError are OSErrors
        is_of_address = isinstance(error, ValueError | InvalidURL)
        text = "the address is wrong" if is_of_address else " ".join(str(error).split()) or type(error).__name__
        return f"webhook at {urlsplit(address).netloc.rpartition('@')[2]}: {text}"


def _piped(command: list[str], content: bytes, *, timeout_s: float) -> str:
    """Run a command with the notice on its standard input; return the error, without the command's arguments."""
    try:
        subprocess.run(command, input=content, capture_output=True, timeout=timeout_s, check=True)
    except subprocess.TimeoutExpired:
        return f"command {command[0]}: took longer than {timeout_s:g} s"
    except subprocess.CalledProcessError as error:
        return f"command {command[0]}: ended with exit code {error.returncode}"
    except (OSError, ValueError) as error:
        return f"command {command[0]}: {error}"
    return ""
