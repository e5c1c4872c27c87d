"""Notices to people while a session runs, by a webhook and a command; a slow receiver delays nobody.

A notice says the run's folder, the event (as in the run's events; "failed" where the session ended with an error), what
is known of it in words, and when it was by this machine's clock.
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
from rigctl.console.terminal import warn
from rigctl.files.rig_file import NotifySection
from rigctl.runs.records import NOTICE_EVENT, RunEvent, event_facts

_MOST_WAITING = 100


@contextmanager
def notices(section: NotifySection | None, run: Path) -> Iterator["Notifier | None"]:
    """Give what is to be told of events, or None where nobody wants any; an error that ends the block is told too."""
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
    """Takes events as they come and sends those that are wanted; a full queue drops, a slow receiver delays nobody."""

    def __init__(self, section: NotifySection, run: str) -> None:
        self._section, self._run = section, run
        #: Where a notice that could not be sent is noted, while there is a run to note it in.
        self.note: Callable[..., None] | None = None
        self._waiting: queue.Queue[Mapping[str, str] | None] = queue.Queue(maxsize=_MOST_WAITING)
        self._thread = threading.Thread(target=self._work, name="notices", daemon=True)
        self._thread.start()

    def tell(self, event: str, facts: Mapping[str, JsonValue]) -> None:
        """Have somebody told of an event, if they want to be; returns at once."""
        if event not in self._section.events or event == NOTICE_EVENT:
            return
        text = event_facts(RunEvent(event=event, facts=dict(facts)))
        with suppress(queue.Full):
            self._waiting.put_nowait(notice_of(self._run, event, text))

    def close(self) -> None:
        """Wait for what is still to be sent, as long as one notice may take."""
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
    """Send one notice each way that there is; return what went wrong, nothing where all went well."""
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
