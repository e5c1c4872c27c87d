"""A simulated Elliptec stage: motors, commands byte by byte, answers, address (``sim:ellx?stall=3&busy=1``).

Written from the ELLx protocol manual (Issue 10, October 2025), without the driver's code.
"""

import string
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.options import (
    COMMON_KEYS,
    StageOptions,
    fault_key,
    number,
    one_of,
    whole,
)
from sim_devices.stages.stage import Language

_TICKS_HZ = 14_740_000  # a period counts these
_CURRENT_PER_A = 1866
_TUNED = 0x8000  # before a period from the host
_FACTORY = 0xFFFF  # requests the factory period of the motor
_LOWEST_HZ, _HIGHEST_HZ = 70_000, 120_000
_CURVE_FROM, _CURVE_POINTS = 123, 87
_IDLE_A, _RESONANT_A, _RESONANCE_WIDTH = 0.05, 0.55, 6.0
_RAMP = "FFFF"  # unused in every published answer

_BORN = {"1": {"f": 189, "b": 139}, "2": {"f": 188, "b": 140}}  # 78.0 and 106.0 kHz; 78.4 and 105.3


class EllxMotors:
    """The two resonant motors of a rotary stage, each with a period for either direction."""

    def __init__(self) -> None:
        self._periods = {motor: dict(ways) for motor, ways in _BORN.items()}

    def information(self, motor: str) -> str:
        """Return the answer to `i1` and `i2`: loop, motor, current, ramps, periods forward and backward."""
        ways = self._periods[motor]
        return f"I{motor}10{round(_IDLE_A * _CURRENT_PER_A):04X}{_RAMP}{_RAMP}{ways['f']:04X}{ways['b']:04X}"

    def set_period(self, letters: str, period: int) -> bool:
        """Execute `f1`, `b1`, `f2`, `b2`; return whether the motor can follow."""
        way, motor = letters[0], letters[1]
        asked = _BORN[motor][way] if period == _FACTORY else period & ~_TUNED
        if not asked or not _LOWEST_HZ <= _TICKS_HZ / asked <= _HIGHEST_HZ:
            return False
        self._periods[motor][way] = asked
        return True

    def search(self, motor: str) -> None:
        """Restore the factory resonances."""
        self._periods[motor] = dict(_BORN[motor])

    def curve(self, motor: str) -> str:
        """Return the answer to `c1` and `c2`: current against period, little-endian unlike all other data."""
        points = (self._point(motor, _CURVE_FROM + index) for index in range(_CURVE_POINTS))
        return f"C{motor}{''.join(points)}"

    def _point(self, motor: str, period: int) -> str:
        off = min(abs(period - resonance) for resonance in _BORN[motor].values()) / _RESONANCE_WIDTH
        current = round((_IDLE_A + _RESONANT_A / (1.0 + off * off)) * _CURRENT_PER_A)
        return (period.to_bytes(2, "little") + current.to_bytes(4, "little")).hex().upper()


# Letters of a command -> number of hexadecimal digits after them, the only sign of its end.
DATA_DIGITS = {
    "in": 0, "i1": 0, "i2": 0, "gs": 0, "st": 0, "us": 0, "gp": 0, "go": 0, "gj": 0, "gv": 0, "fw": 0, "bw": 0,
    "s1": 0, "s2": 0, "c1": 0, "c2": 0, "sk": 0, "om": 0, "cm": 0,
    "ho": 1, "ca": 1, "ga": 1, "sv": 2, "is": 2, "f1": 4, "f2": 4, "b1": 4, "b2": 4,
    "ma": 8, "mr": 8, "so": 8, "sj": 8,
}  # fmt: skip

_SILENCE_S = 2.0
_ADDRESSES = b"0123456789ABCDEF"
_HEAD_BYTES = 3


# Address, letters and digits; unknown letters have no digits.
Command = tuple[str, str, str]


