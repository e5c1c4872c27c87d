"""Notices to people while a session runs, by a webhook, a command or both. A slow receiver does not delay the session.

A notice contains the name of the run folder, the event (as in the run's events, or "failed" if the session ended with
an error), its facts in words, and its time by this machine's clock.
"""

import json
import queue
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import JsonValue

from rigctl.base.numbers import utc_text
from rigctl.console import warn
from rigctl.files.rig_file import NotifySection
from rigctl.runs.records import NOTICE_EVENT, RunEvent, event_facts

_MOST_WAITING = 100


@contextmanager
def notices(section: NotifySection | None, run: Path) -> Iterator["Notifier | None"]:
    """Yield a notifier, or None without a section [notify]; an error that ends the block is reported too."""
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
    """Sends notices of the wanted events from a queue; a full queue drops further notices."""

    def __init__(self, section: NotifySection, run: str) -> None:
        self._section, self._run = section, run
        #: Notes a notice that could not be sent in the run.
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
        problems.append(_told(section.command, content, timeout_s=section.timeout_s))
    return tuple(filter(None, problems))


def _posted(address: str, content: bytes, *, timeout_s: float) -> str:
    from http.client import HTTPException
    from urllib.request import Request, urlopen

    request = Request(address, data=content, headers={"Content-Type": "application/json"})
    try:
        with urlopen(request, timeout=timeout_s):
            return ""
    except (OSError, ValueError, HTTPException) as error:  # URLError and HTTPError are OSErrors
        return f"webhook {address}: {' '.join(str(error).split()) or type(error).__name__}"


def _told(command: list[str], content: bytes, *, timeout_s: float) -> str:
    try:
        subprocess.run(command, input=content, capture_output=True, timeout=timeout_s, check=True)
    except (OSError, subprocess.SubprocessError, ValueError) as error:
        return f"command {command[0]}: {error}"
    return ""
