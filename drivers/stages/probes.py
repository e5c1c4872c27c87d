"""Finds stages of a family on a port. Nothing moves, and no setting or error is touched."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from drivers.errors import ProtocolError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort

EventT = TypeVar("EventT", covariant=True)


class _Parser(Protocol[EventT]):
    def feed(self, data: bytes) -> None: ...

    def next_event(self) -> EventT | None: ...


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A stage that answered: at which address of its line (None where there is but one), and what it is."""

    address: str | None
    identity: DeviceIdentity


Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class StageProbe:
    """Means of finding a family; its module, which the entry point names, holds one as ``PROBE``.

    Attributes
    ----------
    baud : int
        Bit rate [1/s].
    usb_ids : tuple of (int, int or None)
        Vendor and product behind which hardly anything else can be; a product of None is any of the vendor's.
    ask : callable
        Returns the stages on an open line.
    """

    baud: int
    usb_ids: tuple[tuple[int, int | None], ...]
    ask: Callable[[BytePort], list[Answer]]


def events_after(
    port: BytePort, question: bytes, parser: _Parser[EventT], *, wait_s: float, enough: int | None, now_s: Clock
) -> list[EventT]:
    """Ask; return what is understood of the answers, until enough came or the time is over."""
    port.write(question)
    events: list[EventT] = []
    deadline_s = now_s() + wait_s
    while (remaining_s := deadline_s - now_s()) > 0.0 and (enough is None or len(events) < enough):
        data = port.read_some(timeout_s=remaining_s)
        events += _understood(parser, data)
    return events


def _understood(parser: _Parser[EventT], data: bytes) -> list[EventT]:
    events: list[EventT] = []
    try:
        parser.feed(data)
    except ProtocolError:
        return events
    while True:
        try:
            event = parser.next_event()
        except ProtocolError:
            continue  # something else speaks on this line, or speaks too: what is not understood is no answer
        if event is None:
            return events
        events.append(event)
