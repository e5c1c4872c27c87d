"""The language of Zaber devices (ASCII protocol, firmware 6 and 7), without input or output.

Source: Zaber Technologies, "ASCII Protocol Manual". A command is ``/device axis id words:CK`` and a line feed; a reply
is ``@device axis id OK|RJ BUSY|IDLE flag data:CK``, carriage return, line feed. CK is two hexadecimal digits that make
the bytes after the first character add up to 0 modulo 256; the id, 00 to 99, is that of the command that is answered.
"""

import re
from dataclasses import dataclass

from drivers.errors import LimitError, ProtocolError

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
    "AGAIN": "cannot be done just now",
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
    """The answer to one command.

    Attributes
    ----------
    device, axis : int
        Who answers; axis 0 is the device itself.
    message_id : int or None
        Of the command that is answered.
    accepted : bool
        Whether the command was accepted; else `data` is the reason.
    busy : bool
        Whether the axis moves.
    flag : str
        The most severe flag of `FLAG_MEANINGS`, or "--".
    data : str
        What was asked for.
    checked : bool
        Whether a checksum came with it.
    """

    device: int
    axis: int
    message_id: int | None
    accepted: bool
    busy: bool
    flag: str
    data: str
    checked: bool


@dataclass(frozen=True, kw_only=True)
class Unasked:
    """An alert (``!``) or an information line (``#``), which answers nothing."""

    kind: str
    text: str


Event = Reply | Unasked


def check_address(address: str) -> int:
    """Return the address as a number if it is one that a device can have, else raise LimitError."""
    if not re.fullmatch("[0-9]{1,2}", address) or int(address) == 0:
        raise LimitError(f"address {address!r}: a Zaber address is a number from 1 to 99")
    return int(address)


def checksum(text: str) -> str:
    """Return the two digits that make the bytes of a text add up to 0 modulo 256."""
    return f"{-sum(text.encode('ascii')) & 0xFF:02X}"


def command(words: str, *, device: int, axis: int, message_id: int) -> bytes:
    """Return a command as it goes over the line.

    Parameters
    ----------
    words : str
        Such as ``get pos``; empty asks for the status.
    device, axis : int
        Whom it is for; axis 0 is the device itself.
    message_id : int
        0 to 99; the reply will carry it.
    """
    text = f"{device} {axis} {message_id:02d} {words}".rstrip()
    return f"/{text}:{checksum(text)}\n".encode("ascii")


def whole_number(data: str) -> int:
    """Return the whole number that a reply's data are. Raises ProtocolError."""
    if not re.fullmatch("-?[0-9]{1,18}", data):
        raise ProtocolError(f"{data!r} is no whole number")
    return int(data)


def flags(data: str) -> tuple[str, ...]:
    """Return the flags in the answer to ``warnings``. Raises ProtocolError."""
    count, *found = data.split(" ") if data else ["?"]
    if (
        not count.isdecimal()
        or int(count) != len(found)
        or not all(re.fullmatch("[A-Z0-9]{2}", flag) for flag in found)
    ):
        raise ProtocolError(f"{data!r} is no list of warning flags")
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
        """Take bytes in. Raises ProtocolError, and forgets them, when too many are unread."""
        self._unread += data
        if len(self._unread) > _LONGEST_UNREAD:
            start, self._unread = self._unread[:16], b""
            raise ProtocolError(f"more than {_LONGEST_UNREAD} bytes that make no message, beginning {start!r}")

    def next_event(self) -> Event | None:
        """Return the next message that has come in whole, or None when more bytes are needed."""
        if b"\n" not in self._unread:
            return None
        line, _, self._unread = self._unread.partition(b"\n")
        return _decode(line + b"\n")

    def reset(self) -> None:
        """Forget what has come in."""
        self._unread = b""


_FRAME = re.compile(rb"([@!#])([ -~]*?)(?::([0-9A-F]{2}))?\r\n")
_REPLY = re.compile(r"([0-9]{2}) ([0-9]) (?:([0-9]{2}) )?(OK|RJ) (BUSY|IDLE) ([A-Z0-9]{2}|--) ([ -~]*)")


def _decode(line: bytes) -> Event:
    frame = _FRAME.fullmatch(line)
    if frame is None:
        raise ProtocolError(f"{line!r} is no message")
    kind, text = frame[1].decode("ascii"), frame[2].decode("ascii")
    if frame[3] is not None and frame[3].decode("ascii") != checksum(text):
        raise ProtocolError(f"{line!r}: the checksum is not {checksum(text)}")
    if kind != "@":
        return Unasked(kind=kind, text=text)
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
