"""Asks a port which rotation stages are behind it. Nothing moves, and no setting or error is touched."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from drivers.errors import ProtocolError
from drivers.interfaces import DeviceIdentity
from drivers.serial_port import BytePort
from drivers.stages import apt_protocol, elliptec_protocol, zaber_protocol

_ELLX_ANSWER_S = 0.15  # an answer takes 36 ms on the line, a USB adapter adds 16 ms
_ZABER_ANSWER_S = 0.2
_APT_ANSWER_S = 0.3

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


def ask_elliptec(port: BytePort, *, now_s: Clock = time.monotonic) -> list[Answer]:
    """Return the Elliptec rotation stages on a line at 9600 bits/s, all sixteen addresses asked."""
    answers = []
    for address in "0123456789ABCDEF":
        parser = elliptec_protocol.ReplyParser()
        question = elliptec_protocol.identify(address)
        events = _events(port, question, parser, wait_s=_ELLX_ANSWER_S, enough=1, now_s=now_s)
        for event in events:
            if isinstance(event, elliptec_protocol.Information) and event.address == address:
                identity = DeviceIdentity(
                    model=elliptec_protocol.ROTATION_STAGES.get(event.stage_type, f"ELL{event.stage_type}"),
                    serial_number=event.serial_number,
                    firmware=event.firmware,
                )
                answers.append(Answer(address=address, identity=identity))
    return answers


def ask_zaber(port: BytePort, *, now_s: Clock = time.monotonic) -> list[Answer]:
    """Return the Zaber devices on a line at 115200 bits/s; every device of a chain answers for itself."""
    told: dict[int, dict[str, str]] = {}
    for message_id, setting in enumerate(("deviceid", "system.serial", "version")):
        question = zaber_protocol.command(f"get {setting}", device=0, axis=0, message_id=message_id)
        parser = zaber_protocol.ReplyParser()
        for event in _events(port, question, parser, wait_s=_ZABER_ANSWER_S, enough=None, now_s=now_s):
            if isinstance(event, zaber_protocol.Reply) and event.accepted and event.message_id == message_id:
                told.setdefault(event.device, {})[setting] = event.data
    return [
        Answer(
            address=str(device),
            identity=DeviceIdentity(
                model=f"Zaber {found['deviceid']}", serial_number=found["system.serial"], firmware=found["version"]
            ),
        )
        for device, found in sorted(told.items())
        if len(found) == 3
    ]


def ask_apt(port: BytePort, *, now_s: Clock = time.monotonic) -> list[Answer]:
    """Return the APT controller on a line at 115200 bits/s."""
    question, parser = apt_protocol.identify(), apt_protocol.MessageParser()
    return [
        Answer(
            address=None,
            identity=DeviceIdentity(model=event.model, serial_number=str(event.serial_number), firmware=event.firmware),
        )
        for event in _events(port, question, parser, wait_s=_APT_ANSWER_S, enough=1, now_s=now_s)
        if isinstance(event, apt_protocol.Information)
    ]


def _events(
    port: BytePort, question: bytes, parser: _Parser[EventT], *, wait_s: float, enough: int | None, now_s: Clock
) -> list[EventT]:
    """Return what is understood of the answers to a question, until enough came or the time is over."""
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
