"""A simulated Thorlabs APT controller with its stage: messages, parameters, answers, address ``sim:apt?...``.

Written from Thorlabs' protocol document (issue 25), without the driver's code.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.options import (
    COMMON_KEYS,
    StageOptions,
    fault_key,
    flag,
    one_of,
    whole,
)
from sim_devices.stages.stage import Language


@dataclass(frozen=True, kw_only=True)
class AptModel:
    """A controller with its stage."""

    counts_per_deg: float  #: Counts of a degree.
    velocity_per_deg_per_s: float  #: Controller units of a degree per second.
    is_stepper: bool  #: True for the messages of stepper motors, else those of DC servo motors.
    stage_id: int  #: Reported number of the connected stage; 0 for a built-in one.
    serial_number: int  #: First digits of the serial number of this kind of controller.
    home_offset_counts: int  #: Default distance of home behind the mark.


_K10CR = 409600.0 / 3.0
_PRM1 = 1919.6418578623391
MODELS = {
    "K10CR1": AptModel(
        counts_per_deg=_K10CR,
        velocity_per_deg_per_s=_K10CR * 53.68,
        is_stepper=True,
        stage_id=0,
        serial_number=55000123,
        home_offset_counts=546133,
    ),
    "K10CR2": AptModel(
        counts_per_deg=_K10CR,
        velocity_per_deg_per_s=_K10CR * 53.68,
        is_stepper=True,
        stage_id=0,
        serial_number=55500123,
        home_offset_counts=546133,
    ),
    "KDC101": AptModel(
        counts_per_deg=_PRM1,
        velocity_per_deg_per_s=_PRM1 * 65536.0 * 2048.0 / 6e6,
        is_stepper=False,
        stage_id=6,
        serial_number=27000123,
        home_offset_counts=0,
    ),
}


@dataclass(frozen=True, kw_only=True)
class AptOptions(StageOptions):
    """A stage and its faults. The defaults are a sound K10CR1."""

    motor_deg_per_s: float = 25.0
    landing_deg: float = 0.001
    model: str = "K10CR1"  #: One of `MODELS`; a KDC101 has a PRM1-Z8.
    serial_number: int | None = None  #: None: one of the model's own range.
    #: Velocities are 0 after power-up: it reports motion but stands still.
    forgets: bool = False
    quiet_home: bool = False  #: It homes without sending HOMED.
    updates: bool = False  #: It sends its status ten times a second from power-up.

    @property
    def counts_per_turn(self) -> float:
        """Counts of a turn of the ring."""
        return MODELS[self.model].counts_per_deg * 360.0


def _status_bits(text: str) -> int:
    bits = int(text, 0)
    if not 0 < bits < 1 << 32:
        raise ValueError(text)
    return bits


KEYS = {
    "model": one_of("model", "which controller", {name: name for name in MODELS}),
    "serial": whole("serial_number", "serial number", 0, 2**31 - 1),
    "forgets": flag("forgets", "its velocities are 0 after power-up"),
    "quiethome": flag("quiet_home", "it does not report the end of homing"),
    "updates": flag("updates", "it sends its status unasked from power-up"),
    "fault": fault_key(_status_bits, codes="status bits, such as 0x4000"),
    **COMMON_KEYS,
}


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
    """Return the status data of a stepper motor."""
    return struct.pack("<HiiI", _CHANNEL, counts, 0, bits)


def servo_status(counts: int, bits: int) -> bytes:
    """Return the status data of a DC servo motor."""
    return struct.pack("<HiHHI", _CHANNEL, counts, 0, 0, bits)


def with_channel(data: bytes) -> bytes:
    """Return parameters with their channel."""
    return struct.pack("<H", _CHANNEL) + data


_SPEED_DEG_PER_S = 10.0
_ACCELERATION = 15020
_JOG_DEG = 5.0
_SINGLE_STEP, _PROFILED, _IGNORED = 2, 2, 1
_FAR = 2**31 - 1

_LIMITS_STOP = (2, 3)  # at once, or slowing down
_VELOCITY, _JOG, _LIMITS, _RELATIVE, _ABSOLUTE, _HOME = 0x0413, 0x0416, 0x0423, 0x0445, 0x0450, 0x0440

# Message to set -> (request, answer, number of bytes behind the channel).
_TABLE = {
    _VELOCITY: (0x0414, 0x0415, 12),  # lowest, acceleration, highest
    _JOG: (0x0417, 0x0418, 20),
    _LIMITS: (0x0424, 0x0425, 14),
    0x043A: (0x043B, 0x043C, 4),  # general move: backlash
    _HOME: (0x0441, 0x0442, 12),  # direction, switch, velocity, offset
    _RELATIVE: (0x0446, 0x0447, 4),
    _ABSOLUTE: (0x0451, 0x0452, 4),
    0x04B9: (0, 0, 2),  # stored over a power cut: everything here
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


class AptParameters:
    """The parameters; those without meaning here are only stored and reported."""

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
        self._values[_HOME] = struct.pack("<HHii", 2, 1, speed, self._born_offset)
        self._bytes = dict.fromkeys(_SHORT, 0)

    @property
    def understood(self) -> frozenset[int]:
        """Numbers of all messages that set or request a parameter."""
        sets = {*self._table, *_SHORT}
        asks = {entry[0] for entry in (*self._table.values(), *_SHORT.values()) if entry[0]}
        return frozenset(sets | asks)

    def keep(self, message: "Message") -> bool:
        """Store the parameter of a valid message; return whether it was one."""
        if message.number in _SHORT:
            self._bytes[message.number] = message.second
        elif message.number in self._table:
            self._set(message.number, message.data)
        return message.number in _SHORT or message.number in self._table

    def answer(self, number: int) -> bytes | None:
        """Return the answer to a request, or None for other messages."""
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
        return float(struct.unpack("<HHii", self._values[_HOME])[2]) / self._scale

    def home_forward(self) -> bool:
        """Return whether it searches for the mark forward."""
        return bool(struct.unpack("<HHii", self._values[_HOME])[0] == 1)

    def home_shift_counts(self) -> int:
        """Return the distance of home from its default place."""
        return int(struct.unpack("<HHii", self._values[_HOME])[3]) - self._born_offset

    def distance_counts(self) -> int:
        """Return the distance of a relative move without data."""
        return int.from_bytes(self._values[_RELATIVE], "little", signed=True)

    def target_counts(self) -> int:
        """Return the target of an absolute move without data."""
        return int.from_bytes(self._values[_ABSOLUTE], "little", signed=True)

    def jog(self) -> tuple[int | None, float]:
        """Return counts (None: continuous) and speed [deg/s] of a jog."""
        mode, step, _, _, speed, _ = struct.unpack("<HiiiiH", self._values[_JOG])
        return step if mode == _SINGLE_STEP else None, speed / self._scale

    def limits_counts(self) -> tuple[int, int]:
        """Return the lowest and the highest allowed count."""
        _, _, clockwise, counter_clockwise, mode = struct.unpack("<HHiiH", self._values[_LIMITS])
        ends = sorted((clockwise, counter_clockwise))
        return (ends[0], ends[1]) if mode in _LIMITS_STOP else (-_FAR, _FAR)

    def _set(self, number: int, data: bytes) -> None:
        """Store complete parameters; the number of unused bytes at their end may vary."""
        length = self._table[number][2]
        if len(data) >= 2 + length:
            self._values[number] = data[2 : 2 + length]


_HEADER = struct.Struct("<HBBBB")
_OWN_PLACES = frozenset({0x50, 0x11, 0x21})  # a USB unit, and its address from hosts of racks
_LONGEST_DATA = 255
_SILENCE_S = 0.5  # assumed: silence after which a partial message is discarded


@dataclass(frozen=True, kw_only=True)
class Message:
    """A whole message from the host; one with data has no parameters."""

    number: int
    first: int
    second: int
    data: bytes


class AptReceiver:
    """Collects bytes to messages. Bytes that cannot begin one are skipped."""

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


# The document calls the first of each pair "forward"; by clients tested on devices counts fall then.
_AT_LOWEST, _AT_HIGHEST, _FALLING, _RISING, _JOG_FALLING, _JOG_RISING = 0x4, 0x8, 0x10, 0x20, 0x40, 0x80
_CONNECTED, _HOMING, _HOMED, _SETTLED = 0x100, 0x200, 0x400, 0x2000
_MOTION_ERROR, _ENABLED = 0x4000, 0x80000000
_MOVED, _STOPPED, _FOUND_HOME = 0x0464, 0x0466, 0x0444
_STEPPER_STATUS, _SERVO_STATUS = 0x0481, 0x0491
_ON, _OFF = 1, 2
_FIRST_WAY = 1
_BUSY_FOR_NO_REASON_S = 0.3
_UPDATE_S = 0.1
_UPDATES_UNACKNOWLEDGED = 50
_ENDLESS_COUNTS = 2**31 - 1


class AptLanguage(Language):
    """What an APT controller hears and says."""

    _options: AptOptions

    def __init__(self, options: AptOptions, drive: Drive) -> None:
        super().__init__(options, drive)
        self._model = MODELS[options.model]
        self._receiver = AptReceiver()
        self._parameters = AptParameters(options)
        self._enabled = self._model.is_stepper  # a DC servo controller waits for a command
        self._error_bits = 0
        self._motion_bits = 0
        self._homed = False
        self._update_s: float | None = 0.0 if options.updates else None
        self._updates_left = _UPDATES_UNACKNOWLEDGED
        self._tells_ends = True
        self._commands: dict[int, Callable[[Message], None]] = self._questions() | self._orders()

    def _questions(self) -> dict[int, Callable[[Message], None]]:
        return {
            0x0005: lambda _: self._say(information(self._options)),
            0x0211: lambda _: self._say(short(0x0212, 1, _ON if self._enabled else _OFF)),
            0x040A: lambda _: self._tell(0x040B, struct.pack("<i", self._counts())),
            0x0411: lambda _: self._tell(0x0412, struct.pack("<i", self._counts())),
            0x0429: lambda _: self._tell(0x042A, struct.pack("<I", self._bits())),
            0x042B: lambda _: self._tell(0x042C, struct.pack("<HH", 0, 0)),
            0x0480: lambda _: self._tell_status(_STEPPER_STATUS),
            0x0490: lambda _: self._tell_status(_SERVO_STATUS),
        }

    def _orders(self) -> dict[int, Callable[[Message], None]]:
        return {
            0x0011: lambda _: self._start_updates(),
            0x0012: lambda _: self._stop_updates(),
            0x0210: self._enable,
            0x0409: self._call_here,
            0x0410: self._call_here,
            0x0443: lambda _: self._home(),
            0x0448: self._move_relative,
            0x0453: self._move_absolute,
            0x0457: self._turn_on,
            0x0465: lambda _: self._stop(),
            0x046A: self._jog,
            0x046B: lambda _: self._tell_ends(told=False),
            0x046C: lambda _: self._tell_ends(told=True),
            0x0492: lambda _: self._acknowledge(),
        }

    @property
    def understood(self) -> frozenset[int]:
        """Numbers of all messages from the host with an effect or an answer."""
        return frozenset(self._commands) | self._parameters.understood

    def _hear(self, data: bytes) -> None:
        for message in self._receiver.receive(self._now_s, data):
            self._obey(message)

    def _next_routine_s(self) -> float | None:
        return self._update_s

    def _obey(self, message: Message) -> None:
        self.heard += 1
        if self._parameters.keep(message):
            return
        if (answer := self._parameters.answer(message.number)) is not None:
            self._say(answer)
        elif message.number in self._commands:
            self._commands[message.number](message)

    def _tell(self, number: int, data: bytes) -> None:
        self._say(long(number, with_channel(data)))

    def _tell_status(self, number: int) -> None:
        self._say(long(number, self._status()))

    def _status(self) -> bytes:
        pack = stepper_status if self._model.is_stepper else servo_status
        return pack(self._counts(), self._bits())

    def _counts(self) -> int:
        return self._drive.ring.counts(self._now_s)

    def _bits(self) -> int:
        bits = _CONNECTED | self._motion_bits | self._error_bits
        bits |= _ENABLED if self._enabled else 0
        bits |= _HOMED if self._homed else 0
        return bits if self._motion_bits else bits | _SETTLED

    def _enable(self, message: Message) -> None:
        self._enabled = message.second == _ON

    def _home(self) -> None:
        speed = self._parameters.home_speed_deg_per_s()
        if not self._enabled:
            return
        self._homed = False
        forward = self._parameters.home_forward()
        self._motion_bits = _HOMING | (_RISING if forward else _FALLING)
        self._appointment = None
        if speed > 0.0:  # otherwise it reports motion for ever
            end_s = self._drive.home(
                self._now_s,
                clockwise=not forward,
                speed_deg_per_s=speed,
                offset_counts=self._parameters.home_shift_counts(),
            )
            self._appointment = (end_s, self._find_home)

    def _find_home(self) -> None:
        self._motion_bits = 0
        self._homed = not self._options.unhomed
        if self._homed and self._tells_ends and not self._options.quiet_home:
            self._say(short(_FOUND_HOME))

    def _move_relative(self, message: Message) -> None:
        distance = _signed_of(message, otherwise=self._parameters.distance_counts())
        self._move(self._counts() + distance, speed_deg_per_s=self._parameters.speed_deg_per_s())

    def _move_absolute(self, message: Message) -> None:
        target = _signed_of(message, otherwise=self._parameters.target_counts())
        self._move(target, speed_deg_per_s=self._parameters.speed_deg_per_s())

    def _jog(self, message: Message) -> None:
        """Jog by a step or continuously, by the parameters."""
        (step, speed), rising = self._parameters.jog(), message.second != _FIRST_WAY
        bits = _JOG_RISING if rising else _JOG_FALLING
        if step is None:
            self._go_on(rising=rising, speed_deg_per_s=speed, bits=bits)
        else:
            counts = self._counts() + (step if rising else -step)
            self._move(counts, speed_deg_per_s=speed, bits=bits)

    def _turn_on(self, message: Message) -> None:
        rising = message.second != _FIRST_WAY
        speed = self._parameters.speed_deg_per_s()
        self._go_on(rising=rising, speed_deg_per_s=speed, bits=_RISING if rising else _FALLING)

    def _go_on(self, *, rising: bool, speed_deg_per_s: float, bits: int) -> None:
        """Turn until it is stopped, or to a limit."""
        lowest, highest = self._parameters.limits_counts()
        limit = highest if rising else lowest
        if abs(limit) < _ENDLESS_COUNTS:
            self._move(limit + (1 if rising else -1), speed_deg_per_s=speed_deg_per_s, bits=bits)
        elif self._enabled:
            self._motion_bits, self._appointment = bits, None
            if speed_deg_per_s > 0.0:
                self._drive.turn_on(self._now_s, forward=rising, speed_deg_per_s=speed_deg_per_s)

    def _move(self, counts: int, *, speed_deg_per_s: float, bits: int | None = None) -> None:
        if not self._enabled:
            return
        lowest, highest = self._parameters.limits_counts()
        self._error_bits = _AT_LOWEST * (counts < lowest) | _AT_HIGHEST * (counts > highest)
        counts = min(max(counts, lowest), highest)
        self._motion_bits = bits or (_RISING if counts >= self._counts() else _FALLING)
        self._appointment = None
        if speed_deg_per_s <= 0.0:
            return
        end_s, outcome = self._drive.move(self._now_s, counts, speed_deg_per_s=speed_deg_per_s)
        keep: dict[Outcome, Callable[[], None]] = {
            "arrives": self._complete,
            "stalls": lambda: self._fail(_MOTION_ERROR),
            "is turned by hand": self._turn_by_hand,
            "fails": lambda: self._fail(int((self._options.fault or (_MOTION_ERROR, 0))[0])),
        }
        lag_s = _BUSY_FOR_NO_REASON_S if self._options.busy else 0.0
        self._appointment = (end_s + lag_s, keep[outcome])

    def _call_here(self, message: Message) -> None:
        """Set the count of the present position."""
        if len(message.data) == 6:
            self._drive.ring.call_here(self._now_s, _signed_of(message, otherwise=0))

    def _tell_ends(self, *, told: bool) -> None:
        self._tells_ends = told

    def _complete(self) -> None:
        self._motion_bits = 0
        if self._tells_ends:
            self._say(long(_MOVED, self._status()))

    def _fail(self, bits: int) -> None:
        self._error_bits |= bits
        self._motion_bits = 0

    def _turn_by_hand(self) -> None:
        """End the move and jog, as by its wheel or buttons."""
        self._complete()
        self._motion_bits = _JOG_RISING
        self._appointment = (self._drive.turn_by_hand(self._now_s), self._complete)

    def _stop(self) -> None:
        self._drive.ring.halt(self._now_s)
        self._motion_bits = 0
        self._appointment = None
        self._say(long(_STOPPED, self._status()))

    def _start_updates(self) -> None:
        self._update_s = self._now_s
        self._updates_left = _UPDATES_UNACKNOWLEDGED

    def _stop_updates(self) -> None:
        self._update_s = None

    def _acknowledge(self) -> None:
        self._updates_left = _UPDATES_UNACKNOWLEDGED

    def _do_routine(self) -> None:
        """Send the status unasked, unless the host has been silent too long."""
        if self._update_s is None or self._update_s > self._now_s:
            return
        self._updates_left -= 1
        self._update_s = self._now_s + _UPDATE_S
        if self._updates_left >= 0:
            self._tell_status(_STEPPER_STATUS if self._model.is_stepper else _SERVO_STATUS)


def _signed_of(message: Message, *, otherwise: int) -> int:
    """Return the number in a message, or a default without data."""
    return int(struct.unpack("<Hi", message.data)[1]) if len(message.data) == 6 else otherwise
