"""Thorlabs rotation stages with an APT controller: K10CR1, K10CR2, and a PRM1-Z8 on a KDC101 or TDC001.

Language: a message is 6 bytes, little-endian: its number (16 bits), then either two parameters, or the length of the
data that follow (16 bits, and bit 7 of the destination is set), destination, source. There is no checksum: bytes that
are not a known message from the unit to the host are skipped.

Line: without checksums and message numbers, an answer can only be assigned by order. The link notes if a question is
still unanswered, and then waits for silence before the next. The status is read each time it is needed.

Source: Thorlabs, "APT Host-Controller Communications Protocol", issue 25, with its section on scaling; parameters of
the K10CR1 as its maker's program sets them.
"""

import struct
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import DeviceIdentity, StagePosition, StageStatus, Way
from drivers.serial_port import BytePort, SerialPort
from drivers.stages.serial_stage import (
    Answer,
    Line,
    SerialStage,
    StageProbe,
    events_after,
    opened,
    target_within_deg,
    two_agree,
)

BAUD = 115200
PRM1_STAGE_ID = 6
_CHANNEL = 1  # the only one
_T_S = 2048.0 / 6e6  # sampling interval of a K-Cube DC servo


@dataclass(frozen=True, kw_only=True)
class AptModel:
    """A controller with its stage."""

    name: str  #: Name of the two together.
    is_stepper: bool  #: True for the messages of stepper motors, else those of DC servo motors.
    counts_per_deg: float  #: Counts per degree.
    speed_deg_per_s: float  #: Speed of moves and homing.
    #: Data of the messages that set speed and homing at every start, because some controllers forget them at power-off.
    velocity: bytes
    home: bytes


def velocity_parameters(*, acceleration: int, highest: int) -> bytes:
    """Return the data that set the speed of moves, in the controller's units."""
    return struct.pack("<Hiii", _CHANNEL, 0, acceleration, highest)


def home_parameters(*, velocity: int, offset_counts: int) -> bytes:
    """Return the data that set homing; direction 2 and switch 1 are "reverse"."""
    return struct.pack("<HHHii", _CHANNEL, 2, 1, velocity, offset_counts)


def _k10cr(name: str) -> AptModel:
    return AptModel(
        name=name,
        is_stepper=True,
        counts_per_deg=409600.0 / 3.0,
        speed_deg_per_s=10.0,
        velocity=velocity_parameters(acceleration=15020, highest=73300775),
        home=home_parameters(velocity=73300775, offset_counts=546133),
    )


def _prm1(controller: str) -> AptModel:
    counts_per_deg, speed_deg_per_s, acceleration_deg_per_s2 = 1919.6418578623391, 10.0, 10.0
    velocity = round(speed_deg_per_s * counts_per_deg * _T_S * 65536.0)
    acceleration = round(acceleration_deg_per_s2 * counts_per_deg * _T_S**2 * 65536.0)
    return AptModel(
        name=f"{controller} with PRM1-Z8",
        is_stepper=False,
        counts_per_deg=counts_per_deg,
        speed_deg_per_s=speed_deg_per_s,
        velocity=velocity_parameters(acceleration=acceleration, highest=velocity),
        home=home_parameters(velocity=velocity, offset_counts=0),
    )


_BUILT_IN = {"K10CR1": _k10cr("K10CR1"), "K10CR2": _k10cr("K10CR2")}
_DC_CONTROLLERS = ("KDC101", "TDC001")


def find_model(controller: str, *, stage_id: int, actuator: str | None) -> AptModel:
    """Return the model of a controller with its stage."""
    if controller in _BUILT_IN:
        return _BUILT_IN[controller]
    if controller in _DC_CONTROLLERS and (stage_id == PRM1_STAGE_ID or actuator == "PRM1-Z8"):
        return _prm1(controller)
    known = ", ".join([*_BUILT_IN, *(f"{name} with PRM1-Z8" for name in _DC_CONTROLLERS)])
    raise ProtocolError(
        f"controller {controller!r} with a stage of number {stage_id} is not one of {known}. If a PRM1-Z8 is plugged "
        'in and the controller does not say so: actuator = "PRM1-Z8"'
    )


_HOST, _UNIT, _LONG = 0x01, 0x50, 0x80
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
    """A controller's description of itself; `stage_id` is 0 if the stage is built in."""

    serial_number: int
    model: str
    firmware: str
    stage_id: int

    @property
    def identity(self) -> DeviceIdentity:
        """The identity that every frame records."""
        return DeviceIdentity(model=self.model, serial_number=str(self.serial_number), firmware=self.firmware)


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
        """The bits that report a fault."""
        return self.bits & _FAULT_BITS


