"""Commands to a simulated Zaber stage, out of the characters that come in; from a reading of its protocol manual."""

import re
from dataclasses import dataclass

_LONGEST = 80
_CHECKED = re.compile(r"(.*):([0-9A-F]{2})")


@dataclass(frozen=True, kw_only=True)
class Command:
    """A whole command: for which device and axis (0: all), its message id if it has one, and its words."""

    device: int
    axis: int
    message_id: str | None
    words: tuple[str, ...]


class ZaberReceiver:
    """Collects characters from a slash to the end of a line. A command whose checksum is wrong is passed over."""

    def __init__(self) -> None:
        self._collected: str | None = None

    def receive(self, data: bytes) -> list[Command]:
        """Return the commands that these bytes complete."""
        commands = (self._take(character) for character in data.decode("latin-1"))
        return [command for command in commands if command is not None]

    def _take(self, character: str) -> Command | None:
        if character in "\r\n":
            text, self._collected = self._collected, None
            return None if text is None else _understand(text)
        if self._collected is None:
            self._collected = "" if character == "/" else None
        elif len(self._collected) < _LONGEST and " " <= character <= "~":
            self._collected += character
        else:
            self._collected = None
        return None


def checksum(text: str) -> str:
    """Return the two digits that make the bytes of a message add up to 0 modulo 256."""
    return f"{-sum(text.encode('latin-1')) % 256:02X}"


def _understand(text: str) -> Command | None:
    checked = _CHECKED.fullmatch(text)
    if checked is not None:
        text, digits = checked.groups()
        if checksum(text) != digits:
            return None
    numbers, words = _leading_numbers(text.split())
    padded: list[str | None] = [*numbers, None, None, None]
    device, axis, message_id = padded[:3]
    return Command(device=int(device or 0), axis=int(axis or 0), message_id=message_id, words=words)


def _leading_numbers(words: list[str]) -> tuple[list[str], tuple[str, ...]]:
    count = 0
    while count < min(3, len(words)) and words[count].isdecimal():
        count += 1
    return words[:count], tuple(words[count:])
