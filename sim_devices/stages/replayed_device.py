"""A device that answers on its line as another one did: bytes of a recording, whatever they mean."""

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from sim_devices.clock import Clock


@dataclass(kw_only=True)
class Exchange:
    """What the host sent at once, and what came back until it sent again."""

    request: bytes  #: What the host sent; empty before its first word.
    answers: list[tuple[float, bytes]] = field(default_factory=list)  #: Delay after the request [s], and bytes.
    is_unplugged: bool = False  #: The port went away then.


def exchanges_of(events: Iterable[tuple[float, str, bytes]]) -> tuple[Exchange, ...]:
    """Return the exchanges of a line: time [s], who was heard ("host", "device" or "gone"), and the bytes."""
    found = [Exchange(request=b"")]
    asked_s: float | None = None
    for time_s, heard, data in events:
        asked_s = time_s if asked_s is None else asked_s
        if heard == "host":
            found.append(Exchange(request=data))
            asked_s = time_s
        elif heard == "gone":
            found[-1].is_unplugged = True
        else:
            found[-1].answers.append((max(0.0, time_s - asked_s), data))
    return tuple(found)


class ReplayedDevice:
    """Answers each request as it was answered in the recording. Safe to use from several threads.

    Parameters
    ----------
    exchanges : sequence of Exchange
        In their order.
    clock : Clock
        Of its delays.

    Notes
    -----
    A request that is not the next one of the recording is sought: as the one just before (a host that asks once more
    gets the same answer), then further on, then back. One that was never recorded is not answered, as by a device that
    does not understand it. Bytes that carry a count of their own, as Zaber's messages do, are answered as long as the
    host asks in the order of the recording.
    """

    def __init__(self, exchanges: Sequence[Exchange], *, clock: Clock) -> None:
        self._exchanges, self._clock = tuple(exchanges), clock
        self._lock = threading.Lock()
        self._heard = b""
        self._due: list[tuple[float, bytes]] = []
        self._next = 0
        self._gone_s: float | None = None
        self.not_understood: list[bytes] = []
        if self._exchanges and not self._exchanges[0].request:
            self._answer(0)

    def receive(self, data: bytes) -> None:
        """Take in what the host has sent."""
        with self._lock:
            self._heard += data
            while self._heard and (place := self._place_of(self._heard)) is not None:
                self._heard = self._heard[len(self._exchanges[place].request) :]
                self._answer(place)
            if self._heard and not self._may_go_on(self._heard):
                self.not_understood.append(self._heard)
                self._heard = b""

    def transmit(self) -> bytes:
        """Return what has reached the host by now and was not returned before."""
        with self._lock:
            now_s = self._clock.now_s()
            ready = b"".join(data for due_s, data in self._due if due_s <= now_s)
            self._due = [one for one in self._due if one[0] > now_s]
            return ready

    def next_event_s(self) -> float | None:
        """Return when there will be something new to transmit [s], or None while nothing is under way."""
        with self._lock:
            times = [due_s for due_s, _ in self._due] + ([] if self._gone_s is None else [self._gone_s])
            return min(times, default=None)

    def is_plugged_in(self) -> bool:
        """Return whether the host sees a port at all."""
        with self._lock:
            return self._gone_s is None or self._clock.now_s() < self._gone_s

    def _place_of(self, heard: bytes) -> int | None:
        """Return which request begins what was heard; None where none does."""
        order = [*range(self._next, self._next + 1), self._next - 1]
        order += [*range(self._next + 1, len(self._exchanges)), *range(self._next - 2, -1, -1)]
        fit = (k for k in order if 0 <= k < len(self._exchanges) and self._exchanges[k].request)
        return next((k for k in fit if heard.startswith(self._exchanges[k].request)), None)

    def _may_go_on(self, heard: bytes) -> bool:
        return any(one.request.startswith(heard) for one in self._exchanges)

    def _answer(self, place: int) -> None:
        exchange, now_s = self._exchanges[place], self._clock.now_s()
        self._due += [(now_s + delay_s, data) for delay_s, data in exchange.answers]
        if place >= self._next:
            self._next = place + 1
        if exchange.is_unplugged:
            self._gone_s = max([now_s, *(due_s for due_s, _ in self._due)])