def fault_in_words(bits: int) -> str:
    """Return what fault bits mean."""
    return ", ".join(meaning for bit, meaning in FAULT_MEANINGS.items() if bits & bit) or "not in the manual"


def _short(number: int, first: int = 0, second: int = 0) -> bytes:
    return _HEADER.pack(number, first, second, _UNIT, _HOST)


def _long(number: int, data: bytes) -> bytes:
    return struct.pack("<HHBB", number, len(data), _UNIT | _LONG, _HOST) + data


# Messages that the host sends. Questions are answered by the message of the next number.
NO_FLASH_PROGRAMMING = _short(0x0018)  # the first message of a host
STOP_UPDATES = _short(0x0012)  # ends status messages without a question
IDENTIFY = _short(0x0005)  # see `Information`
ENABLE = _short(0x0210, _CHANNEL, 1)  # switches the motor on
ASK_ENABLED = _short(0x0211, _CHANNEL)  # see `is_enabled`
ASK_STATUS_OF_STEPPER, ASK_STATUS_OF_SERVO = _short(0x0480, _CHANNEL), _short(0x0490, _CHANNEL)  # see `Status`
HOME = _short(0x0443, _CHANNEL)  # searches for the reference mark
STOP = _short(0x0465, _CHANNEL, 2)  # ends any motion, slowing down
ASK_VELOCITY, ASK_HOME = _short(0x0414, _CHANNEL), _short(0x0441, _CHANNEL)


def move_absolute(counts: int) -> bytes:
    """Return the message that moves to a position."""
    return _long(0x0453, struct.pack("<Hi", _CHANNEL, counts))


def set_velocity(parameters: bytes) -> bytes:
    """Return the message that sets the velocity of moves."""
    return _long(0x0413, parameters)


def set_home(parameters: bytes) -> bytes:
    """Return the message that sets homing."""
    return _long(0x0440, parameters)


class MessageParser:
    """Bytes in, in pieces of any size; whole messages out.

    `next_event` and `feed` raise ProtocolError and nothing else. Bytes that cannot begin a message are skipped. A
    truncated message absorbs the following bytes; `reset` after a silence repairs this.
    """

    def __init__(self) -> None:
        self._unread = b""

    def feed(self, data: bytes) -> None:
        """Add bytes. Raises ProtocolError and discards them if too many are unread."""
        self._unread += data
        if len(self._unread) > _LONGEST_UNREAD:
            start, self._unread = self._unread[:16], b""
            raise ProtocolError(f"more than {_LONGEST_UNREAD} unread bytes, beginning {start.hex(' ')}")

    def next_event(self) -> bytes | None:
        """Return the next complete message, or None if more bytes are needed."""
        self._pass_over_rubbish()
        if len(self._unread) < _HEADER.size:
            return None
        end = _HEADER.size + _DATA_BYTES[number_of(self._unread)]
        if len(self._unread) < end:
            return None
        message, self._unread = self._unread[:end], self._unread[end:]
        if len(message) == _HEADER.size + _CHANNEL_FIRST and data_of(message)[:2] != _CHANNEL.to_bytes(2, "little"):
            raise ProtocolError(f"{message.hex(' ')} is not of channel {_CHANNEL}, the only one")
        return message

    @property
    def unread(self) -> int:
        """Number of received bytes of an incomplete message."""
        return len(self._unread)

    def reset(self) -> None:
        """Discard received bytes."""
        self._unread = b""

    def _pass_over_rubbish(self) -> None:
        skipped = 0
        while not _may_begin(self._unread[skipped : skipped + _HEADER.size]):
            skipped += 1
        if skipped:
            rubbish, self._unread = self._unread[:skipped], self._unread[skipped:]
            raise ProtocolError(f"{rubbish[:16].hex(' ')} begins no message")


def _may_begin(start: bytes) -> bool:
    """Return whether bytes, at most a header, can begin a message."""
    return any(start == header[: len(start)] for header in _headers(start))


def _headers(start: bytes) -> list[bytes]:
    """Return the headers that bytes may begin; parameters of short messages are arbitrary."""
    parameters = start[2:4].ljust(2, b"\x00")
    return [
        struct.pack("<HHBB", number, length, _HOST | _LONG, _UNIT)
        if length
        else struct.pack("<H2sBB", number, parameters, _HOST, _UNIT)
        for number, length in _DATA_BYTES.items()
    ]


