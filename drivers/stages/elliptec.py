"""Thorlabs Elliptec (ELLx) rotation stages: ELL14, ELL16, ELL18, ELL21.

Language: a command is an address (one hexadecimal digit), two small letters, then a fixed number of capital hexadecimal
digits; without terminator or checksum. A reply is the address, two capital letters, digits, carriage return, line feed.

Line: without message numbers, an answer can only be assigned by order. The link notes if a command is still unanswered.
It then makes the stage discard partly received commands, waits for silence, and asks for the status until the stage is
no longer busy, before it sends the next command.

Source: Thorlabs, "Elliptec ELLx modules protocol manual", Issue 10 (October 2025).
"""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import AddressError, DeviceFaultError, DeviceTimeoutError, LimitError, ProtocolError
from drivers.interfaces import DeviceIdentity, StagePosition, StageStatus, Way
from drivers.serial_port import BytePort
from drivers.stages.serial_stage import (
    Answer,
    Line,
    SerialStage,
    StageProbe,
    events_after,
    opened,
    route_deg,
    two_agree,
)

BAUD = 9600
FIRST_ADDRESS = "0"

RESET_RECEIVER = b"\r"
"""Makes the stage discard a partly received command."""

OK, BUSY, INITIALISING = 0, 9, 7

GARBLED_CODES = frozenset({1, 3, 4})
"""Statuses after a damaged command, which is sent again."""

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
    """A stage's description of itself (``IN``)."""

    stage_type: int  #: The number in the model's name: 14 for an ELL14.
    serial_number: str  #: As printed in the reply.
    firmware: str
    travel: int  #: Degrees for a rotation stage, millimetres for others.
    pulses: int  #: Counts over the whole travel.

    @property
    def identity(self) -> DeviceIdentity:
        """The identity that every frame records."""
        model = ROTATION_STAGES.get(self.stage_type, f"ELL{self.stage_type}")
        return DeviceIdentity(model=model, serial_number=self.serial_number, firmware=self.firmware)


# Address, letters and digits of a reply. BS and BO come unasked, after a button of the handset was pressed.
Reply = tuple[str, str, str]
# Letters of a reply -> number of digits after them.
_DIGITS = {"IN": 30, "GS": 2, "PO": 8, "BS": 2, "BO": 8}


def check_address(address: str) -> str:
    """Return the address unchanged if it is one of the sixteen, else raise LimitError."""
    if not re.fullmatch("[0-9A-F]", address):
        raise AddressError(f"address {address!r}: an Elliptec address is one character of 0-9 or A-F")
    return address


def command(address: str, letters: str, digits: str = "") -> bytes:
    """Return a command.

    The answer to ``in`` is `IN` (identity), to ``gs`` `GS` (status; reading it clears an error), to ``gp`` `PO`
    (counts), to ``st`` (end a continuous motion) `GS`. ``ho0`` searches for the reference mark clockwise, ``ma`` moves
    to an encoder reading and ``mr`` by a number of counts; `PO` answers these at their end.
    """
    return f"{address}{letters}{digits}".encode()


def move(address: str, letters: str, *, counts: int) -> bytes:
    """Return the command to move to (``ma``) or by (``mr``) a number of counts."""
    return command(address, letters, f"{counts & 0xFFFFFFFF:08X}")


def pulses_per_revolution(information: Information) -> int:
    """Return the encoder counts of a full turn; raise ProtocolError if the stage is not plausibly a rotation stage."""
    lowest, highest = _PULSES_RANGE
    if information.stage_type not in ROTATION_STAGES:
        problem = (
            f"type ELL{information.stage_type} is not one of the rotation stages {', '.join(ROTATION_STAGES.values())}"
        )
    elif information.travel != _TRAVEL_DEG:
        problem = f"travel {information.travel} is not the {_TRAVEL_DEG} degrees of a rotation stage"
    elif not lowest <= information.pulses <= highest:
        problem = f"{information.pulses} pulses per turn are not plausible ({lowest} to {highest})"
    else:
        return information.pulses
    raise ProtocolError(f"{problem}. It is not used, because its angles would be unreliable")


