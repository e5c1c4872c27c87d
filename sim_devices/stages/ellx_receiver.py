"""Commands to a simulated Elliptec stage, byte by byte, from a reading of the ELLx protocol manual (Issue 10, 2025)."""

from dataclasses import dataclass

# Letters of a command -> hexadecimal digits behind them: nothing else tells where a command ends.
DATA_DIGITS = {
    "in": 0, "i1": 0, "i2": 0, "gs": 0, "st": 0, "us": 0, "gp": 0, "go": 0, "gj": 0, "gv": 0, "fw": 0, "bw": 0,
    "s1": 0, "s2": 0, "c1": 0, "c2": 0, "sk": 0, "om": 0, "cm": 0,
    "ho": 1, "ca": 1, "ga": 1, "sv": 2, "is": 2, "f1": 4, "f2": 4, "b1": 4, "b2": 4,
    "ma": 8, "mr": 8, "so": 8, "sj": 8,
}  # fmt: skip

_SILENCE_S = 2.0
_ADDRESSES = b"0123456789ABCDEF"
_HEAD_BYTES = 3


@dataclass(frozen=True, kw_only=True)
class Command:
    """A whole command: who it is for, its two letters, its digits. Unknown letters have no digits."""

    address: str
    letters: str
    digits: str


class EllxReceiver:
    """Collects bytes until a command is whole; the letters alone say how long it is.

    A carriage return forgets what was collected, a line feed is skipped, so that commands may end in either.
    More than two seconds between two bytes of a command discard it, which `timed_out` tells once.
    """

    def __init__(self) -> None:
        self._collected = b""
        self._last_byte_s = 0.0

    def timed_out(self, time_s: float) -> bool:
        """Return whether a command in part was just discarded for being too slow."""
        if not self._collected or time_s - self._last_byte_s <= _SILENCE_S:
            return False
        self._collected = b""
        return True

    def receive(self, time_s: float, data: bytes) -> list[Command]:
        """Return the commands that these bytes complete."""
        self._last_byte_s = time_s
        commands = (self._take(bytes([byte])) for byte in data)
        return [command for command in commands if command is not None]

    def _take(self, byte: bytes) -> Command | None:
        if byte == b"\r":
            self._collected = b""
        elif byte != b"\n" and (self._collected or byte in _ADDRESSES):
            self._collected += byte
        return self._complete()

    def _complete(self) -> Command | None:
        if len(self._collected) < _HEAD_BYTES:
            return None
        text = self._collected.decode("latin-1")
        if len(text) < _HEAD_BYTES + DATA_DIGITS.get(text[1:3], 0):
            return None
        self._collected = b""
        return Command(address=text[0], letters=text[1:3], digits=text[3:])