def number_of(message: bytes) -> int:
    """Return the number of a message; an answer has that of its question plus one."""
    return int.from_bytes(message[:2], "little")


def data_of(message: bytes) -> bytes:
    """Return the data of a message."""
    return message[_HEADER.size :]


def information_of(message: bytes) -> Information:
    """Return a controller's description of itself."""
    serial_number, model, minor, interim, major = struct.unpack_from("<I8s2x3B", message, _HEADER.size)
    (stage_id,) = struct.unpack_from("<H", message, _HEADER.size + 76)
    name = model.partition(b"\x00")[0]
    if not (name.isascii() and name.decode("latin-1").isprintable()):
        raise ProtocolError(f"{name!r} is not the name of a controller")
    return Information(
        serial_number=serial_number,
        model=name.decode("ascii").strip(),
        firmware=f"{major}.{interim}.{minor}",
        stage_id=stage_id,
    )


def status_of(message: bytes) -> Status:
    """Return position and status bits, which are at the same places for steppers and servos."""
    _, counts, _, bits = struct.unpack("<HiiI", data_of(message))
    return Status(counts=counts, bits=bits)


def is_enabled(message: bytes) -> bool:
    """Return whether the motor is switched on."""
    return message[3] == 1


_CHANNEL_FIRST = 14  # bytes of data, which begin with the channel
_FAULT, _FAULT_WITH_TEXT = 0x0080, 0x0081
# Number of a message from the unit -> length of its data.
_DATA_BYTES = {
    0x0006: 84,  # identity
    _FAULT: 0,
    _FAULT_WITH_TEXT: 68,
    0x0212: 0,  # state of the motor
    0x0415: _CHANNEL_FIRST,  # velocity parameters
    0x0442: _CHANNEL_FIRST,  # home parameters
    0x0444: 0,  # homed; some stages never send it
    # The end of a motion, sent unasked. Its position may be that of the start, or -1, and is not used.
    0x0464: _CHANNEL_FIRST,
    0x0466: _CHANNEL_FIRST,
    0x0481: _CHANNEL_FIRST,  # status of a stepper, of a servo
    0x0491: _CHANNEL_FIRST,
}


_PROBE_ANSWER_S = 0.3
_TRIES_ON_THE_LINE = 6
_REPLY_TIMEOUT_S = 0.5  # the longest message takes 8 ms on the line, a USB adapter adds 16 ms
_TAIL_S = 0.002  # twenty bytes' worth
_QUIET_S = 0.05
_QUIET_LIMIT_S = 1.0

AnswerT = TypeVar("AnswerT")


class AptLink(Line):
    """The line to one controller, open at 115200 bits/s; notes list repeated questions and damaged answers."""

    def __init__(self, port: BytePort, *, now_s: Callable[[], float], sleep: Callable[[float], None]) -> None:
        self._parser: MessageParser
        super().__init__(port, MessageParser(), name=f"APT stage on {port.name}", now_s=now_s, sleep=sleep)
        self._in_step = False

    def tell(self, message: bytes) -> None:
        """Send a message that nothing answers."""
        self._port.write(message)

    def ask(self, question: bytes, read: Callable[[bytes], AnswerT]) -> AnswerT:
        """Return the answer to a question, asking up to six times."""
        return self.repeated(lambda: self._exchange(question, read), tries=_TRIES_ON_THE_LINE)

    def ask_until_two_agree(self, question: bytes, read: Callable[[bytes], AnswerT]) -> AnswerT:
        """Return the answer to a question about a constant, once two in a row agree."""
        return two_agree(
            lambda: self.ask(question, read),
            name=self.name,
            tries=_TRIES_ON_THE_LINE,
            differ=lambda before, latest: f"its answers to {question.hex(' ')} differ: {before}, {latest}",
        )

    def _exchange(self, question: bytes, read: Callable[[bytes], AnswerT]) -> AnswerT:
        self.drain(quiet_s=0.0 if self._in_step else _QUIET_S, limit_s=_QUIET_LIMIT_S)
        self._in_step = False
        self._port.write(question)
        event = self._await(question, read, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)
        self._require_sound_tail(question)
        self._in_step = True
        return event

    def _require_sound_tail(self, question: bytes) -> None:
        """Check that only whole messages follow an answer; otherwise a byte was lost or doubled within it."""
        try:
            self._parser.feed(self._port.read_some(timeout_s=_TAIL_S))
            while self._parser.next_event() is not None:
                pass
        except ProtocolError as error:
            raise ProtocolError(f"{self.name}: behind the answer to {question.hex(' ')}: {error}") from error
        if self._parser.unread:
            raise ProtocolError(f"{self.name}: {self._parser.unread} bytes too many behind {question.hex(' ')}")

    def _await(self, question: bytes, read: Callable[[bytes], AnswerT], *, deadline_s: float) -> AnswerT:
        damaged: ProtocolError | None = None
        while True:
            try:
                message = self._parser.next_event()
                if message is not None and number_of(message) == number_of(question) + 1:
                    return read(message)
            except ProtocolError as error:
                damaged = error  # the requested answer may still follow
                continue
            if message is not None and number_of(message) in (_FAULT, _FAULT_WITH_TEXT):
                raise self._trouble(message)
            if message is None and not self.take_in(deadline_s):
                raise self.unanswered(question.hex(" "), damaged, check="and the cable")

    def _trouble(self, message: bytes) -> DeviceFaultError:
        if number_of(message) == _FAULT:
            code, text = message[2], b""
        else:
            _, code, text = struct.unpack_from("<HH64s", message, _HEADER.size)
        meaning = text.partition(b"\x00")[0].decode("latin-1") or "not told"
        return DeviceFaultError(
            f"{self.name}: it reports error {code} ({meaning}). Switch it off and on, then home it",
            code=code,
            meaning=meaning,
        )


