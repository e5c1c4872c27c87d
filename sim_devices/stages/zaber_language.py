"""Answers of a simulated Zaber stage, from a reading of Zaber's ASCII protocol manual (firmware 6 and 7)."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.simulated_stage import Reply
from sim_devices.stages.zaber_address import ZaberOptions

_MAXSPEED_UNIT = 1.6384  # microsteps a second are this much less than the number in the setting
_TOP_SPEED_DEG_PER_S = 100.0  # what is set; a hindered motor does not come up to it
_FAR = 10**9


class ZaberSettings:
    """Name to value. Positions are asked for each time."""

    def __init__(self, options: ZaberOptions, position: Callable[[], int]) -> None:
        turn = options.counts_per_turn
        self.alerts = False
        self.checksums = False
        self._position = position
        self._has_encoder = options.encoder
        self._fixed: dict[str, int | str] = {
            "deviceid": options.model,
            "device.id": options.model,
            "system.serial": options.serial_number,
            "system.axiscount": 1,
            "version": "7.38",
            "version.build": 16000,
            "device.hw.modified": 0,
            "comm.packet.size.max": 80,
            "comm.word.size.max": 50,
            "comm.command.packets.max": 1,
            "get.settings.max": 10,
            "resolution": options.resolution,
            "limit.min": 0 if options.one_turn else -_FAR,
            "limit.max": turn if options.one_turn else _FAR,
            "maxspeed": round(_TOP_SPEED_DEG_PER_S / 360.0 * turn * _MAXSPEED_UNIT),
        }
        if options.cycle:
            self._fixed["limit.cycle.dist"] = turn

    def get(self, name: str) -> str | None:
        """Return a setting's value as text, or None when there is no such setting."""
        if name == "pos" or (name == "encoder.pos" and self._has_encoder):
            return str(self._position())
        switches = {"comm.alert": self.alerts, "comm.checksum": self.checksums}
        if name in switches:
            return str(int(switches[name]))
        value = self._fixed.get(name)
        return None if value is None else str(value)

    def set(self, name: str, value: str) -> bool:
        """Write a setting; return whether there is one that can take this value."""
        if value not in ("0", "1"):
            return False
        if name == "comm.alert":
            self.alerts = value == "1"
        elif name == "comm.checksum":
            self.checksums = value == "1"
        else:
            return False
        return True


_LONGEST = 80
_CHECKED = re.compile(r"(.*):([0-9A-F]{2})")


@dataclass(frozen=True, kw_only=True)
class Command:
    """A whole command: for which device and axis (0: all), its message id if it has one, and its words."""

    device: int
    axis: int
    message_id: str | None
    words: tuple[str, ...]


class ZaberReceiver:
    """Collects characters from a slash to the end of a line. A command whose checksum is wrong is passed over."""

    def __init__(self) -> None:
        self._collected: str | None = None

    def receive(self, data: bytes) -> list[Command]:
        """Return the commands that these bytes complete."""
        commands = (self._take(character) for character in data.decode("latin-1"))
        return [command for command in commands if command is not None]

    def _take(self, character: str) -> Command | None:
        if character in "\r\n":
            text, self._collected = self._collected, None
            return None if text is None else _understand(text)
        if self._collected is None:
            self._collected = "" if character == "/" else None
        elif len(self._collected) < _LONGEST and " " <= character <= "~":
            self._collected += character
        else:
            self._collected = None
        return None


def checksum(text: str) -> str:
    """Return the two digits that make the bytes of a message add up to 0 modulo 256."""
    return f"{-sum(text.encode('latin-1')) % 256:02X}"


def _understand(text: str) -> Command | None:
    checked = _CHECKED.fullmatch(text)
    if checked is not None:
        text, digits = checked.groups()
        if checksum(text) != digits:
            return None
    numbers, words = _leading_numbers(text.split())
    padded: list[str | None] = [*numbers, None, None, None]
    device, axis, message_id = padded[:3]
    return Command(device=int(device or 0), axis=int(axis or 0), message_id=message_id, words=words)


def _leading_numbers(words: list[str]) -> tuple[list[str], tuple[str, ...]]:
    count = 0
    while count < min(3, len(words)) and words[count].isdecimal():
        count += 1
    return words[:count], tuple(words[count:])


_DEVICE = 1
_STALLED, _NO_REFERENCE, _INTERRUPTED, _BY_HAND = "FS", "WR", "NI", "NC"
_BUSY_FOR_NO_REASON_S = 0.3


