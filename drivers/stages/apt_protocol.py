"""The language of Thorlabs APT controllers, without input or output.

Source: Thorlabs, "APT Host-Controller Communications Protocol", issue 25. A message is 6 bytes, little-endian: its
number (16 bits), then either two parameters, or the length of the data that follow (16 bits, and bit 7 of the
destination is set), destination, source. There is no checksum: what is not a message from the unit to the host, of a
number and a length that are known here, is passed over.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import LimitError, ProtocolError
from drivers.stages.apt_models import HomeParameters, VelocityParameters

BAUD = 115200

_HOST, _UNIT, _LONG = 0x01, 0x50, 0x80
_CHANNEL = 1
_HEADER = struct.Struct("<HBBBB")
_LONGEST_UNREAD = 1024  # bytes; the longest message has 90

MOVING = 0x10 | 0x20 | 0x40 | 0x80
HOMING, HOMED, ENABLED = 0x200, 0x400, 0x80000000

FAULT_MEANINGS = {
    0x4000: "motion error: the motor does not follow",
    0x8000: "instrument error",
    0x10000: "interlock open",
    0x20000: "too hot",
    0x40000: "supply voltage out of range",
    0x80000: "commutation error",
    0x1000000: "motor current limit reached",
    0x2000000: "encoder fault",
    0x4000000: "over-current",
    0x8000000: "current supply fault",
    0x40000000: "error",
}
_FAULT_BITS = sum(FAULT_MEANINGS)


@dataclass(frozen=True, kw_only=True)
class Information:
    """Answer of a controller on what it is; `stage_id` is 0 where a stage is built in."""

    serial_number: int
    model: str
    firmware: str
    stage_id: int


@dataclass(frozen=True, kw_only=True)
class Status:
    """Position of the stage by its own count, and its status bits."""

    counts: int
    bits: int

    @property
    def moving(self) -> bool:
        """True while it turns."""
        return bool(self.bits & (MOVING | HOMING))

    @property
    def homed(self) -> bool:
        """True once it has found its reference mark since its power-up."""
        return bool(self.bits & HOMED)

    @property
    def faults(self) -> int:
        """The bits that tell of a fault."""
        return self.bits & _FAULT_BITS


@dataclass(frozen=True, kw_only=True)
class ChannelState:
    """State of the motor: switched on or not."""

    enabled: bool


@dataclass(frozen=True, kw_only=True)
class Homed:
    """Unasked: the reference mark was found. Some stages never say so."""


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """Unasked: a motion has ended. Its position may be that of the motion's start, or -1: it is not used."""

    completed: bool


@dataclass(frozen=True, kw_only=True)
class Trouble:
    """Unasked: a fault of the controller; `text` may be empty."""

    code: int
    text: str


Event = Information | Status | ChannelState | VelocityParameters | HomeParameters | Homed | Stopped | Trouble


def fault_in_words(bits: int) -> str:
    """Return what fault bits mean."""
    return ", ".join(meaning for bit, meaning in FAULT_MEANINGS.items() if bits & bit) or "not in the manual"


def _short(number: int, first: int = 0, second: int = 0) -> bytes:
    return _HEADER.pack(number, first, second, _UNIT, _HOST)


def _long(number: int, layout: str, *values: int) -> bytes:
    data = struct.pack(layout, _CHANNEL, *values)
    return struct.pack("<HHBB", number, len(data), _UNIT | _LONG, _HOST) + data


def identify() -> bytes:
    """Return the message that is answered by `Information`."""
    return _short(0x0005)


def stop_updates() -> bytes:
    """Return the message that ends status messages which nobody asked for."""
    return _short(0x0012)


def no_flash_programming() -> bytes:
    """Return the message that a host begins with."""
    return _short(0x0018)


def enable() -> bytes:
    """Return the message that switches the motor on."""
    return _short(0x0210, _CHANNEL, 1)


def channel_state() -> bytes:
    """Return the message that is answered by `ChannelState`."""
    return _short(0x0211, _CHANNEL)


def status(*, is_stepper: bool) -> bytes:
    """Return the message that is answered by `Status`."""
    return _short(0x0480 if is_stepper else 0x0490, _CHANNEL)


def home() -> bytes:
    """Return the message that searches the reference mark."""
    return _short(0x0443, _CHANNEL)


def stop() -> bytes:
    """Return the message that ends any motion, slowing down."""
    return _short(0x0465, _CHANNEL, 2)


def move_absolute(counts: int) -> bytes:
    """Return the message that moves to a position."""
    if not -(1 << 31) <= counts < 1 << 31:
        raise LimitError(f"position {counts} counts: a position has 32 bits with sign")
    return _long(0x0453, "<Hi", counts)


def set_velocity(parameters: VelocityParameters) -> bytes:
    """Return the message that sets what moves run at."""
    return _long(0x0413, "<Hiii", parameters.lowest, parameters.acceleration, parameters.highest)


def velocity() -> bytes:
    """Return the message that is answered by `VelocityParameters`."""
    return _short(0x0414, _CHANNEL)


def set_home(parameters: HomeParameters) -> bytes:
    """Return the message that sets how the reference mark is searched."""
    p = parameters
    return _long(0x0440, "<HHHii", p.direction, p.switch, p.velocity, p.offset_counts)