def ask_apt(port: BytePort, *, now_s: Callable[[], float] = time.monotonic) -> list[Answer]:
    """Return the APT controller on a line at 115200 bits/s."""
    question, answers = IDENTIFY, []
    for message in events_after(port, question, MessageParser(), wait_s=_PROBE_ANSWER_S, enough=1, now_s=now_s):
        if number_of(message) == number_of(question) + 1:
            with suppress(ProtocolError):
                answers.append(Answer(address=None, identity=information_of(message).identity))
    return answers


# For `rigctl devices`.
PROBE = StageProbe(baud=BAUD, usb_ids=((0x0403, 0xFAF0),), ask=ask_apt)

_TRIES = 3
_POLL_S = 0.1
_START_S = 2.0
_SLOWER_THAN_SET = 2.0  # acceleration, and a weak motor
_HOME_S = 90.0  # one and a half turns at half the speed, and the start
_BEGIN_S = 1.0  # a motion that has not begun by then was not understood
_AFTER_ENABLE_S = 1.0  # a TDC001 locks up if it is homed immediately
_HIGHEST_COUNTS = (1 << 31) - 1


class AptStage(SerialStage):
    """The stage behind a link. `open_apt` makes one.

    The controller knows if it was homed since power-up (status bit 0x400) and is asked before each move. Motions are
    followed by the status, because the messages HOMED and MOVE_COMPLETED may be missing or have wrong positions. The
    readback of a K10CR is the command of its motor: it has no encoder.
    """

    def __init__(self, link: AptLink, identity: DeviceIdentity, model: AptModel, *, tolerance_deg: float) -> None:
        super().__init__(link, tolerance_deg=tolerance_deg, count_deg=1.0 / model.counts_per_deg)
        self._link = link
        self._identity = identity
        self._model = model

    def identify(self) -> DeviceIdentity:
        """Return model, serial number and firmware, as read when the connection was made."""
        return self._identity

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback."""
        for _ in range(_TRIES):
            self._link.tell(HOME)
            if self._homing_begins() and self._await_rest(deadline_s=self._link.now_s() + _HOME_S).homed:
                return self.position()
        raise DeviceTimeoutError(
            f"{self._link.name}: homing was commanded {_TRIES} times and not confirmed (status bit 0x400). Switch it "
            "off and on, and check its home parameters in the maker's program"
        )

    def position(self) -> StagePosition:
        """Return the position once two in a row agree, because messages have no checksum."""
        return self._agreed_position(self._read_position)

    def status(self) -> StageStatus:
        """Return the state of the stage; the code is its status bits."""
        status = self._ask_status()
        meaning = fault_in_words(status.faults) if status.faults else "no fault"
        return StageStatus(moving=status.moving, homed=status.homed, code=status.bits, meaning=meaning)

    def stop(self) -> None:
        """Stop any motion."""
        self._link.tell(STOP)
        self._await_rest(deadline_s=self._link.now_s() + _START_S)

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        self._require_homed()
        model = self._model
        highest_deg = _HIGHEST_COUNTS / model.counts_per_deg
        from_deg = self.position().counts / model.counts_per_deg
        target_deg = target_within_deg(
            from_deg,
            angle_deg,
            way=way,
            near_deg=self._tolerance_deg,
            lowest_deg=-highest_deg,
            highest_deg=highest_deg,
        )
        way_s = abs(target_deg - from_deg) / model.speed_deg_per_s
        self._link.tell(move_absolute(round(target_deg * model.counts_per_deg)))
        self._await_rest(deadline_s=self._link.now_s() + _START_S + _SLOWER_THAN_SET * way_s)
        return self.position()

    def _homing_begins(self) -> bool:
        """Return whether the stage is homing, or no longer homed; before the command both were false or true."""
        deadline_s = self._link.now_s() + _BEGIN_S
        while self._link.now_s() < deadline_s:
            status = self._ask_status()
            if status.bits & HOMING or not status.homed:
                return True
            self._link.sleep(_POLL_S)
        return False

    def _await_rest(self, *, deadline_s: float) -> Status:
        """Return the status once the stage reports rest twice in a row, since the first may be older than a command."""
        resting = 0
        while True:
            status = self._ask_status()
            if status.faults and (faults := self._agreed(lambda status: status.faults)):
                meaning = fault_in_words(faults)
                raise DeviceFaultError(
                    f"{self._link.name}: it reports status bits {faults:#x} ({meaning}). Check that nothing blocks it, "
                    "then home it again",
                    code=faults,
                    meaning=meaning,
                )
            resting = 0 if status.moving else resting + 1
            if resting == 2:
                return status
            if self._link.now_s() >= deadline_s:
                self._link.tell(STOP)
                raise DeviceTimeoutError(
                    f"{self._link.name}: still moving after its deadline, so it was stopped. It is worn or blocked, or "
                    "it lost its parameters: open it again"
                )
            self._link.sleep(_POLL_S)

    def _ask_status(self) -> Status:
        question = ASK_STATUS_OF_STEPPER if self._model.is_stepper else ASK_STATUS_OF_SERVO
        return self._link.ask(question, status_of)

    def _read_position(self) -> StagePosition:
        counts = self._ask_status().counts
        return StagePosition(angle_deg=counts / self._model.counts_per_deg % 360.0, counts=counts)

    def _agreed(self, what: Callable[[Status], int]) -> int:
        """Return a part of the status once two in a row agree, because messages have no checksum."""
        return two_agree(
            lambda: what(self._ask_status()),
            name=self._link.name,
            tries=_TRIES,
            differ=lambda *_: "its status differs each time. Check the cable",
        )

    def _require_homed(self) -> None:
        if not self._agreed(lambda status: status.homed):
            raise LimitError(
                f"{self._link.name}: it was not homed since power-up, so its angles are meaningless. Home it first"
            )


def open_apt(
    port: str | BytePort,
    *,
    tolerance_deg: float = 0.02,
    actuator: str | None = None,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> AptStage:
    """Return the stage on a serial port or an open line, once it is identified and has its parameters.

    Raises
    ------
    NotConnectedError
        The port does not exist, may not be opened, or is used by another program.
    """
    with opened(port, baud=BAUD) as line:
        if isinstance(line, SerialPort):
            line.request_to_send()
        link = AptLink(line, now_s=now_s, sleep=sleep)
        link.tell(NO_FLASH_PROGRAMMING)
        link.tell(STOP_UPDATES)
        information = link.ask_until_two_agree(IDENTIFY, information_of)
        try:
            model = find_model(information.model, stage_id=information.stage_id, actuator=actuator)
        except ProtocolError as error:
            raise ProtocolError(f"{link.name}: {error}") from error
        stage = AptStage(link, information.identity, model, tolerance_deg=tolerance_deg)
        _set_up(link, model)
        return stage


def _set_up(link: AptLink, model: AptModel) -> None:
    """Set and read back the parameters that some controllers forget at power-off, and switch the motor on."""
    for _ in range(_TRIES):
        link.tell(set_velocity(model.velocity))
        link.tell(set_home(model.home))
        velocity = link.ask_until_two_agree(ASK_VELOCITY, data_of)
        home = link.ask_until_two_agree(ASK_HOME, data_of)
        if (velocity, home) == (model.velocity, model.home):
            break
    else:
        raise ProtocolError(
            f"{link.name}: it did not accept its parameters: it reads back {velocity.hex(' ')} and {home.hex(' ')}"
        )
    for _ in range(_TRIES):
        if link.ask_until_two_agree(ASK_ENABLED, is_enabled):
            return
        link.tell(ENABLE)
        link.sleep(_AFTER_ENABLE_S)
    raise ProtocolError(f"{link.name}: its motor does not switch on")
