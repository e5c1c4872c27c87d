"""Answers of a simulated APT controller with its stage, from a reading of Thorlabs' protocol document (issue 25)."""

import struct
from collections.abc import Callable

from sim_devices.stages import apt_messages as messages
from sim_devices.stages.apt_address import MODELS, AptOptions
from sim_devices.stages.apt_messages import AptParameters, AptReceiver, Message
from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.simulated_stage import Reply

# The document calls the first of each pair "forward"; clients that were written at devices agree that counts fall then.
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


class AptLanguage:
    """The stage's side of the conversation. The time is an argument, and never goes back."""

    def __init__(self, options: AptOptions, drive: Drive) -> None:
        self._options = options
        self._drive = drive
        self._model = MODELS[options.model]
        self._receiver = AptReceiver()
        self._parameters = AptParameters(options)
        self._enabled = self._model.is_stepper  # a DC servo controller waits to be told
        self._error_bits = 0
        self._motion_bits = 0
        self._homed = False
        self._now_s = 0.0
        self.heard = 0
        self._appointment: tuple[float, Callable[[], None]] | None = None
        self._update_s: float | None = 0.0 if options.updates else None
        self._updates_left = _UPDATES_UNACKNOWLEDGED
        self._replies: list[Reply] = []
        self._tells_ends = True
        self._commands: dict[int, Callable[[Message], None]] = self._questions() | self._orders()

    def _questions(self) -> dict[int, Callable[[Message], None]]:
        return {
            0x0005: lambda _: self._say(messages.information(self._options)),
            0x0211: lambda _: self._say(messages.short(0x0212, 1, _ON if self._enabled else _OFF)),
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
        """The numbers of all messages from the host that do something, or are answered."""
        return frozenset(self._commands) | self._parameters.understood

    def receive(self, time_s: float, data: bytes) -> list[Reply]:
        """Return the replies up to a time [s] at which these bytes arrive."""
        self._live_until(time_s)
        for message in self._receiver.receive(time_s, data):
            self._obey(message)
        return self._take_replies()

    def advance(self, time_s: float) -> list[Reply]:
        """Return the replies up to a time [s]."""
        self._live_until(time_s)
        return self._take_replies()

    def next_event_s(self) -> float | None:
        """Return when the stage does something unasked, or None."""
        appointed_s = self._appointment[0] if self._appointment else None
        times = (appointed_s, self._update_s)
        return min((time_s for time_s in times if time_s is not None), default=None)

    def _take_replies(self) -> list[Reply]:
        replies, self._replies = self._replies, []
        return replies

    def _live_until(self, time_s: float) -> None:
        while (event_s := self.next_event_s()) is not None and event_s <= time_s:
            self._now_s = event_s
            if self._appointment and self._appointment[0] <= event_s:
                (_, keep), self._appointment = self._appointment, None
                keep()
            else:
                self._update()
        self._now_s = max(self._now_s, time_s)

    def _obey(self, message: Message) -> None:
        self.heard += 1
        if self._parameters.keep(message):
            return
        if (answer := self._parameters.answer(message.number)) is not None:
            self._say(answer)
        elif message.number in self._commands:
            self._commands[message.number](message)

    def _say(self, message: bytes) -> None:
        silent = self._options.line.silent
        if silent is None or self.heard < silent:
            self._replies.append((self._now_s, message))

    def _tell(self, number: int, data: bytes) -> None:
        self._say(messages.long(number, messages.with_channel(data)))

    def _tell_status(self, number: int) -> None:
        self._say(messages.long(number, self._status()))

    def _status(self) -> bytes:
        pack = messages.stepper_status if self._model.is_stepper else messages.servo_status
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
        if speed > 0.0:  # else it says that it is on its way, for ever
            end_s = self._drive.home(
                self._now_s,
                clockwise=not forward,
                speed_deg_per_s=speed,
                offset_counts=self._parameters.home_shift_counts(),
            )
            self._appointment = (end_s, self._find_home)

    def _find_home(self) -> None:
        self._motion_bits = 0
        self._homed = not self._options.motion.unhomed
        if self._homed and self._tells_ends and not self._options.quiet_home:
            self._say(messages.short(_FOUND_HOME))

    def _move_relative(self, message: Message) -> None:
        distance = _signed_of(message, otherwise=self._parameters.distance_counts())
        self._move(self._counts() + distance, speed_deg_per_s=self._parameters.speed_deg_per_s())

    def _move_absolute(self, message: Message) -> None:
        target = _signed_of(message, otherwise=self._parameters.target_counts())
        self._move(target, speed_deg_per_s=self._parameters.speed_deg_per_s())

    def _jog(self, message: Message) -> None:
        """Go by a step, or on and on, as the parameters say."""
        jog, rising = self._parameters.jog(), message.second != _FIRST_WAY
        bits = _JOG_RISING if rising else _JOG_FALLING
        if jog.counts is None:
            self._go_on(rising=rising, speed_deg_per_s=jog.speed_deg_per_s, bits=bits)
        else:
            counts = self._counts() + (jog.counts if rising else -jog.counts)
            self._move(counts, speed_deg_per_s=jog.speed_deg_per_s, bits=bits)

    def _turn_on(self, message: Message) -> None:
        rising = message.second != _FIRST_WAY
        speed = self._parameters.speed_deg_per_s()
        self._go_on(rising=rising, speed_deg_per_s=speed, bits=_RISING if rising else _FALLING)

    def _go_on(self, *, rising: bool, speed_deg_per_s: float, bits: int) -> None:
        """Turn until it is stopped, or to a limit where there is one."""
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
        ending = self._drive.move(self._now_s, counts, speed_deg_per_s=speed_deg_per_s)
        keep: dict[Outcome, Callable[[], None]] = {
            "arrives": self._complete,
            "stalls": lambda: self._fail(_MOTION_ERROR),
            "is turned by hand": self._turn_by_hand,
            "fails": lambda: self._fail(int((self._options.motion.fault or (_MOTION_ERROR, 0))[0])),
        }
        lag_s = _BUSY_FOR_NO_REASON_S if self._options.motion.busy else 0.0
        self._appointment = (ending.time_s + lag_s, keep[ending.outcome])

    def _call_here(self, message: Message) -> None:
        """Give the place where it stands another number."""
        if len(message.data) == 6:
            self._drive.ring.call_here(self._now_s, _signed_of(message, otherwise=0))

    def _tell_ends(self, *, told: bool) -> None:
        self._tells_ends = told

    def _complete(self) -> None:
        self._motion_bits = 0
        if self._tells_ends:
            self._say(messages.long(_MOVED, self._status()))

    def _fail(self, bits: int) -> None:
        self._error_bits |= bits
        self._motion_bits = 0

    def _turn_by_hand(self) -> None:
        """End the move; its wheel, or its buttons, then turn the ring as a jog."""
        self._complete()
        self._motion_bits = _JOG_RISING
        self._appointment = (self._drive.turn_by_hand(self._now_s), self._complete)

    def _stop(self) -> None:
        self._drive.ring.halt(self._now_s)
        self._motion_bits = 0
        self._appointment = None
        self._say(messages.long(_STOPPED, self._status()))

    def _start_updates(self) -> None:
        self._update_s = self._now_s
        self._updates_left = _UPDATES_UNACKNOWLEDGED

    def _stop_updates(self) -> None:
        self._update_s = None

    def _acknowledge(self) -> None:
        self._updates_left = _UPDATES_UNACKNOWLEDGED

    def _update(self) -> None:
        """Tell the status unasked, unless the host has been silent for too long."""
        self._updates_left -= 1
        self._update_s = self._now_s + _UPDATE_S
        if self._updates_left >= 0:
            self._tell_status(_STEPPER_STATUS if self._model.is_stepper else _SERVO_STATUS)


def _signed_of(message: Message, *, otherwise: int) -> int:
    """Return the number that a message brings, or another one where it has no data."""
    return int(struct.unpack("<Hi", message.data)[1]) if len(message.data) == 6 else otherwise
