"""Monitors: sensors that are read once per exposure, each in a thread of its own. No frame waits for them."""

import math
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field

from drivers.interfaces import Monitor, MonitorOptions
from rigctl.base.numbers import utc_text
from rigctl.console import warn
from rigctl.errors import RunFolderError
from rigctl.files.rig_file import MonitorSection
from rigctl.rig.rig import find_driver
from rigctl.runs.records import MONITOR_EVENT, READINGS_EVENT, MonitorReadings

_GROUP = "rigctl.monitors"
# A reading may come this long after its deadline before it is given up.
_GRACE_S = 0.2
_BUSY = "busy: the reading before has not come back"

Note = Callable[..., None]


@dataclass(kw_only=True)
class _Look:
    """Readings for one exposure."""

    sequence: int
    utc: str
    asked_s: float
    waited_for: set[str]
    readings: dict[str, float | None] = field(default_factory=dict)
    problems: dict[str, str] = field(default_factory=dict)


class _Reader:
    """One sensor in its thread. After an error it is opened again for the next reading."""

    def __init__(self, section: MonitorSection, answer: Callable[[_Look, str, float | str], None]) -> None:
        self.section, self._answer = section, answer
        #: Content of the event that introduces the sensor, once it has answered.
        self.facts: dict[str, str | bool] | None = None
        self._asked: queue.Queue[_Look | None] = queue.Queue(maxsize=1)
        self._is_idle = threading.Event()
        self._is_idle.set()
        self._opened: Monitor | None = None
        threading.Thread(target=self._work, name=f"monitor {section.name}", daemon=True).start()

    def ask(self, look: _Look) -> bool:
        """Request a reading and return at once: False if the sensor is busy with the previous one."""
        if not self._is_idle.is_set():
            return False
        self._is_idle.clear()
        self._asked.put_nowait(look)
        return True

    def end(self) -> None:
        """End the thread once it is idle."""
        with suppress(queue.Full):
            self._asked.put_nowait(None)

    def _work(self) -> None:
        while (look := self._asked.get()) is not None:
            try:
                found: float | str = self._read()
            except Exception as error:  # a fault of a plug-in must not stop the session
                self._close()
                found = str(error) or type(error).__name__
            self._is_idle.set()
            self._answer(look, self.section.name, found)
        self._close()

    def _read(self) -> float:
        if self._opened is None:
            factory = find_driver(_GROUP, self.section.driver, key=f"monitors.{self.section.name}.driver").load()
            self._opened = opened_monitor(factory, self.section.options)
        value = float(self._opened.read(self.section.deadline_s))
        if not math.isfinite(value):
            raise ValueError(f"says {value}, which is no number")
        if self.facts is None:
            self.facts = {
                "monitor": self.section.name,
                "device": str(self._opened.name),
                "unit": str(self._opened.unit),
                "follows_light": self.section.follows_light,
            }
        return value

    def _close(self) -> None:
        opened, self._opened = self._opened, None
        close = getattr(opened, "close", None)
        if close is not None:
            with suppress(Exception):
                close()


def opened_monitor(factory: Callable[[MonitorOptions], Monitor], options: MonitorOptions) -> Monitor:
    """Open the monitor of a plug-in with the options of the rig file."""
    return factory(dict(options))


class Monitors:
    """All sensors of a rig while a session runs."""

    def __init__(self, sections: Sequence[MonitorSection], note: Note, utc_ns: Callable[[], int]) -> None:
        self._note, self._utc_ns = note, utc_ns
        self._lock = threading.Condition()
        self._readers = [_Reader(section, self._answered) for section in sections]
        self._looks: list[_Look] = []
        self._told: dict[str, str] = {}
        self._known: set[str] = set()
        self._warned: set[tuple[str, str]] = set()

    def look(self, sequence: int) -> None:
        """Request the readings for an exposure, and note those that are complete. Returns at once."""
        if not self._readers:
            return
        look = _Look(
            sequence=sequence,
            utc=utc_text(self._utc_ns()),
            asked_s=time.monotonic(),
            waited_for={reader.section.name for reader in self._readers},
        )
        with self._lock:
            self._looks.append(look)
        for reader in self._readers:
            if not reader.ask(look):
                self._answered(look, reader.section.name, _BUSY)
        self._note_complete()

    def finish(self) -> None:
        """Wait for outstanding readings until their deadlines, note them, and close the sensors."""
        longest_s = max((reader.section.deadline_s for reader in self._readers), default=0.0) + _GRACE_S
        with self._lock:
            self._lock.wait_for(lambda: not any(look.waited_for for look in self._looks), timeout=longest_s)
        self._note_complete(is_last=True)
        for reader in self._readers:
            reader.end()

    def _answered(self, look: _Look, name: str, found: float | str) -> None:
        with self._lock:
            if name not in look.waited_for:
                return  # given up already
            look.waited_for.discard(name)
            look.readings[name] = found if isinstance(found, float) else None
            if isinstance(found, str):
                look.problems[name] = found
            self._lock.notify_all()

    def _note_complete(self, *, is_last: bool = False) -> None:
        """Note readings in the order of their exposures; those beyond their deadline are given up."""
        with self._lock:
            for look in self._looks:
                self._give_up(look, is_last=is_last)
            count = next((k for k, look in enumerate(self._looks) if look.waited_for), len(self._looks))
            complete, self._looks = self._looks[:count], self._looks[count:]
        for reader in self._readers:
            if reader.facts is not None and reader.section.name not in self._known:
                self._known.add(reader.section.name)
                self._write(MONITOR_EVENT, reader.facts)
        for look in complete:
            self._write(READINGS_EVENT, asdict(self._record(look)))

    def _give_up(self, look: _Look, *, is_last: bool) -> None:
        for reader in self._readers:
            name, deadline_s = reader.section.name, reader.section.deadline_s
            if name in look.waited_for and (is_last or time.monotonic() - look.asked_s > deadline_s + _GRACE_S):
                look.waited_for.discard(name)
                look.readings[name] = None
                look.problems[name] = f"no answer within {deadline_s:g} s"

    def _record(self, look: _Look) -> MonitorReadings:
        order = [reader.section.name for reader in self._readers]
        changed = {name: text for name, text in look.problems.items() if self._told.get(name) != text}
        for name, text in changed.items():
            if text != _BUSY and (name, text) not in self._warned:
                self._warned.add((name, text))
                warn(f"monitor {name}: {text}; frames are taken all the same")
        self._told = dict(look.problems)
        return MonitorReadings(
            sequence=look.sequence,
            read_utc=look.utc,
            readings={name: look.readings[name] for name in order},
            problems=changed,
        )

    def _write(self, event: str, facts: Mapping[str, object]) -> None:
        with suppress(RunFolderError):  # on a full disk frames come first
            self._note(event, **facts)