def counts_from_angle(angle_deg: float, *, pulses: int) -> int:
    """Return the encoder reading nearest to an angle, in [0, pulses)."""
    return round(angle_deg % 360.0 * pulses / 360.0) % pulses


def angle_from_counts(counts: int, *, pulses: int) -> float:
    """Return the angle [deg] of an encoder reading, in [0, 360); readings may be negative or above a turn."""
    return (counts % pulses) * 360.0 / pulses


class ReplyParser:
    """Bytes in, in pieces of any size; whole replies out.

    `next_event` and `feed` raise ProtocolError and nothing else; the next call continues behind the damaged reply.
    """

    def __init__(self) -> None:
        self._unread = b""
        self._skipping = False

    def feed(self, data: bytes) -> None:
        """Add bytes. Raises ProtocolError and discards them if too many are unread."""
        self._unread += data
        if len(self._unread) > _LONGEST_UNREAD:
            start = self._unread[:16]
            self._skipping = not self._unread.endswith(b"\n")
            self._unread = b""
            raise ProtocolError(f"more than {_LONGEST_UNREAD} bytes without a reply, beginning {start!r}")

    def next_event(self) -> Reply | None:
        """Return the next complete reply, or None if more bytes are needed."""
        while b"\n" in self._unread:
            line, _, self._unread = self._unread.partition(b"\n")
            if not self._skipping:
                return _decode(line + b"\n")
            self._skipping = False
        return None

    def reset(self) -> None:
        """Discard received bytes."""
        self._unread = b""
        self._skipping = False


_FRAME = re.compile(rb"([0-9A-F])([A-Z]{2})([0-9A-F]*)\r\n")


def _decode(line: bytes) -> Reply:
    frame = _FRAME.fullmatch(line)
    if frame is None:
        raise ProtocolError(f"{line!r} is no reply")
    address, letters, digits = (part.decode("ascii") for part in frame.groups())
    if letters not in _DIGITS:
        raise ProtocolError(f"{line!r}: {letters} is no known answer")
    if len(digits) != _DIGITS[letters]:
        raise ProtocolError(f"{line!r}: {letters} has {_DIGITS[letters]} digits, not {len(digits)}")
    return address, letters, digits


def signed(digits: str) -> int:
    """Return the counts in eight digits; they may be negative."""
    value = int(digits, 16)
    return value - (1 << 32) if value >= 1 << 31 else value


def information_of(digits: str) -> Information:
    """Return a stage's description. Digits 10 to 13 are the year, 16 and 17 the hardware's release."""
    return Information(
        stage_type=int(digits[0:2], 16),
        serial_number=digits[2:10],
        firmware=digits[14:16],
        travel=int(digits[18:22], 16),
        pulses=int(digits[22:30], 16),
    )


_PROBE_ANSWER_S = 0.15  # an answer takes 36 ms on the line, a USB adapter adds 16 ms
_TRIES = 3
_REPLY_TIMEOUT_S = 1.0  # the longest reply takes 36 ms on the line, a USB adapter adds 16 ms
_QUIET_S = 0.05  # 48 bytes' worth of silence
_QUIET_LIMIT_S = 1.0
_POLL_S = 0.1
_GAP_S = 0.1  # a move sent sooner after the one before "can move to 0 instead", according to authors of other drivers


