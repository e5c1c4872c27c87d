"""Finds messages in the bytes that reach an APT controller."""

import struct
from dataclasses import dataclass

_HEADER = struct.Struct("<HBBBB")
_LONG = 0x80
_OWN_PLACES = frozenset({0x50, 0x11, 0x21})  # a USB unit, and what hosts of racks call it
_LONGEST_DATA = 255
_SILENCE_S = 0.5  # assumed: after this much of it a message in part is forgotten


@dataclass(frozen=True, kw_only=True)
class Message:
    """A whole message from the host; one with data has no parameters."""

    number: int
    first: int
    second: int
    data: bytes


class AptReceiver:
    """Collects bytes until a message is whole. What cannot be the beginning of one is passed over, byte by byte."""

    def __init__(self) -> None:
        self._collected = b""
        self._last_byte_s = 0.0

    def receive(self, time_s: float, data: bytes) -> list[Message]:
        """Return the messages that these bytes complete."""
        if time_s - self._last_byte_s > _SILENCE_S:
            self._collected = b""
        self._last_byte_s = time_s
        self._collected += data
        messages = []
        while (message := self._next()) is not None:
            messages.append(message)
        return messages

    def _next(self) -> Message | None:
        while len(self._collected) >= _HEADER.size:
            number, first, second, place, _source = _HEADER.unpack_from(self._collected)
            length = first + 256 * second if place & _LONG else 0
            if place & ~_LONG not in _OWN_PLACES or length > _LONGEST_DATA:
                self._collected = self._collected[1:]
                continue
            end = _HEADER.size + length
            if len(self._collected) < end:
                return None
            data, self._collected = self._collected[_HEADER.size : end], self._collected[end:]
            return Message(number=number, first=first, second=second, data=data)
        return None
