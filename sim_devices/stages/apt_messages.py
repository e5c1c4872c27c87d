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
_JOG_DEG = 5.0
_SINGLE_STEP, _PROFILED, _IGNORED = 2, 2, 1
_FAR = 2**31 - 1

_LIMITS_STOP = (2, 3)  # at once, or slowing down
_VELOCITY, _JOG, _LIMITS, _RELATIVE, _ABSOLUTE, _HOMING = 0x0413, 0x0416, 0x0423, 0x0445, 0x0450, 0x0440

# Message that sets -> (message that asks, message that tells, number of bytes behind the channel).
_TABLE = {
    _VELOCITY: (0x0414, 0x0415, 12),  # lowest, acceleration, highest
    _JOG: (0x0417, 0x0418, 20),
    _LIMITS: (0x0424, 0x0425, 14),
    0x043A: (0x043B, 0x043C, 4),  # general move: backlash
    _HOMING: (0x0441, 0x0442, 12),  # direction, switch, velocity, offset
    _RELATIVE: (0x0446, 0x0447, 4),
    _ABSOLUTE: (0x0451, 0x0452, 4),
    0x04B9: (0, 0, 2),  # what is kept over a power cut: all of this is
}
_STEPPER_TABLE = {0x0426: (0x0427, 0x0428, 4)}  # currents at rest and on the way
_SERVO_TABLE = {
    0x04A0: (0x04A1, 0x04A2, 18),  # control loop
    0x04B0: (0x04B1, 0x04B2, 24),  # wheel
    0x04B3: (0x04B4, 0x04B5, 2),  # lamps
    0x04B6: (0x04B7, 0x04B8, 14),  # buttons
    0x0520: (0x0521, 0x0522, 28),  # panel
    0x0523: (0x0524, 0x0525, 8),  # trigger lines
    0x0526: (0x0527, 0x0528, 32),  # pulses at positions
}
# The same without data: a byte behind the channel's.
_SHORT = {0x0500: (0x0501, 0x0502), 0x0213: (0x0214, 0x0215), 0x0250: (0x0251, 0x0252)}


@dataclass(frozen=True, kw_only=True)
class Jog:
    """What a jog does: so many counts, or None for going on; and how fast [deg/s]."""

    counts: int | None
    speed_deg_per_s: float


class AptParameters:
    """The parameters and what some of them mean; the others are kept and told."""

    def __init__(self, options: AptOptions) -> None:
        model = MODELS[options.model]
        self._scale = model.velocity_per_deg_per_s
        self._table = _TABLE | (_STEPPER_TABLE if model.is_stepper else _SERVO_TABLE)
        speed = 0 if options.forgets else round(_SPEED_DEG_PER_S * self._scale)
        step = round(_JOG_DEG * model.counts_per_deg)
        self._values = {number: bytes(length) for number, (_, _, length) in self._table.items()}
        self._values[_VELOCITY] = struct.pack("<iii", 0, _ACCELERATION, speed)
        self._values[_JOG] = struct.pack("<HiiiiH", _SINGLE_STEP, step, 0, _ACCELERATION, speed, _PROFILED)
        self._values[_LIMITS] = struct.pack("<HHiiH", _IGNORED, _IGNORED, _FAR, -_FAR, _IGNORED)
        self._born_offset = model.home_offset_counts
        self._values[_HOMING] = struct.pack("<HHii", 2, 1, speed, self._born_offset)
        self._bytes = dict.fromkeys(_SHORT, 0)

    @property
    def understood(self) -> frozenset[int]:
        """The numbers of all messages that set or ask for a parameter."""
        sets = {*self._table, *_SHORT}
        asks = {entry[0] for entry in (*self._table.values(), *_SHORT.values()) if entry[0]}
        return frozenset(sets | asks)

    def keep(self, message: "Message") -> bool:
        """Keep what a message sets, if it is one of these and as long as it must be; return whether it is."""
        if message.number in _SHORT:
            self._bytes[message.number] = message.second
        elif message.number in self._table:
            self._set(message.number, message.data)
        return message.number in _SHORT or message.number in self._table

    def answer(self, number: int) -> bytes | None:
        """Return the message that answers a question, or None if it is no question of these."""
        for key, (asks, tells) in _SHORT.items():
            if asks == number:
                return short(tells, _CHANNEL, self._bytes[key])
        for key, (asks, tells, _) in self._table.items():
            if asks == number:
                return long(tells, with_channel(self._values[key]))
        return None

    def speed_deg_per_s(self) -> float:
        """Return the velocity of moves [deg/s]."""
        return float(struct.unpack("<iii", self._values[_VELOCITY])[2]) / self._scale

    def home_speed_deg_per_s(self) -> float:
        """Return the velocity of homing [deg/s]."""
        return float(struct.unpack("<HHii", self._values[_HOMING])[2]) / self._scale

    def home_forward(self) -> bool:
        """Return whether it looks for the mark going forward."""
        return bool(struct.unpack("<HHii", self._values[_HOMING])[0] == 1)

    def home_shift_counts(self) -> int:
        """Return how far from where it was made to be its home now is."""
        return int(struct.unpack("<HHii", self._values[_HOMING])[3]) - self._born_offset

    def distance_counts(self) -> int:
        """Return how far a relative move without data goes."""
        return int.from_bytes(self._values[_RELATIVE], "little", signed=True)

    def target_counts(self) -> int:
        """Return where an absolute move without data goes."""
        return int.from_bytes(self._values[_ABSOLUTE], "little", signed=True)

    def jog(self) -> Jog:
        """Return what a jog does."""
        mode, step, _, _, speed, _ = struct.unpack("<HiiiiH", self._values[_JOG])
        return Jog(counts=step if mode == _SINGLE_STEP else None, speed_deg_per_s=speed / self._scale)

    def limits_counts(self) -> tuple[int, int]:
        """Return the lowest and the highest count that it may go to."""
        _, _, clockwise, counter_clockwise, mode = struct.unpack("<HHiiH", self._values[_LIMITS])
        ends = sorted((clockwise, counter_clockwise))
        return (ends[0], ends[1]) if mode in _LIMITS_STOP else (-_FAR, _FAR)

    def _set(self, number: int, data: bytes) -> None:
        """Keep parameters that are whole; the unused ones at their end may be missing or more."""
        length = self._table[number][2]
        if len(data) >= 2 + length:
            self._values[number] = data[2 : 2 + length]


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