def home_parameters() -> bytes:
    """Return the message that is answered by `HomeParameters`."""
    return _short(0x0441, _CHANNEL)


class MessageParser:
    """Bytes in, in pieces of any size; whole messages out.

    `next_event` and `feed` raise ProtocolError and nothing else. Bytes that cannot begin a message are passed over up
    to the next that can; a message cut short takes those after it for its own, which `reset` after a silence cures.
    """

    def __init__(self) -> None:
        self._unread = b""

    def feed(self, data: bytes) -> None:
        """Take bytes in. Raises ProtocolError, and forgets them, when too many are unread."""
        self._unread += data
        if len(self._unread) > _LONGEST_UNREAD:
            start, self._unread = self._unread[:16], b""
            raise ProtocolError(f"more than {_LONGEST_UNREAD} bytes that nobody reads, beginning {start.hex(' ')}")

    def next_event(self) -> Event | None:
        """Return the next message that has come in whole, or None when more bytes are needed."""
        self._pass_over_rubbish()
        if len(self._unread) < _HEADER.size:
            return None
        number, _, _, _, _ = _HEADER.unpack_from(self._unread)
        length, decode = _MESSAGES[number]
        end = _HEADER.size + length
        if len(self._unread) < end:
            return None
        message, self._unread = self._unread[:end], self._unread[end:]
        return decode(message)

    @property
    def unread(self) -> int:
        """Number of bytes that have come in and make no whole message yet."""
        return len(self._unread)

    def reset(self) -> None:
        """Forget what has come in."""
        self._unread = b""

    def _pass_over_rubbish(self) -> None:
        skipped = 0
        while not _may_begin(self._unread[skipped : skipped + _HEADER.size]):
            skipped += 1
        if skipped:
            rubbish, self._unread = self._unread[:skipped], self._unread[skipped:]
            raise ProtocolError(f"{rubbish[:16].hex(' ')} begins no message")


def _may_begin(start: bytes) -> bool:
    """Return whether bytes, fewer than a header or as many, are the beginning of a message."""
    return any(start == header[: len(start)] for header in _headers(start))


def _headers(start: bytes) -> list[bytes]:
    """Return the headers that bytes may be the beginning of; parameters of short messages may be anything."""
    parameters = start[2:4].ljust(2, b"\x00")
    return [
        struct.pack("<HHBB", number, length, _HOST | _LONG, _UNIT)
        if length
        else struct.pack("<H2sBB", number, parameters, _HOST, _UNIT)
        for number, (length, _) in _MESSAGES.items()
    ]


def _information(message: bytes) -> Information:
    serial_number, model, minor, interim, major = struct.unpack_from("<I8s2x3B", message, _HEADER.size)
    (stage_id,) = struct.unpack_from("<H", message, _HEADER.size + 76)
    name = model.partition(b"\x00")[0]
    if not (name.isascii() and name.decode("latin-1").isprintable()):
        raise ProtocolError(f"{name!r} is no name of a controller")
    return Information(
        serial_number=serial_number,
        model=name.decode("ascii").strip(),
        firmware=f"{major}.{interim}.{minor}",
        stage_id=stage_id,
    )


def _unpack(layout: str, message: bytes) -> tuple[int, ...]:
    """Return the data of a message behind the channel, which must be the only one that there is."""
    channel, *values = struct.unpack_from(layout, message, _HEADER.size)
    if channel != _CHANNEL:
        raise ProtocolError(f"{message.hex(' ')} is of channel {channel}; there is only {_CHANNEL}")
    return tuple(values)


def _stepper_status(message: bytes) -> Status:
    counts, _, bits = _unpack("<HiiI", message)
    return Status(counts=counts, bits=bits)


def _servo_status(message: bytes) -> Status:
    counts, _, _, bits = _unpack("<HiHHI", message)
    return Status(counts=counts, bits=bits)


def _velocity(message: bytes) -> VelocityParameters:
    lowest, acceleration, highest = _unpack("<Hiii", message)
    return VelocityParameters(lowest=lowest, acceleration=acceleration, highest=highest)


def _home(message: bytes) -> HomeParameters:
    direction, switch, velocity_, offset_counts = _unpack("<HHHii", message)
    return HomeParameters(direction=direction, switch=switch, velocity=velocity_, offset_counts=offset_counts)


def _rich_response(message: bytes) -> Trouble:
    _, code, text = struct.unpack_from("<HH64s", message, _HEADER.size)
    return Trouble(code=code, text=text.partition(b"\x00")[0].decode("latin-1"))


# Number -> (length of its data, how it is read).
_MESSAGES: dict[int, tuple[int, Callable[[bytes], Event]]] = {
    0x0006: (84, _information),
    0x0080: (0, lambda message: Trouble(code=message[2], text="")),
    0x0081: (68, _rich_response),
    0x0212: (0, lambda message: ChannelState(enabled=message[3] == 1)),
    0x0415: (14, _velocity),
    0x0442: (14, _home),
    0x0444: (0, lambda _: Homed()),
    0x0464: (14, lambda _: Stopped(completed=True)),
    0x0466: (14, lambda _: Stopped(completed=False)),
    0x0481: (14, _stepper_status),
    0x0491: (14, _servo_status),
}
