"""Messages and parameters of a simulated APT controller, from a reading of Thorlabs' protocol document (issue 25)."""

import struct
from dataclasses import dataclass

from sim_devices.stages.apt_address import MODELS, AptOptions

_HOST, _UNIT, _LONG = 0x01, 0x50, 0x80
_CHANNEL = 1
_GET_INFO = 0x0006
_STEPPER_TYPE, _DC_TYPE = 16, 44
_FIRMWARE = bytes([2, 1, 3, 0])  # minor, interim, major


def short(number: int, first: int = _CHANNEL, second: int = 0) -> bytes:
    """Return a message without data."""
    return struct.pack("<HBBBB", number, first, second, _HOST, _UNIT)


def long(number: int, data: bytes) -> bytes:
    """Return a message with data."""
    return struct.pack("<HHBB", number, len(data), _HOST | _LONG, _UNIT) + data


def information(options: AptOptions) -> bytes:
    """Return what the controller says of itself."""
    model = MODELS[options.model]
    serial_number = model.serial_number if options.serial_number is None else options.serial_number
    kind = _STEPPER_TYPE if model.is_stepper else _DC_TYPE
    head = struct.pack("<i8sH4s48s", serial_number, options.model.encode(), kind, _FIRMWARE, b"simulated")
    return long(_GET_INFO, head + bytes(10) + struct.pack("<HHHH", model.stage_id, 1, 1, 1))


def stepper_status(counts: int, bits: int) -> bytes:
    """Return the data that tell the status of a stepper motor."""
    return struct.pack("<HiiI", _CHANNEL, counts, 0, bits)


def servo_status(counts: int, bits: int) -> bytes:
    """Return the data that tell the status of a DC servo motor."""
    return struct.pack("<HiHHI", _CHANNEL, counts, 0, 0, bits)


def with_channel(data: bytes) -> bytes:
    """Return parameters with the channel that they belong to."""
    return struct.pack("<H", _CHANNEL) + data


_SPEED_DEG_PER_S = 10.0
_ACCELERATION = 15020

# Message that sets -> (message that asks, message that tells, number of bytes behind the channel).
TABLE = {
    0x0413: (0x0414, 0x0415, 12),  # velocity: lowest, acceleration, highest
    0x0416: (0x0417, 0x0418, 20),  # jog
    0x0423: (0x0424, 0x0425, 14),  # limit switches
    0x043A: (0x043B, 0x043C, 4),  # general move: backlash
    0x0440: (0x0441, 0x0442, 12),  # homing: direction, switch, velocity, offset
}
_VELOCITY, _HOMING = 0x0413, 0x0440


class AptParameters:
    """The parameters and the velocities that they mean."""

    def __init__(self, options: AptOptions) -> None:
        self._scale = MODELS[options.model].velocity_per_deg_per_s
        speed = 0 if options.forgets else round(_SPEED_DEG_PER_S * self._scale)
        self._values = {number: bytes(length) for number, (_, _, length) in TABLE.items()}
        self._values[_VELOCITY] = struct.pack("<iii", 0, _ACCELERATION, speed)
        self._values[_HOMING] = struct.pack("<HHii", 2, 1, speed, 0)

    def set(self, number: int, data: bytes) -> None:
        """Keep what a message with a channel and parameters sets, if it is as long as it must be."""
        if len(data) == 2 + TABLE[number][2]:
            self._values[number] = data[2:]

    def asked_by(self, number: int) -> tuple[int, bytes] | None:
        """Return the message number and the parameters that answer a question, or None if it is no question."""
        for key, (asks, tells, _) in TABLE.items():
            if asks == number:
                return tells, self._values[key]
        return None

    def speed_deg_per_s(self) -> float:
        """Return the velocity of moves [deg/s]."""
        return float(struct.unpack("<iii", self._values[_VELOCITY])[2]) / self._scale

    def home_speed_deg_per_s(self) -> float:
        """Return the velocity of homing [deg/s]."""
        return float(struct.unpack("<HHii", self._values[_HOMING])[2]) / self._scale


_HEADER = struct.Struct("<HBBBB")
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