class ZaberLanguage:
    """The stage's side of the conversation. The time is an argument, and never goes back."""

    def __init__(self, options: ZaberOptions, drive: Drive) -> None:
        self._options = options
        self._drive = drive
        self._receiver = ZaberReceiver()
        self._now_s = 0.0
        self._settings = ZaberSettings(options, lambda: self._drive.ring.counts(self._now_s))
        self._flags = {_NO_REFERENCE}
        self.heard = 0
        self._appointment: tuple[float, Callable[[], None]] | None = None
        self._replies: list[Reply] = []
        self._commands: dict[str, Callable[[tuple[str, ...]], tuple[bool, str]]] = {
            "get": self._get,
            "set": self._set,
            "home": self._home,
            "move": self._move,
            "stop": self._stop,
            "warnings": self._warnings,
        }

    def receive(self, time_s: float, data: bytes) -> list[Reply]:
        """Return the replies up to a time [s] at which these bytes arrive."""
        self._live_until(time_s)
        for command in self._receiver.receive(data):
            self._obey(command)
        return self._take_replies()

    def advance(self, time_s: float) -> list[Reply]:
        """Return the replies up to a time [s]."""
        self._live_until(time_s)
        return self._take_replies()

    def next_event_s(self) -> float | None:
        """Return when the stage does something unasked, or None."""
        return self._appointment[0] if self._appointment else None

    def _take_replies(self) -> list[Reply]:
        replies, self._replies = self._replies, []
        return replies

    def _live_until(self, time_s: float) -> None:
        while self._appointment and self._appointment[0] <= time_s:
            (self._now_s, keep), self._appointment = self._appointment, None
            keep()
        self._now_s = max(self._now_s, time_s)

    def _obey(self, command: Command) -> None:
        if command.device not in (0, _DEVICE):
            return
        self.heard += 1
        if command.axis > 1:
            self._answer(command, accepted=False, data="BADAXIS")
        elif not command.words:
            self._answer(command, accepted=True, data="0")
        elif command.words[0] not in self._commands:
            self._answer(command, accepted=False, data="BADCOMMAND")
        else:
            accepted, data = self._commands[command.words[0]](command.words[1:])
            self._answer(command, accepted=accepted, data=data)

    def _answer(self, command: Command, *, accepted: bool, data: str) -> None:
        flag = "OK" if accepted else "RJ"
        message_id = "" if command.message_id is None else f" {command.message_id}"
        head = f"{_DEVICE:02d} {command.axis}{message_id}"
        self._say("@", f"{head} {flag} {self._state()} {self._worst_flag()} {data}")

    def _say(self, kind: str, text: str) -> None:
        silent = self._options.line.silent
        if silent is None or self.heard < silent:
            check = f":{checksum(text)}" if self._settings.checksums else ""
            self._replies.append((self._now_s, f"{kind}{text}{check}\r\n".encode("ascii")))

    def _state(self) -> str:
        return "BUSY" if self._appointment else "IDLE"

    def _worst_flag(self) -> str:
        return min(self._flags, key=lambda flag: ("FWN".index(flag[0]), flag), default="--")

    def _get(self, words: tuple[str, ...]) -> tuple[bool, str]:
        value = self._settings.get(words[0]) if len(words) == 1 else None
        return (False, "BADCOMMAND") if value is None else (True, value)

    def _set(self, words: tuple[str, ...]) -> tuple[bool, str]:
        known = len(words) == 2 and self._settings.set(*words)
        return (True, "0") if known else (False, "BADCOMMAND")

    def _warnings(self, words: tuple[str, ...]) -> tuple[bool, str]:
        told = " ".join([f"{len(self._flags):02d}", *sorted(self._flags)])
        if words == ("clear",):
            self._flags &= {_NO_REFERENCE}
        return True, told

    def _home(self, _words: tuple[str, ...]) -> tuple[bool, str]:
        end_s = self._drive.home(self._now_s, clockwise=True, speed_deg_per_s=self._speed())
        self._flags.discard(_STALLED)
        self._appointment = (end_s, self._find_mark)
        return True, "0"

    def _move(self, words: tuple[str, ...]) -> tuple[bool, str]:
        counts = self._target(words)
        if counts is None:
            return False, "BADDATA"
        ending = self._drive.move(self._now_s, counts, speed_deg_per_s=self._speed())
        keep: dict[Outcome, Callable[[], None]] = {
            "arrives": self._rest,
            "stalls": lambda: self._fail(_STALLED),
            "is turned by hand": self._turn_by_hand,
            "fails": lambda: self._fail(str((self._options.motion.fault or ("FF", 0))[0])),
        }
        self._appointment = (ending.time_s + self._lag_s(), keep[ending.outcome])
        return True, "0"

    def _target(self, words: tuple[str, ...]) -> int | None:
        """Return where a move command leads [microsteps], or None when that is nowhere."""
        if len(words) != 2 or words[0] not in ("abs", "rel") or not words[1].removeprefix("-").isdecimal():
            return None
        start = self._drive.ring.counts(self._now_s) if words[0] == "rel" else 0
        counts = start + int(words[1])
        lowest, highest = (int(self._settings.get(name) or 0) for name in ("limit.min", "limit.max"))
        return counts if lowest <= counts <= highest else None

    def _stop(self, _words: tuple[str, ...]) -> tuple[bool, str]:
        if self._appointment:
            self._drive.ring.halt(self._now_s)
            self._flags.add(_INTERRUPTED)
            self._appointment = None
        return True, "0"

    def _find_mark(self) -> None:
        if not self._options.motion.unhomed:
            self._flags.discard(_NO_REFERENCE)
        self._rest()

    def _fail(self, flag: str) -> None:
        self._flags.add(flag)
        self._rest()

    def _turn_by_hand(self) -> None:
        self._flags.add(_BY_HAND)
        self._appointment = (self._drive.turn_by_hand(self._now_s), self._rest)

    def _rest(self) -> None:
        if self._settings.alerts:
            self._say("!", f"{_DEVICE:02d} 1 {self._state()} {self._worst_flag()}")

    def _lag_s(self) -> float:
        return _BUSY_FOR_NO_REASON_S if self._options.motion.busy else 0.0

    def _speed(self) -> float:
        return self._options.motion.motor_deg_per_s
