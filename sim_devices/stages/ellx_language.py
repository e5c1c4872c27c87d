"""Answers of a simulated Elliptec stage, from a reading of the ELLx protocol manual (Issue 10, October 2025)."""

import string
from collections.abc import Callable
from dataclasses import dataclass

from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.ellx_address import EllxOptions
from sim_devices.stages.simulated_stage import Reply

DATA_DIGITS = {
    "in": 0, "i1": 0, "i2": 0, "gs": 0, "st": 0, "us": 0, "gp": 0, "go": 0, "gj": 0, "gv": 0, "fw": 0, "bw": 0,
    "ho": 1, "ca": 1, "ga": 1, "sv": 2, "ma": 8, "mr": 8, "so": 8, "sj": 8,
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


_ADDRESS = "0"
_YEAR = "2025"
_FIRMWARE, _HARDWARE = "18", "01"

_OK, _TIMEOUT, _STALLED, _UNSUPPORTED, _OUT_OF_RANGE, _BUSY = 0, 1, 2, 3, 4, 9
_STALL_S = 2.0
_FULL_SPEED_PERCENT = 100


class EllxLanguage:
    """The stage's side of the conversation. The time is an argument, and never goes back."""

    def __init__(self, options: EllxOptions, drive: Drive) -> None:
        self._options = options
        self._drive = drive
        self._receiver = EllxReceiver()
        self._error = _OK
        self._velocity_percent = _FULL_SPEED_PERCENT
        self.heard = 0
        self._rested_s = -1e9
        self._appointment: tuple[float, Callable[[float], None]] | None = None
        self._replies: list[Reply] = []
        self._answers: dict[str, Callable[[float, str], None]] = {
            "in": self._tell_information,
            "gs": self._tell_status,
            "gp": self._tell_position,
            "gv": self._tell_velocity,
            "sv": self._set_velocity,
            "st": self._tell_status,
            "ho": self._home,
            "ma": self._move_absolute,
            "mr": self._move_relative,
        }

    def receive(self, time_s: float, data: bytes) -> list[Reply]:
        """Return the replies up to a time [s] at which these bytes arrive."""
        self._live_until(time_s)
        for command in self._receiver.receive(time_s, data):
            self._obey(time_s, command)
        return self._take_replies()

    def advance(self, time_s: float) -> list[Reply]:
        """Return the replies up to a time [s]."""
        self._live_until(time_s)
        return self._take_replies()

    def next_event_s(self) -> float | None:
        """Return when the stage does something unasked, or None."""
        return self._appointment[0] if self._appointment else None

    def _take_replies(self) -> list[Reply]:
        replies, self._replies = self._replies, []
        return replies

    def _live_until(self, time_s: float) -> None:
        if self._receiver.timed_out(time_s):
            self._error = _TIMEOUT
        while self._appointment and self._appointment[0] <= time_s:
            (due_s, keep), self._appointment = self._appointment, None
            keep(due_s)

    def _obey(self, time_s: float, command: Command) -> None:
        if command.address != _ADDRESS:
            return
        self.heard += 1
        if set(command.digits) - set(string.digits + "ABCDEF"):
            self._refuse(time_s, _OUT_OF_RANGE)
        elif command.letters not in self._answers:
            self._refuse(time_s, _UNSUPPORTED)
        else:
            self._answers[command.letters](time_s, command.digits)

    def _say(self, time_s: float, text: str) -> None:
        silent = self._options.line.silent
        if silent is None or self.heard < silent:
            self._replies.append((time_s, f"{_ADDRESS}{text}\r\n".encode("ascii")))

    def _refuse(self, time_s: float, error: int) -> None:
        self._error = error
        self._say(time_s, f"GS{error:02X}")

    def _is_busy(self, time_s: float) -> bool:
        return self._appointment is not None or self._drive.ring.is_moving(time_s)

    def _tell_information(self, time_s: float, _digits: str) -> None:
        options = self._options
        head = f"{options.model:02X}{options.serial_number:08d}{_YEAR}{_FIRMWARE}{_HARDWARE}"
        self._say(time_s, f"IN{head}{360:04X}{options.pulses:08X}")

    def _tell_status(self, time_s: float, _digits: str) -> None:
        """Tell "busy" while there is something to do, else the last error, which is forgotten by that."""
        if self._is_busy(time_s):
            self._say(time_s, f"GS{_BUSY:02X}")
            return
        self._say(time_s, f"GS{self._error:02X}")
        self._error = _OK

    def _tell_position(self, time_s: float, _digits: str) -> None:
        self._say(time_s, f"PO{self._position(time_s)}")

    def _tell_velocity(self, time_s: float, _digits: str) -> None:
        self._say(time_s, f"GV{self._velocity_percent:02X}")

    def _set_velocity(self, time_s: float, digits: str) -> None:
        percent = int(digits, 16)
        if not 1 <= percent <= _FULL_SPEED_PERCENT:
            self._refuse(time_s, _OUT_OF_RANGE)
            return
        self._velocity_percent = percent
        self._say(time_s, f"GS{_OK:02X}")

    def _home(self, time_s: float, digits: str) -> None:
        if self._begins(time_s):
            end_s = self._drive.home(time_s, clockwise=digits == "0", speed_deg_per_s=self._speed())
            self._appointment = (end_s, self._rest if self._options.motion.unhomed else self._arrive)

    def _move_absolute(self, time_s: float, digits: str) -> None:
        counts = _signed(digits)
        if abs(counts) > self._options.pulses:
            self._refuse(time_s, _OUT_OF_RANGE)
        else:
            self._move(time_s, counts)

    def _move_relative(self, time_s: float, digits: str) -> None:
        self._move(time_s, self._drive.ring.counts(time_s) + _signed(digits))

    def _move(self, time_s: float, counts: int) -> None:
        if self._begins(time_s):
            self._turn(time_s, 0 if time_s - self._rested_s < self._options.gap_s else counts)

    def _begins(self, time_s: float) -> bool:
        """Return whether a motion can begin; a stage that is busy says so instead."""
        busy = self._is_busy(time_s)
        if busy or self._options.motion.busy:
            self._say(time_s, f"GS{_BUSY:02X}")
        return not busy

    def _turn(self, time_s: float, counts: int) -> None:
        ending = self._drive.move(time_s, counts, speed_deg_per_s=self._speed())
        keep: dict[Outcome, Callable[[float], None]] = {
            "arrives": self._arrive,
            "stalls": self._give_up,
            "is turned by hand": self._press_button,
            "fails": self._fail,
        }
        late_s = _STALL_S if ending.outcome == "stalls" else 0.0
        self._appointment = (ending.time_s + late_s, keep[ending.outcome])

    def _rest(self, time_s: float) -> None:
        self._rested_s = time_s

    def _arrive(self, time_s: float) -> None:
        self._rest(time_s)
        self._say(time_s, f"PO{self._position(time_s)}")

    def _give_up(self, time_s: float) -> None:
        self._rest(time_s)
        self._refuse(time_s, _STALLED)

    def _fail(self, time_s: float) -> None:
        self._rest(time_s)
        if self._options.motion.fault is not None:
            self._refuse(time_s, int(self._options.motion.fault[0]))

    def _press_button(self, time_s: float) -> None:
        self._say(time_s, f"BS{_BUSY:02X}")
        self._appointment = (self._drive.turn_by_hand(time_s), self._release_button)

    def _release_button(self, time_s: float) -> None:
        self._say(time_s, f"BO{self._position(time_s)}")
        self._arrive(time_s)

    def _position(self, time_s: float) -> str:
        return f"{self._drive.ring.counts(time_s) % (1 << 32):08X}"

    def _speed(self) -> float:
        return self._options.motion.motor_deg_per_s * self._velocity_percent / _FULL_SPEED_PERCENT


def _signed(digits: str) -> int:
    value = int(digits, 16)
    return value if value < 1 << 31 else value - (1 << 32)