class EllxReceiver:
    """Collects bytes to commands, whose letters determine their length.

    A carriage return discards an incomplete command and a line feed is skipped, so commands may end in either. More
    than two seconds between two bytes discard a command, which `timed_out` reports once.
    """

    def __init__(self) -> None:
        self._collected = b""
        self._last_byte_s = 0.0

    def timed_out(self, time_s: float) -> bool:
        """Return whether a slow partial command was just discarded."""
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
        text = self._collected.decode("latin-1")
        if len(text) < _HEAD_BYTES or len(text) < _HEAD_BYTES + DATA_DIGITS.get(text[1:3], 0):
            return None
        self._collected = b""
        return text[0], text[1:3], text[3:]


@dataclass(frozen=True, kw_only=True)
class EllxOptions(StageOptions):
    """A stage and its faults. The defaults are a sound ELL14."""

    motor_deg_per_s: float = 430.0
    landing_deg: float = 0.004
    model: int = 14  #: Number in the model's name.
    serial_number: int = 11401326  #: At most eight digits.
    #: Encoder counts per turn: 143360 in every published reply of an ELL14, 262144 in the manual's table.
    pulses: int = 143360
    address: str = "0"  #: Its address, a hexadecimal digit.
    gap_s: float = 0.0  #: A move sent sooner after the last one ended goes to 0 instead.

    @property
    def counts_per_turn(self) -> int:
        """Encoder counts of a turn of the ring."""
        return self.pulses


def _status_code(text: str) -> int:
    code = int(text, 0)
    if not 1 <= code <= 255:
        raise ValueError(text)
    return code


KEYS = {
    "model": whole("model", "number in the model's name", 1, 255),
    "serial": whole("serial_number", "serial number", 0, 99999999),
    "pulses": whole("pulses", "encoder counts of a turn", 1, 0x7FFFFFFF),
    "address": one_of("address", "place on the line", {digit: digit for digit in "0123456789ABCDEF"}),
    "gap": number("gap_s", "a move sooner than this after the last goes to 0 [s]", 0, 60),
    "fault": fault_key(_status_code, codes="a status from 1 to 255"),
    **COMMON_KEYS,
}


_YEAR = "2025"
_FIRMWARE, _HARDWARE = "18", "01"

_OK, _TIMEOUT, _STALLED, _UNSUPPORTED, _OUT_OF_RANGE, _OUT_OF_ISOLATION, _BUSY = 0, 1, 2, 3, 4, 6, 9
_STALL_S = 2.0
_FULL_SPEED_PERCENT = 100
_JOGS_PER_TURN, _OFFSETS_PER_TURN = 36, 360  # defaults: jogs of 10 deg, home 1 deg behind the mark (assumed)
_MOVES = frozenset({"ho", "ma", "mr", "fw", "bw"})
# Durations (assumed; the manual has "up to 12 s" for a curve and "several minutes" for the last two).
_SEARCH_S, _CURVE_S, _OPTIMIZE_S, _CLEAN_S = 1.5, 12.0, 180.0, 240.0


