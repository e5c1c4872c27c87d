"""The language of Thorlabs Elliptec (ELLx) rotation stages, without input or output.

Source: Thorlabs, "Elliptec ELLx modules protocol manual", Issue 10 (October 2025). A command is an address
(one hexadecimal digit), two small letters, then a fixed number of capital hexadecimal digits; nothing ends it
and nothing checks it. A reply is the address, two capital letters, digits, carriage return, line feed.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import LimitError, ProtocolError

BAUD = 9600
FIRST_ADDRESS = "0"

RESET_RECEIVER = b"\r"
"""Makes the stage forget a command that it has received in part."""

OK, BUSY, INITIALISING = 0, 9, 7

GARBLED_CODES = frozenset({1, 3, 4})
"""Statuses that a command gets when it was damaged on its way: worth sending it once more."""

STATUS_MEANINGS = {
    0: "no error",
    1: "communication timeout",
    2: "mechanical timeout: the motor stalled",
    3: "command not supported",
    4: "value out of range",
    5: "module isolated",
    6: "module out of isolation",
    7: "initialising",
    8: "thermal error",
    9: "busy",
    10: "sensor error",
    11: "motor error",
    12: "out of range",
    13: "over-current",
}

ROTATION_STAGES = {14: "ELL14", 16: "ELL16", 18: "ELL18", 21: "ELL21"}
_TRAVEL_DEG = 360
_PULSES_RANGE = (1 << 15, 1 << 22)  # 0.011 to 0.00009 degrees a count; 65536, 143360 and 262144 are known

_LONGEST_UNREAD = 1024  # bytes; the longest reply has 35


@dataclass(frozen=True, kw_only=True)
class Information:
    """Answer of a stage on what it is (``IN``).

    Attributes
    ----------
    stage_type : int
        The number in the model's name: 14 for an ELL14.
    serial_number, firmware : str
        As printed in the reply.
    year : str
        Year of manufacture.
    travel : int
        Degrees for a rotation stage, millimetres for others.
    pulses : int
        Counts over the whole travel.
    """

    address: str
    stage_type: int
    serial_number: str
    year: str
    firmware: str
    travel: int
    pulses: int


@dataclass(frozen=True, kw_only=True)
class Status:
    """The state of a stage (``GS``), in the numbers of `STATUS_MEANINGS`."""

    address: str
    code: int


@dataclass(frozen=True, kw_only=True)
class Position:
    """The reading of the encoder (``PO``), which may be negative."""

    address: str
    counts: int


@dataclass(frozen=True, kw_only=True)
class ButtonStatus:
    """Unasked: somebody pressed a button of the handset (``BS``)."""

    address: str
    code: int


@dataclass(frozen=True, kw_only=True)
class ButtonPosition:
    """Unasked: where the stage came to rest after a button was pressed (``BO``)."""

    address: str
    counts: int


Event = Information | Status | Position | ButtonStatus | ButtonPosition


def check_address(address: str) -> str:
    """Return the address unchanged if it is one of the sixteen that exist, else raise LimitError."""
    if not re.fullmatch("[0-9A-F]", address):
        raise LimitError(f"address {address!r}: an Elliptec address is one character of 0-9 or A-F")
    return address


def identify(address: str) -> bytes:
    """Return the command that is answered by `Information`."""
    return f"{address}in".encode()


def status(address: str) -> bytes:
    """Return the command that is answered by `Status`; reading it clears an error."""
    return f"{address}gs".encode()


def position(address: str) -> bytes:
    """Return the command that is answered by `Position`."""
    return f"{address}gp".encode()


def stop(address: str) -> bytes:
    """Return the command that ends a continuous motion, answered by `Status`."""
    return f"{address}st".encode()


def home(address: str) -> bytes:
    """Return the command that searches the reference mark clockwise, answered by `Position` in the end."""
    return f"{address}ho0".encode()


def move_absolute(address: str, *, counts: int) -> bytes:
    """Return the command that moves to an encoder reading, answered by `Position` in the end."""
    if not -(1 << 31) <= counts < 1 << 31:
        raise LimitError(f"position {counts} counts: a position has 32 bits with sign")
    return f"{address}ma{counts & 0xFFFFFFFF:08X}".encode()


def move_relative(address: str, *, counts: int) -> bytes:
    """Return the command that moves by a number of counts, answered by `Position` in the end."""
    if not -(1 << 31) <= counts < 1 << 31:
        raise LimitError(f"distance {counts} counts: a distance has 32 bits with sign")
    return f"{address}mr{counts & 0xFFFFFFFF:08X}".encode()


def pulses_per_revolution(information: Information) -> int:
    """Return the encoder counts of a full turn, once the stage is plausibly a rotation stage.

    Raises
    ------
    ProtocolError
        The type is no rotation stage that is known here, its travel is not 360 degrees, or the pulses are
        outside of 2**15 to 2**22 a turn. A wrong number here would make every angle wrong in silence.
    """
    lowest, highest = _PULSES_RANGE
    known = ", ".join(ROTATION_STAGES.values())
    if information.stage_type not in ROTATION_STAGES:
        raise ProtocolError(f"type ELL{information.stage_type} is none of the rotation stages {known}")
    if information.travel != _TRAVEL_DEG:
        raise ProtocolError(f"travel {information.travel} is not the {_TRAVEL_DEG} degrees of a rotation stage")
    if not lowest <= information.pulses <= highest:
        raise ProtocolError(f"{information.pulses} pulses a turn are not plausible ({lowest} to {highest})")
    return information.pulses


def counts_from_angle(angle_deg: float, *, pulses: int) -> int:
    """Return the encoder reading nearest to an angle, in [0, pulses).

    Parameters
    ----------
    angle_deg : float
        Mechanical angle [deg], any finite number; taken modulo 360.
    pulses : int
        Counts of a full turn.

    Raises
    ------
    LimitError
        The angle is not finite.
    """
    if not math.isfinite(angle_deg):
        raise LimitError(f"angle {angle_deg} deg: must be a finite number")
    return round(angle_deg % 360.0 * pulses / 360.0) % pulses


def angle_from_counts(counts: int, *, pulses: int) -> float:
    """Return the angle [deg] of an encoder reading, in [0, 360); readings may be negative or above a turn."""
    return (counts % pulses) * 360.0 / pulses


class ReplyParser:
    """Bytes in, in pieces of any size; whole replies out.

    `next_event` and `feed` raise ProtocolError and nothing else; the damaged reply is then forgotten, and the
    next call goes on behind it.
    """

    def __init__(self) -> None:
        self._unread = b""
        self._skipping = False

    def feed(self, data: bytes) -> None:
        """Take bytes in. Raises ProtocolError, and forgets them, when too many are unread."""
        self._unread += data
        if len(self._unread) > _LONGEST_UNREAD:
            start = self._unread[:16]
            self._skipping = not self._unread.endswith(b"\n")
            self._unread = b""
            raise ProtocolError(f"more than {_LONGEST_UNREAD} bytes that make no reply, beginning {start!r}")

    def next_event(self) -> Event | None:
        """Return the next reply that has come in whole, or None when more bytes are needed."""
        while b"\n" in self._unread:
            line, _, self._unread = self._unread.partition(b"\n")
            if not self._skipping:
                return _decode(line + b"\n")
            self._skipping = False
        return None

    def reset(self) -> None:
        """Forget what has come in."""
        self._unread = b""
        self._skipping = False


_FRAME = re.compile(rb"([0-9A-F])([A-Z]{2})([0-9A-F]*)\r\n")


def _decode(line: bytes) -> Event:
    frame = _FRAME.fullmatch(line)
    if frame is None:
        raise ProtocolError(f"{line!r} is no reply")
    address, letters, digits = (part.decode("ascii") for part in frame.groups())
    if letters not in _REPLIES:
        raise ProtocolError(f"{line!r}: {letters} answers nothing that is asked here")
    length, decode = _REPLIES[letters]
    if len(digits) != length:
        raise ProtocolError(f"{line!r}: {letters} has {length} digits, not {len(digits)}")
    return decode(address, digits)


def _signed(digits: str) -> int:
    value = int(digits, 16)
    return value - (1 << 32) if value >= 1 << 31 else value


def _information(address: str, digits: str) -> Information:
    return Information(
        address=address,
        stage_type=int(digits[0:2], 16),
        serial_number=digits[2:10],
        year=digits[10:14],
        firmware=digits[14:16],  # digits 16 and 17 are the hardware's release
        travel=int(digits[18:22], 16),
        pulses=int(digits[22:30], 16),
    )


_REPLIES: dict[str, tuple[int, Callable[[str, str], Event]]] = {
    "IN": (30, _information),
    "GS": (2, lambda address, digits: Status(address=address, code=int(digits, 16))),
    "PO": (8, lambda address, digits: Position(address=address, counts=_signed(digits))),
    "BS": (2, lambda address, digits: ButtonStatus(address=address, code=int(digits, 16))),
    "BO": (8, lambda address, digits: ButtonPosition(address=address, counts=_signed(digits))),
}
