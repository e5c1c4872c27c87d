"""Zaber rotation stages with the ASCII protocol (firmware 6 and 7): X-RST, X-RSW, X-RSM and related ones.

Language: a command is ``/device axis id words:CK`` and a line feed; a reply is ``@device axis id OK|RJ BUSY|IDLE flag
data:CK``, carriage return, line feed. CK is two hexadecimal digits that make the bytes after the first character add
up to 0 modulo 256; the id, 00 to 99, is that of the command that is answered.

Line: message id and checksum reveal late and damaged answers. Every command used here may be repeated: none moves by a
distance.

Source: Zaber Technologies, "ASCII Protocol Manual".
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
    target_within_deg,
)

BAUD = 115200
FIRST_ADDRESS = "1"
IDS = 100

NOTHING = "--"

FLAG_MEANINGS = {
    "FF": "critical system error",
    "FN": "peripheral not supported",
    "FZ": "peripheral inactive",
    "FH": "driver disabled by the emergency stop",
    "FV": "driver disabled: supply voltage out of range",
    "FO": "driver disabled on startup or by command",
    "FC": "driver disabled: current inrush",
    "FM": "driver disabled: motor temperature",
    "FD": "driver disabled by a fault",
    "FQ": "encoder error",
    "FI": "index error",
    "FA": "analog encoder not synchronized",
    "FR": "overdrive limit exceeded",
    "FS": "stalled and stopped",
    "FB": "stream bounds exceeded",
    "FP": "interpolated path deviates",
    "FE": "limit error",
    "FT": "excessive twist",
    "WL": "unexpected limit trigger",
    "WV": "supply voltage out of range",
    "WT": "controller temperature high",
    "WS": "stalled and recovered",
    "WM": "displaced while it stood still",
    "WP": "invalid calibration type",
    "WR": "no reference position",
    "WH": "device not homed",
    "NC": "turned by hand",
    "NI": "motion interrupted",
    "ND": "stream discontinuity",
    "NR": "value rounded",
    "NT": "value truncated",
    "NU": "setting update pending",
    "NJ": "joystick calibrating",
    NOTHING: "nothing to tell",
}
"""F: a fault, W: a warning, N: a note."""

NOT_HOMED = frozenset({"WR", "WH"})

REJECTIONS = {
    "AGAIN": "not possible at present",
    "BADAXIS": "there is no such axis",
    "BADCOMMAND": "command or setting not known",
    "BADDATA": "value not allowed",
    "BADMESSAGEID": "message id not allowed",
    "DEVICEONLY": "a command to the device, not to an axis",
    "DRIVERDISABLED": "the driver is disabled",
    "FULL": "no room",
    "LOCKSTEP": "the axis moves in lockstep",
    "NOACCESS": "access level too low",
    "PARKED": "the axis is parked",
    "STATUSBUSY": "the axis is moving",
}

_LONGEST_UNREAD = 1024  # bytes; a reply has 80 at most


@dataclass(frozen=True, kw_only=True)
class Reply:
    """The answer to one command."""

    device: int  #: Sender; axis 0 is the device itself.
    axis: int
    message_id: int | None  #: Of the command that is answered.
    accepted: bool  #: True if the command was accepted; else `data` is the reason.
    busy: bool  #: Whether the axis moves.
    flag: str  #: The most severe flag of `FLAG_MEANINGS`, or "--".
    data: str  #: What was asked for.
    checked: bool  #: True if it came with a checksum.


def check_address(address: str) -> int:
    """Return the address as a number if a device can have it, else raise LimitError."""
    if not re.fullmatch("[0-9]{1,2}", address) or int(address) == 0:
        raise AddressError(f"address {address!r}: a Zaber address is a number from 1 to 99")
    return int(address)


def checksum(text: str) -> str:
    """Return the two hexadecimal digits of the checksum of a text."""
    return f"{-sum(text.encode('ascii')) & 0xFF:02X}"


def command(words: str, *, device: int, axis: int, message_id: int) -> bytes:
    """Return a command as it goes over the line."""
    text = f"{device} {axis} {message_id:02d} {words}".rstrip()
    return f"/{text}:{checksum(text)}\n".encode("ascii")


def whole_number(data: str) -> int:
    """Return the data of a reply as an integer. Raises ProtocolError."""
    if not re.fullmatch("-?[0-9]{1,18}", data):
        raise ProtocolError(f"{data!r} is not an integer")
    return int(data)


def warning_flags(data: str) -> tuple[str, ...]:
    """Return the flags in the answer to ``warnings``. Raises ProtocolError."""
    count, *found = data.split(" ") if data else ["?"]
    if (
        not count.isdecimal()
        or int(count) != len(found)
        or not all(re.fullmatch("[A-Z0-9]{2}", flag) for flag in found)
    ):
        raise ProtocolError(f"{data!r} is not a list of warning flags")
    return tuple(found)


def in_words(flag: str) -> str:
    """Return a flag with its meaning."""
    return f"{flag} ({FLAG_MEANINGS.get(flag, 'not in the manual')})"


class ReplyParser:
    """Bytes in, in pieces of any size; whole messages out.

    `next_event` and `feed` raise ProtocolError and nothing else; the damaged message is then forgotten, and the
    next call goes on behind it.
    """

    def __init__(self) -> None:
        self._unread = b""

    def feed(self, data: bytes) -> None:
        """Add bytes. Raises ProtocolError and discards them if too many are unread."""
        self._unread += data
        if len(self._unread) > _LONGEST_UNREAD:
            start, self._unread = self._unread[:16], b""
            raise ProtocolError(f"more than {_LONGEST_UNREAD} bytes without a message, beginning {start!r}")

    def next_event(self) -> Reply | None:
        """Return the next whole reply, or None when more bytes are needed; alerts and information are skipped."""
        reply = None
        while reply is None and b"\n" in self._unread:
            line, _, self._unread = self._unread.partition(b"\n")
            reply = _decode(line + b"\n")
        return reply

    def reset(self) -> None:
        """Forget what has come in."""
        self._unread = b""


_FRAME = re.compile(rb"([@!#])([ -~]*?)(?::([0-9A-F]{2}))?\r\n")
_REPLY = re.compile(r"([0-9]{2}) ([0-9]) (?:([0-9]{2}) )?(OK|RJ) (BUSY|IDLE) ([A-Z0-9]{2}|--) ([ -~]*)")


def _decode(line: bytes) -> Reply | None:
    """Return the reply of a line; None for an alert (``!``) or information (``#``)."""
    frame = _FRAME.fullmatch(line)
    if frame is None:
        raise ProtocolError(f"{line!r} is no message")
    kind, text = frame[1].decode("ascii"), frame[2].decode("ascii")
    if frame[3] is not None and frame[3].decode("ascii") != checksum(text):
        raise ProtocolError(f"{line!r}: the checksum is not {checksum(text)}")
    if kind != "@":
        return None
    parts = _REPLY.fullmatch(text)
    if parts is None:
        raise ProtocolError(f"{line!r} is no reply")
    return Reply(
        device=int(parts[1]),
        axis=int(parts[2]),
        message_id=None if parts[3] is None else int(parts[3]),
        accepted=parts[4] == "OK",
        busy=parts[5] == "BUSY",
        flag=parts[6],
        data=parts[7],
        checked=frame[3] is not None,
    )


_PROBE_ANSWER_S = 0.2
_TRIES = 6
_REPLY_TIMEOUT_S = 0.5  # the longest reply takes 7 ms on the line, a USB adapter adds 16 ms
_AGAIN_PAUSE_S = 0.1
# Possible refusals of a command that was damaged in transmission.
_WORTH_ANOTHER_TRY = frozenset({"AGAIN", "BADAXIS", "BADCOMMAND", "BADDATA", "BADMESSAGEID"})


class ZaberLink(Line):
    """The line to one device (address 1 to 99) at 115200 bits/s; notes list flags and repeated questions."""

    def __init__(
        self, port: BytePort, *, address: str, now_s: Callable[[], float], sleep: Callable[[float], None]
    ) -> None:
        self._parser: ReplyParser
        self._device = check_address(address)
        name = f"Zaber stage {address} on {port.name}"
        super().__init__(port, ReplyParser(), name=name, now_s=now_s, sleep=sleep)
        self._next_id = 0

    def begin(self) -> None:
        """Make the device add a checksum to every message from now on."""
        self._ask("set comm.checksum 1", axis=0, unchecked=True)

    def ask(self, words: str, *, axis: int = 1) -> Reply:
        """Return the reply to a command, sent up to six times."""
        return self._ask(words, axis=axis, unchecked=False)

    def get_or_none(self, setting: str, *, axis: int = 1) -> str | None:
        """Return the value of a setting, or None if the firmware does not know it."""
        try:
            return self.ask(f"get {setting}", axis=axis).data
        except DeviceFaultError as error:
            if error.code != "BADCOMMAND":
                raise
            return None

    def fault(self, code: str, meaning: str, *, advice: str) -> DeviceFaultError:
        """Return the error for a fault."""
        return DeviceFaultError(f"{self.name}: it reports {code} ({meaning}). {advice}", code=code, meaning=meaning)

    def _ask(self, words: str, *, axis: int, unchecked: bool) -> Reply:
        refused: int | str | None = None
        for _ in range(_TRIES - 1):
            try:
                return self._exchange(words, axis=axis, unchecked=unchecked)
            except (ProtocolError, DeviceTimeoutError) as error:
                self.notes.add(f"tried again: {error}")
            except DeviceFaultError as error:
                if error.code not in _WORTH_ANOTHER_TRY or error.code == refused != "AGAIN":
                    raise
                refused = error.code
                self.sleep(_AGAIN_PAUSE_S)
        return self._exchange(words, axis=axis, unchecked=unchecked)

    def _exchange(self, words: str, *, axis: int, unchecked: bool) -> Reply:
        self.drain(quiet_s=0.0, limit_s=_REPLY_TIMEOUT_S)
        message_id, self._next_id = self._next_id, (self._next_id + 1) % IDS
        sent = command(words, device=self._device, axis=axis, message_id=message_id)
        self._port.write(sent)
        reply = self._await(sent, message_id, deadline_s=self.now_s() + _REPLY_TIMEOUT_S)
        if not (reply.checked or unchecked):
            raise ProtocolError(f"{self.name}: the reply to {sent!r} has no checksum: {reply.data!r}")
        if not reply.accepted:
            meaning = REJECTIONS.get(reply.data, "not in the manual")
            raise self.fault(reply.data, meaning, advice=f"That was refused: {sent!r}")
        return reply

    def _await(self, sent: bytes, message_id: int, *, deadline_s: float) -> Reply:
        damaged: ProtocolError | None = None
        while True:
            try:
                reply = self._parser.next_event()
            except ProtocolError as error:
                damaged = error  # perhaps of another command; the requested reply may still come
                continue
            if reply is not None and reply.device == self._device and reply.message_id == message_id:
                return reply
            if reply is None and not self.take_in(deadline_s):
                raise self.unanswered(f"{sent!r}", damaged, check="the cable and the address")


def ask_zaber(port: BytePort, *, now_s: Callable[[], float] = time.monotonic) -> list[Answer]:
    """Return the Zaber devices on a line at 115200 bits/s; every device of a chain answers for itself."""
    told: dict[int, dict[str, str]] = {}
    for message_id, setting in enumerate(("deviceid", "system.serial", "version")):
        question = command(f"get {setting}", device=0, axis=0, message_id=message_id)
        parser = ReplyParser()
        for reply in events_after(port, question, parser, wait_s=_PROBE_ANSWER_S, enough=None, now_s=now_s):
            if reply.accepted and reply.message_id == message_id:
                told.setdefault(reply.device, {})[setting] = reply.data
    return [
        Answer(
            address=str(device),
            identity=DeviceIdentity(
                model=f"Zaber {found['deviceid']}", serial_number=found["system.serial"], firmware=found["version"]
            ),
        )
        for device, found in sorted(told.items())
        if len(found) == 3
    ]


# For `rigctl devices`. Some cables have a plain FT232R (0403:6001), but so have thousands of other devices.
PROBE = StageProbe(baud=BAUD, usb_ids=((0x2939, None),), ask=ask_zaber)

_POLL_S = 0.05
_START_S = 2.0
_SLOWER_THAN_TOLD = 3.0  # longest duration of a motion over that at top speed
_HOME_S = 120.0
_MAXSPEED_UNIT = 1.6384  # the setting `maxspeed` over microsteps per second
_TURN_RANGE = (1 << 12, 1 << 28)  # microsteps per turn; 0.09 to 0.0000013 degrees each


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Relation of microsteps and angles of a stage, as read from it."""

    counts_per_turn: int  #: Microsteps of a full turn.
    lowest_deg: float  #: Limits of the position, which continues through full turns.
    highest_deg: float
    speed_deg_per_s: float  #: The stage's own top speed.
    reading: str  #: The setting with the position: the encoder's if there is one.


class ZaberStage(SerialStage):
    """The stage behind a link. `open_zaber` makes one.

    The stage knows if it was homed since power-up (flags WR and WH) and is asked before each move. Without an encoder
    the readback is the command of the motor, which does not show a slipping gear.
    """

    def __init__(self, link: ZaberLink, identity: DeviceIdentity, scale: Scale, *, tolerance_deg: float) -> None:
        super().__init__(link, tolerance_deg=tolerance_deg, count_deg=360.0 / scale.counts_per_turn)
        self._link = link
        self._identity = identity
        self._scale = scale

    def identify(self) -> DeviceIdentity:
        """Return model, serial number and firmware, as read when the connection was made."""
        return self._identity

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback."""
        self._link.ask("home")
        self._await_rest(deadline_s=self._link.now_s() + _HOME_S)
        for flag in sorted(NOT_HOMED & set(self._take_flags())):
            raise self._link.fault(flag, FLAG_MEANINGS[flag], advice="It came to rest without homing. Try again")
        return self.position()

    def position(self) -> StagePosition:
        """Return the reading of the encoder, or of the motor's count without an encoder."""
        counts = whole_number(self._link.ask(f"get {self._scale.reading}").data)
        return StagePosition(angle_deg=counts * 360.0 / self._scale.counts_per_turn % 360.0, counts=counts)

    def status(self) -> StageStatus:
        """Return the status; flags stay set."""
        moving = self._link.ask("").busy
        flags = warning_flags(self._link.ask("warnings").data)
        return StageStatus(
            moving=moving,
            homed=not NOT_HOMED & set(flags),
            code=" ".join(flags) or NOTHING,
            meaning="; ".join(FLAG_MEANINGS.get(flag, "not in the manual") for flag in flags) or FLAG_MEANINGS[NOTHING],
        )

    def stop(self) -> None:
        """Stop any motion."""
        self._link.ask("stop")
        self._await_rest(deadline_s=self._link.now_s() + _START_S)

    def _turn(self, angle_deg: float, *, way: Way) -> StagePosition:
        self._require_homed()
        scale = self._scale
        from_deg = self.position().counts * 360.0 / scale.counts_per_turn
        target_deg = target_within_deg(
            from_deg,
            angle_deg,
            way=way,
            near_deg=self._tolerance_deg,
            lowest_deg=scale.lowest_deg,
            highest_deg=scale.highest_deg,
        )
        way_s = abs(target_deg - from_deg) / scale.speed_deg_per_s
        self._link.ask(f"move abs {round(target_deg * scale.counts_per_turn / 360.0)}")
        self._await_rest(deadline_s=self._link.now_s() + _START_S + _SLOWER_THAN_TOLD * way_s)
        self._take_flags()
        return self.position()

    def _await_rest(self, *, deadline_s: float) -> None:
        while self._link.ask("").busy:
            if self._link.now_s() >= deadline_s:
                self._link.ask("stop")
                raise DeviceTimeoutError(
                    f"{self._link.name}: still moving after its deadline, so it was stopped. It is worn or blocked, or "
                    "its speed is set too low"
                )
            self._link.sleep(_POLL_S)

    def _take_flags(self) -> tuple[str, ...]:
        """Return the stage's flags and clear them; warnings become notes, a fault is raised."""
        flags = warning_flags(self._link.ask("warnings").data)
        if set(flags) - NOT_HOMED:
            self._link.ask("warnings clear")
        for flag in flags:
            if flag.startswith("F"):
                meaning = FLAG_MEANINGS.get(flag, "a fault that is not in the manual")
                raise self._link.fault(flag, meaning, advice="Check that nothing blocks it, then home it again")
            if flag not in NOT_HOMED:
                self._link.notes.add(f"the stage reports {in_words(flag)}")
        return flags

    def _require_homed(self) -> None:
        if NOT_HOMED & set(warning_flags(self._link.ask("warnings").data)):
            raise LimitError(
                f"{self._link.name}: it was not homed since its power-up, so its angles mean nothing yet. Home it first"
            )


def open_zaber(
    port: str | BytePort,
    *,
    address: str = FIRST_ADDRESS,
    tolerance_deg: float = 0.02,
    steps_per_turn: int | None = None,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> ZaberStage:
    """Return the stage on a serial port or an open line, once it is identified and its scale is known.

    Raises
    ------
    NotConnectedError
        There is no such port, or it may not be opened, or another program holds it.
    """
    with opened(port, baud=BAUD) as line:
        link = ZaberLink(line, address=address, now_s=now_s, sleep=sleep)
        link.begin()
        scale = _read_scale(link, steps_per_turn=steps_per_turn)
        return ZaberStage(link, read_identity(link), scale, tolerance_deg=tolerance_deg)


def read_identity(link: ZaberLink) -> DeviceIdentity:
    """Return a device's identity; the model is a number, since names are only in the maker's database."""
    model, serial_number, firmware = (
        link.ask(f"get {setting}", axis=0).data for setting in ("deviceid", "system.serial", "version")
    )
    return DeviceIdentity(model=f"Zaber {model}", serial_number=serial_number, firmware=firmware)


def _read_scale(link: ZaberLink, *, steps_per_turn: int | None) -> Scale:
    turn = _counts_per_turn(link, steps_per_turn=steps_per_turn)
    lowest, highest, speed = (
        whole_number(link.ask(f"get {setting}").data) for setting in ("limit.min", "limit.max", "maxspeed")
    )
    if speed <= 0 or lowest >= highest:
        raise ProtocolError(f"{link.name}: maxspeed {speed}, limits {lowest} to {highest}: it cannot turn with these")
    return Scale(
        counts_per_turn=turn,
        lowest_deg=lowest * 360.0 / turn,
        highest_deg=highest * 360.0 / turn,
        speed_deg_per_s=speed / _MAXSPEED_UNIT * 360.0 / turn,
        reading="pos" if link.get_or_none("encoder.pos") is None else "encoder.pos",
    )


def _counts_per_turn(link: ZaberLink, *, steps_per_turn: int | None) -> int:
    """Return the microsteps per turn: from the stage, or from the data sheet and the resolution."""
    resolution = whole_number(link.ask("get resolution").data)
    told = link.get_or_none("limit.cycle.dist")
    if told is None and steps_per_turn is None:
        raise LimitError(
            f"{link.name}: its firmware does not report the microsteps per turn. Take the motor steps per turn from "
            "its data sheet: steps_per_turn = (motor steps per revolution) x (gear ratio)"
        )
    turn = resolution * (steps_per_turn or 0) if told is None else whole_number(told)
    if steps_per_turn is not None and turn != resolution * steps_per_turn:
        raise LimitError(
            f"{link.name}: it has {turn} microsteps per turn, but steps_per_turn = {steps_per_turn} at its resolution "
            f"of {resolution} gives {resolution * steps_per_turn}. Correct steps_per_turn, or the stage is another one"
        )
    lowest, highest = _TURN_RANGE
    if not lowest <= turn <= highest:
        raise ProtocolError(f"{link.name}: {turn} microsteps per turn are not plausible ({lowest} to {highest})")
    return turn