class EllxLanguage(Language):
    """What an Elliptec stage hears and says."""

    _options: EllxOptions

    def __init__(self, options: EllxOptions, drive: Drive) -> None:
        super().__init__(options, drive)
        self._receiver = EllxReceiver()
        self._error = _OK
        self._velocity_percent = _FULL_SPEED_PERCENT
        self._rested_s = -1e9
        self._address, self._group = options.address, ""
        self._isolated_until_s = -1e9
        self._jog_counts = options.pulses // _JOGS_PER_TURN
        self._born_offset = self._home_offset = options.pulses // _OFFSETS_PER_TURN
        self._motors = EllxMotors()
        self._stoppable = False
        self._answers = self._questions() | self._settings() | self._upkeep() | self._motions()

    def _questions(self) -> dict[str, Callable[[str], None]]:
        return {
            "in": self._tell_information,
            "gs": self._tell_status,
            "gp": lambda _: self._tell(f"PO{self._position()}"),
            "gv": lambda _: self._tell(f"GV{self._velocity_percent:02X}"),
            "gj": lambda _: self._tell(f"GJ{_unsigned(self._jog_counts)}"),
            "go": lambda _: self._tell(f"HO{_unsigned(self._home_offset)}"),
            "i1": lambda _: self._tell(self._motors.information("1")),
            "i2": lambda _: self._tell(self._motors.information("2")),
        }

    def _settings(self) -> dict[str, Callable[[str], None]]:
        periods = {letters: partial(self._set_period, letters) for letters in ("f1", "b1", "f2", "b2")}
        return periods | {
            "sv": self._set_velocity,
            "sj": self._set_jog,
            "so": self._set_home_offset,
            "us": lambda _: self._tell(f"GS{_OK:02X}"),
            "sk": lambda _: self._tell(f"GS{_OK:02X}"),
            "ca": self._change_address,
            "ga": self._join_group,
            "is": self._isolate,
        }

    def _upkeep(self) -> dict[str, Callable[[str], None]]:
        return {
            "s1": partial(self._search, "1"),
            "s2": partial(self._search, "2"),
            "c1": partial(self._draw_curve, "1"),
            "c2": partial(self._draw_curve, "2"),
            "om": lambda _: self._work(_OPTIMIZE_S, self._say_done, stoppable=True),
            "cm": lambda _: self._work(_CLEAN_S, self._say_done, stoppable=True),
        }

    def _motions(self) -> dict[str, Callable[[str], None]]:
        return {
            "st": self._stop,
            "ho": self._home,
            "ma": self._move_absolute,
            "mr": lambda digits: self._move_by(_signed(digits)),
            "fw": lambda _: self._jog(forward=True),
            "bw": lambda _: self._jog(forward=False),
        }

    @property
    def understood(self) -> frozenset[str]:
        """The letters of all commands that it knows."""
        return frozenset(self._answers)

    def _live_until(self, time_s: float) -> None:
        if self._receiver.timed_out(time_s):
            self._error = _TIMEOUT
        super()._live_until(time_s)

    def _hear(self, data: bytes) -> None:
        for address, letters, digits in self._receiver.receive(self._now_s, data):
            self._obey(address, letters, digits)

    def _obey(self, address: str, letters: str, digits: str) -> None:
        in_group = address == self._group and letters in _MOVES  # it answers to the group's address for one motion
        if self._now_s < self._isolated_until_s or not (address == self._address or in_group):
            return
        self.heard += 1
        if set(digits) - set(string.digits + "ABCDEF"):
            self._refuse(_OUT_OF_RANGE)
        elif letters not in self._answers:
            self._refuse(_UNSUPPORTED)
        else:
            self._answers[letters](digits)
        if letters in _MOVES:
            self._group = ""

    def _tell(self, text: str) -> None:
        self._say(f"{self._address}{text}\r\n".encode("ascii"))

    def _refuse(self, error: int) -> None:
        self._error = error
        self._tell(f"GS{error:02X}")

    def _is_busy(self) -> bool:
        return self._appointment is not None or self._drive.ring.is_moving(self._now_s)

    def _tell_information(self, _digits: str) -> None:
        options = self._options
        head = f"{options.model:02X}{options.serial_number:08d}{_YEAR}{_FIRMWARE}{_HARDWARE}"
        self._tell(f"IN{head}{360:04X}{options.pulses:08X}")

    def _tell_status(self, _digits: str) -> None:
        """Report "busy" while it is working, else the last error, which this clears."""
        if self._is_busy():
            self._tell(f"GS{_BUSY:02X}")
            return
        self._tell(f"GS{self._error:02X}")
        self._error = _OK

    def _set_velocity(self, digits: str) -> None:
        percent = int(digits, 16)
        if not 1 <= percent <= _FULL_SPEED_PERCENT:
            self._refuse(_OUT_OF_RANGE)
            return
        self._velocity_percent = percent
        self._say_done()

    def _set_jog(self, digits: str) -> None:
        if self._allows(abs(_signed(digits)) <= self._options.pulses):
            self._jog_counts = _signed(digits)

    def _set_home_offset(self, digits: str) -> None:
        if self._allows(0 <= _signed(digits) < self._options.pulses):
            self._home_offset = _signed(digits)

    def _set_period(self, letters: str, digits: str) -> None:
        self._allows(self._motors.set_period(letters, int(digits, 16)))

    def _allows(self, allowed: bool) -> bool:
        if allowed:
            self._say_done()
        else:
            self._refuse(_OUT_OF_RANGE)
        return allowed

    def _say_done(self) -> None:
        self._tell(f"GS{_OK:02X}")

    def _change_address(self, digits: str) -> None:
        self._address = digits
        self._say_done()

    def _join_group(self, digits: str) -> None:
        self._group = digits
        self._say_done()

    def _isolate(self, digits: str) -> None:
        """Do not communicate for some minutes; the status reports it once afterwards."""
        self._say_done()
        if minutes := int(digits, 16):
            self._isolated_until_s = self._now_s + 60.0 * minutes
            self._error = _OUT_OF_ISOLATION

    def _search(self, motor: str, _digits: str) -> None:
        def found() -> None:
            self._motors.search(motor)
            self._say_done()

        self._work(_SEARCH_S, found)

    def _draw_curve(self, motor: str, _digits: str) -> None:
        self._work(_CURVE_S, lambda: self._tell(self._motors.curve(motor)))

    def _work(self, duration_s: float, end: Callable[[], None], *, stoppable: bool = False) -> None:
        if self._begins():
            self._stoppable = stoppable
            self._appointment = (self._now_s + duration_s, end)

    def _stop(self, digits: str) -> None:
        """End a continuous motion; a move to a target continues."""
        if self._stoppable:
            self._stoppable = False
            self._appointment = None
            self._drive.ring.halt(self._now_s)
            self._rest()
        self._tell_status(digits)

    def _home(self, digits: str) -> None:
        if self._begins():
            end_s = self._drive.home(
                self._now_s,
                clockwise=digits == "0",
                speed_deg_per_s=self._speed(),
                offset_counts=self._home_offset - self._born_offset,
            )
            self._appointment = (end_s, self._rest if self._options.unhomed else self._arrive)

    def _move_absolute(self, digits: str) -> None:
        counts = _signed(digits)
        if abs(counts) > self._options.pulses:
            self._refuse(_OUT_OF_RANGE)
        else:
            self._move(counts)

    def _move_by(self, counts: int) -> None:
        self._move(self._drive.ring.counts(self._now_s) + counts)

    def _jog(self, *, forward: bool) -> None:
        """Jog; a jog of 0 is continuous and answered at once."""
        if self._jog_counts:
            self._move_by(self._jog_counts if forward else -self._jog_counts)
        elif self._begins():
            self._say_done()
            self._drive.turn_on(self._now_s, forward=forward, speed_deg_per_s=self._speed())
            self._stoppable = True

    def _move(self, counts: int) -> None:
        if self._begins():
            self._turn(0 if self._now_s - self._rested_s < self._options.gap_s else counts)

    def _begins(self) -> bool:
        """Return whether a motion can begin; otherwise report "busy"."""
        busy = self._is_busy()
        if busy or self._options.busy:
            self._tell(f"GS{_BUSY:02X}")
        self._stoppable = busy and self._stoppable
        return not busy

    def _turn(self, counts: int) -> None:
        end_s, outcome = self._drive.move(self._now_s, counts, speed_deg_per_s=self._speed())
        keep: dict[Outcome, Callable[[], None]] = {
            "arrives": self._arrive,
            "stalls": self._give_up,
            "is turned by hand": self._press_button,
            "fails": self._fail,
        }
        self._appointment = (end_s + (_STALL_S if outcome == "stalls" else 0.0), keep[outcome])

    def _rest(self) -> None:
        self._rested_s = self._now_s

    def _arrive(self) -> None:
        self._rest()
        self._tell(f"PO{self._position()}")

    def _give_up(self) -> None:
        self._rest()
        self._refuse(_STALLED)

    def _fail(self) -> None:
        self._rest()
        if self._options.fault is not None:
            self._refuse(int(self._options.fault[0]))

    def _press_button(self) -> None:
        self._tell(f"BS{_BUSY:02X}")
        self._appointment = (self._drive.turn_by_hand(self._now_s), self._release_button)

    def _release_button(self) -> None:
        self._tell(f"BO{self._position()}")
        self._arrive()

    def _position(self) -> str:
        return _unsigned(self._drive.ring.counts(self._now_s))

    def _speed(self) -> float:
        return self._options.motor_deg_per_s * self._velocity_percent / _FULL_SPEED_PERCENT


def _signed(digits: str) -> int:
    value = int(digits, 16)
    return value if value < 1 << 31 else value - (1 << 32)


def _unsigned(value: int) -> str:
    return f"{value % (1 << 32):08X}"