class EllxLink(Line):
    """The line to one stage (address 0-9 or A-F), open at 9600 bits/s.

    `busy_timeout_s` is the time for earlier commands; `restarted` is set when the stage initialises; notes list
    buttons, repeated questions and late answers.
    """

    def __init__(
        self,
        port: BytePort,
        *,
        address: str,
        busy_timeout_s: float,
        now_s: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._parser: ReplyParser
        self.address = check_address(address)
        name = f"Elliptec stage {address} on {port.name}"
        super().__init__(port, ReplyParser(), name=name, now_s=now_s, sleep=sleep)
        self._busy_timeout_s = busy_timeout_s
        self.restarted = False
        self._in_step = False
        self._last_heard_s = now_s()

    def begin(self) -> None:
        """Synchronise with a stage in an unknown state; an old error is noted and cleared."""
        code = self._resynchronise(busy_until_s=self.now_s() + self._busy_timeout_s)
        if code != OK:
            self.notes.add(f"left from before: status {_in_words(code)}")

    def ask(self, sent: bytes, letters: str) -> str:
        """Return the digits of the answer to a command that moves nothing, asking up to three times."""
        self._get_in_step()
        for _ in range(_TRIES - 1):
            try:
                return self._exchange(sent, letters, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)
            except (ProtocolError, DeviceTimeoutError, DeviceFaultError) as error:
                self._note_or_raise(error)
            self._get_in_step()
        return self._exchange(sent, letters, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)

    def run_motion(self, sent: bytes, *, timeout_s: float) -> bool:
        """Send a command that moves the stage, once, and wait for the motion's end."""
        self._get_in_step()
        self.sleep(max(0.0, self._last_heard_s + _GAP_S - self.now_s()))
        deadline_s = self.now_s() + timeout_s
        try:
            self._exchange(sent, "PO", deadline_s=deadline_s)
        except (ProtocolError, DeviceTimeoutError, DeviceFaultError) as error:
            self._note_or_raise(error)
            self._get_in_step(busy_until_s=deadline_s)
            return False
        return True

    def fault(self, code: int, sent: bytes) -> DeviceFaultError:
        """Return the error for a status."""
        return DeviceFaultError(
            f"{self.name}: after {sent!r} it reports status {_in_words(code)}. "
            "Check that nothing blocks it and that its supply is good, then home it again",
            code=code,
            meaning=STATUS_MEANINGS.get(code, "reserved"),
        )

    def _exchange(self, sent: bytes, letters: str, *, deadline_s: float) -> str:
        """Return the digits of the answer to a command; without one the link is out of step."""
        self._listen(quiet_s=0.0)  # so that nothing older passes for the answer
        self._in_step = False
        self._port.write(sent)
        digits = self._await(sent, letters, deadline_s=deadline_s)
        self._in_step = True
        return digits

    def _await(self, sent: bytes, wanted: str, *, deadline_s: float) -> str:
        while True:
            letters, digits = self._next_reply(sent, deadline_s=deadline_s)
            code = int(digits, 16) if letters == "GS" else OK
            if code == INITIALISING:
                self.restarted = True
            if letters == wanted:
                return digits
            if code not in (OK, BUSY):
                self._clear_fault()
                raise self.fault(code, sent)

    def _next_reply(self, sent: bytes, *, deadline_s: float) -> tuple[str, str]:
        """Return letters and digits of our stage's next reply; pressed buttons are noted."""
        while True:
            try:
                reply = self._parser.next_event()
                if reply is None:
                    self._parser.feed(self._read(sent, deadline_s=deadline_s))
            except ProtocolError as error:
                raise ProtocolError(f"{self.name}: after {sent!r}: {error}") from error
            if reply is not None and not self._is_of_others(reply):
                return reply[1], reply[2]

    def _read(self, sent: bytes, *, deadline_s: float) -> bytes:
        remaining_s = deadline_s - self.now_s()
        if remaining_s <= 0.0:
            raise DeviceTimeoutError(
                f"{self.name}: no answer to {sent!r} in time. Check the supply, the cable and the address"
            )
        data = self._port.read_some(timeout_s=remaining_s)
        if data:
            self._last_heard_s = self.now_s()
        return data

    def _is_of_others(self, reply: Reply) -> bool:
        """Return whether a reply is no answer to us; a pressed button is noted."""
        address, letters, digits = reply
        if address == self.address and letters == "BS":
            self.notes.add("a button of the handset was pressed")
        elif address == self.address and letters == "BO":
            self.notes.add(f"a button of the handset moved the stage to {signed(digits)} counts")
        return address != self.address or letters in ("BS", "BO")

    def _listen(self, *, quiet_s: float) -> None:
        """Read and discard until the line is quiet."""
        end_s = self.now_s() + _QUIET_LIMIT_S
        while data := self._port.read_some(timeout_s=quiet_s):
            self._note_stale(data)
            if self.now_s() >= end_s:
                break
        self._parser.reset()

    def _note_stale(self, data: bytes) -> None:
        try:
            self._parser.feed(data)
            while (reply := self._parser.next_event()) is not None:
                if not self._is_of_others(reply):
                    self.notes.add(f"ignored, because it came late or unasked: {''.join(reply)}")
        except ProtocolError as error:
            self.notes.add(f"ignored: {error}")

    def _note_or_raise(self, error: Exception) -> None:
        """Note an error that a repetition may cure; raise any other."""
        if isinstance(error, DeviceFaultError) and error.code not in GARBLED_CODES:
            raise error
        self.notes.add(f"tried again: {error}")

    def _get_in_step(self, *, busy_until_s: float | None = None) -> None:
        """Wait until every command is answered; raise a fault that the stage reports meanwhile."""
        if self._in_step:
            return
        until_s = self.now_s() + self._busy_timeout_s if busy_until_s is None else busy_until_s
        code = self._resynchronise(busy_until_s=until_s)
        if code in GARBLED_CODES:
            self.notes.add(f"a command was damaged: status {_in_words(code)}")
        elif code != OK:
            raise self.fault(code, command(self.address, "gs"))

    def _resynchronise(self, *, busy_until_s: float) -> int:
        """Return the status of the stage once it is not busy; reading clears it."""
        self._reset_line()
        while (code := self._read_status()) in (BUSY, INITIALISING):
            if self.now_s() >= busy_until_s:
                raise DeviceTimeoutError(
                    f"{self.name}: still at status {_in_words(code)} after its deadline; its angle is not known until "
                    "it rests. If it turns too slowly, it is worn or blocked"
                )
            self.sleep(_POLL_S)
        self._in_step = True
        return code

    def _read_status(self) -> int:
        for _ in range(_TRIES - 1):
            try:
                return self._ask_status()
            except (ProtocolError, DeviceTimeoutError) as error:
                self.notes.add(f"tried again: {error}")
            self._reset_line()
        return self._ask_status()

    def _ask_status(self) -> int:
        question = command(self.address, "gs")
        self._port.write(question)
        return int(self._await(question, "GS", deadline_s=self.now_s() + _REPLY_TIMEOUT_S), 16)

    def _clear_fault(self) -> None:
        """Read the status once to clear a reported fault."""
        try:
            self._ask_status()
        except (ProtocolError, DeviceTimeoutError) as error:
            self.notes.add(f"the fault may still be set in the stage: {error}")

    def _reset_line(self) -> None:
        self._port.write(RESET_RECEIVER)
        self._listen(quiet_s=_QUIET_S)


def _in_words(code: int) -> str:
    return f"{code} ({STATUS_MEANINGS.get(code, 'reserved')})"


def ask_elliptec(port: BytePort, *, now_s: Callable[[], float] = time.monotonic) -> list[Answer]:
    """Return the Elliptec rotation stages at all sixteen addresses of a line at 9600 bits/s."""
    answers = []
    for address in "0123456789ABCDEF":
        question = command(address, "in")
        for found, letters, digits in events_after(
            port, question, ReplyParser(), wait_s=_PROBE_ANSWER_S, enough=1, now_s=now_s
        ):
            if (found, letters) == (address, "IN"):
                answers.append(Answer(address=address, identity=information_of(digits).identity))
    return answers


# For `rigctl devices`: behind the FT230X of its interface board.
PROBE = StageProbe(baud=BAUD, usb_ids=((0x0403, 0x6015),), ask=ask_elliptec)

_SLOWEST_DEG_PER_S = 10.0  # an ELL14 reaches about 430; a slower one is faulty
_START_S = 2.0
_FULL_TURN_S = _START_S + 360.0 / _SLOWEST_DEG_PER_S


class EllxStage(SerialStage):
    """The stage behind a link. `open_elliptec` makes one.

    Moves are refused until `home` has been called on this connection, and again after a restart of the stage: the
    protocol does not report if the stage was homed since power-up, and otherwise every angle is off by an unknown
    amount. The remarks of the next `Move` list pressed buttons of the handset.
    """

    def __init__(self, link: EllxLink, information: Information, *, tolerance_deg: float) -> None:
        self._link = link
        self._information = information
        try:
            self._pulses = pulses_per_revolution(information)
        except ProtocolError as error:
            raise ProtocolError(f"{link.name}: {error}") from error
        super().__init__(link, tolerance_deg=tolerance_deg, count_deg=360.0 / self._pulses)
        self._homed = False
        self._last_counts: int | None = None

    def identify(self) -> DeviceIdentity:
        """Return model, serial number and firmware, as read when the connection was made."""
        return self._information.identity

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback."""
        self._homed = False
        for _ in range(_TRIES):
            if self._link.run_motion(command(self._link.address, "ho0"), timeout_s=_FULL_TURN_S):
                self._homed = True
                self._link.restarted = False
                return self.position()
        raise DeviceTimeoutError(
            f"{self._link.name}: homing was commanded {_TRIES} times and not confirmed. Last seen: "
            + "; ".join(self._link.notes.take())
        )

    def position(self) -> StagePosition:
        """Return the encoder's reading once two in a row agree, because replies have no checksum."""
        return self._agreed_position(self._read_encoder)

    def status(self) -> StageStatus:
        """Return the status; reading a stored fault clears it."""
        try:
            code = int(self._link.ask(command(self._link.address, "gs"), "GS"), 16)
        except DeviceFaultError as error:
            code = int(error.code)
        return StageStatus(
            moving=code == BUSY,
            homed=self._homed and not self._link.restarted,
            code=code,
            meaning=STATUS_MEANINGS.get(code, "reserved"),
        )

    def stop(self) -> None:
        """Stop a continuous motion. The stage has no command to interrupt a move to a target."""
        sent = command(self._link.address, "st")
        code = int(self._link.ask(sent, "GS"), 16)
        if code not in (OK, BUSY):
            raise self._link.fault(code, sent)

    def _require_homed(self) -> None:
        if not self._homed or self._link.restarted:
            since = "it was restarted" if self._link.restarted else "the connection was made"
            raise LimitError(
                f"{self._link.name}: it was not homed since {since}, so its angles are meaningless. Home it first"
            )

    def _read_encoder(self) -> StagePosition:
        counts = signed(self._link.ask(command(self._link.address, "gp"), "PO"))
        angle_deg = angle_from_counts(counts, pulses=self._pulses)
        self._last_counts = counts
        return StagePosition(angle_deg=angle_deg, counts=counts)

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        """Turn by an absolute move if it goes the requested way; absolute moves never pass zero."""
        self._require_homed()
        here = self._read_encoder().counts if self._last_counts is None else self._last_counts
        by = self._route(here, angle_deg, way=way)
        target = counts_from_angle(angle_deg, pulses=self._pulses)
        if abs(here + by - target) > 1:  # each of the two was rounded
            here = self.position().counts  # one damaged reading must not misdirect a relative move
            by = self._route(here, angle_deg, way=way)
        letters, counts = ("ma", target) if abs(here + by - target) <= 1 else ("mr", by)
        sent = move(self._link.address, letters, counts=counts)
        self._link.run_motion(sent, timeout_s=_START_S + abs(by) * 360.0 / self._pulses / _SLOWEST_DEG_PER_S)
        position = self._read_encoder()
        self._require_homed()
        return position

    def _route(self, here: int, angle_deg: float, *, way: Way) -> int:
        """Return by how many counts to turn."""
        from_deg = here * 360.0 / self._pulses
        return round(route_deg(from_deg, angle_deg, way=way, near_deg=self._tolerance_deg) * self._pulses / 360.0)


def open_elliptec(
    port: str | BytePort,
    *,
    address: str = FIRST_ADDRESS,
    tolerance_deg: float = 0.02,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> EllxStage:
    """Return the stage on a serial port or an open line, once two of its descriptions agree.

    Raises
    ------
    NotConnectedError
        There is no such port, or it may not be opened, or another program holds it.
    """
    with opened(port, baud=BAUD) as line:
        link = EllxLink(line, address=address, busy_timeout_s=_FULL_TURN_S, now_s=now_s, sleep=sleep)
        link.begin()
        return EllxStage(link, _ask_information(link), tolerance_deg=tolerance_deg)


def _ask_information(link: EllxLink) -> Information:
    """Return the stage's description once two agree, since a damaged digit would change every angle."""
    digits = two_agree(
        lambda: link.ask(command(link.address, "in"), "IN"),
        name=link.name,
        tries=_TRIES,
        differ=lambda before, latest: f"its descriptions of itself differ: {before}, {latest}",
    )
    return information_of(digits)
