"""A simulated Zaber rotation stage: settings, triggers, commands, answers, address (``sim:zaber?stall=3``).

Written from Zaber's ASCII protocol manual (firmware 6 and 7), without the driver's code. An enabled trigger fires when
its condition becomes true, or at once if it is true; it is checked each millisecond while the device turns. A trigger
that waits for a digital line never fires, because there are none.
"""

import math
import operator
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field

from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.options import (
    COMMON_KEYS,
    StageOptions,
    fault_key,
    flag,
    whole,
)
from sim_devices.stages.stage import Language

Told = tuple[str, list[str]]
"""Data of a reply, and the lines that follow it."""


class RefusedError(Exception):
    """A command that cannot be executed; its text is the protocol's reason."""


class ZaberStorage:
    """Stored texts of the device and its axis, by key."""

    def __init__(self) -> None:
        self._texts: dict[str, dict[str, str]] = {"": {}, "axis ": {}}

    def obey(self, words: tuple[str, ...]) -> Told:
        """Return what ``storage ...`` is answered."""
        if words[:1] == ("all",):
            return "0", [line for scope in self._texts for line in self._listed(scope, words[2:])]
        scope, words = ("axis ", words[1:]) if words[:1] == ("axis",) else ("", words)
        if not words:
            raise RefusedError("BADCOMMAND")
        if words[0] == "print":
            return "0", self._listed(scope, words[1:])
        if len(words) < 2:
            raise RefusedError("BADDATA")
        return self._obey_key(self._texts[scope], words[0], words[1], " ".join(words[2:])), []

    def _obey_key(self, texts: dict[str, str], verb: str, key: str, text: str) -> str:
        if verb == "set":
            texts[key] = text
        elif verb == "append":
            texts[key] = f"{texts[key]} {text}" if key in texts else text
        elif verb == "exists":
            return str(int(key in texts))
        elif verb in ("get", "erase"):
            if key not in texts:
                raise RefusedError("BADDATA")
            text = texts[key] if verb == "get" else "0"
            if verb == "erase":
                del texts[key]
            return text
        else:
            raise RefusedError("BADCOMMAND")
        return "0"

    def _listed(self, scope: str, words: tuple[str, ...]) -> list[str]:
        """Return the keys with a prefix, or the commands that set them."""
        prefix = words[words.index("prefix") + 1] if "prefix" in words[:-1] else ""
        chosen = {key: text for key, text in self._texts[scope].items() if key.startswith(prefix)}
        if "keys" in words:
            return [f"set {key}" for key in chosen]
        return [f"{scope}set {key} {text}" for key, text in chosen.items()]


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
    """Collects characters from a slash to the end of a line. Commands with a wrong checksum are skipped."""

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
    """Return the two hexadecimal digits of the checksum of a message."""
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


_ACTIONS = ("a", "b")
_ENDLESS = -1
_LOOKS_HZ = 1000.0
_MS_PER_S = 1000.0
_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "<>": operator.ne,
}


@dataclass(kw_only=True)
class _Trigger:
    """A trigger: condition, actions, remaining firings (0 for none), and its state since it was enabled."""

    when: tuple[str, ...] = ("none",)
    actions: dict[str, tuple[str, ...]] = field(default_factory=lambda: dict.fromkeys(_ACTIONS, ("none",)))
    fires: int = 0
    was_true: bool = False
    from_counts: int = 0
    next_s: float = 0.0

    def lines(self) -> list[str]:
        """Return the commands that make it again."""
        enabled = "disable" if not self.fires else "enable" if self.fires == _ENDLESS else f"enable {self.fires}"
        actions = [f"action {letter} {' '.join(what)}" for letter, what in self.actions.items()]
        return [f"when {' '.join(self.when)}", *actions, enabled]

    def state(self) -> str:
        """Return its state: disabled, enabled, or the remaining firings."""
        return "d" if not self.fires else "e" if self.fires == _ENDLESS else str(self.fires)

    @property
    def period_s(self) -> float | None:
        """Time between firings, if it fires by time."""
        return int(self.when[1]) / _MS_PER_S if self.when[0] == "time" else None

    @property
    def distance(self) -> int | None:
        """Microsteps between firings, if it fires by distance."""
        return int(self.when[-1]) if self.when[-2:-1] == ("dist",) else None


class ZaberTriggers:
    """All triggers of a device."""

    def __init__(self, count: int, value_of: Callable[[str], str | None]) -> None:
        self._triggers = [_Trigger() for _ in range(count)]
        self._value_of = value_of

    def obey(self, words: tuple[str, ...], now_s: float) -> Told:
        """Return what ``trigger ...`` is answered."""
        if words == ("show",):
            return " ".join(trigger.state() for trigger in self._triggers), []
        if words == ("print",):
            numbered = enumerate(self._triggers, 1)
            return "0", [line for number, trigger in numbered for line in (f"trigger {number}", *trigger.lines())]
        if len(words) < 2 or not words[0].isdecimal():
            raise RefusedError("BADCOMMAND")
        if not 1 <= int(words[0]) <= len(self._triggers):
            raise RefusedError("BADDATA")
        return self._obey_one(self._triggers[int(words[0]) - 1], words[1], words[2:], now_s)

    def due_s(self, now_s: float, *, is_moving: bool) -> float | None:
        """Return the time of the next check without a command; None for never."""
        enabled = [trigger for trigger in self._triggers if trigger.fires]
        times_s = [trigger.next_s for trigger in enabled if trigger.period_s is not None]
        if is_moving and len(times_s) < len(enabled):
            # Rounded, because 1.001 s are 1000.9999 checks.
            times_s.append((math.floor(now_s * _LOOKS_HZ + 1e-3) + 1) / _LOOKS_HZ)
        return min(times_s, default=None)

    def fired(self, now_s: float) -> Iterator[tuple[str, ...]]:
        """Yield the actions due now, trigger by trigger."""
        for trigger in self._triggers:
            if trigger.fires and self._is_due(trigger, now_s):
                trigger.fires -= trigger.fires != _ENDLESS
                yield from (what for what in trigger.actions.values() if what != ("none",))

    def _is_due(self, trigger: _Trigger, now_s: float) -> bool:
        """Return whether a trigger fires now, and note it."""
        if trigger.period_s is not None:
            is_due = now_s >= trigger.next_s
            trigger.next_s += trigger.period_s if is_due else 0.0
            return is_due
        if trigger.distance is not None:
            way = self._position() - trigger.from_counts
            is_due = abs(way) >= trigger.distance
            trigger.from_counts += int(math.copysign(trigger.distance, way)) if is_due else 0
            return is_due
        was_true, trigger.was_true = trigger.was_true, self._is_true(trigger.when)
        return trigger.was_true and not was_true

    def _is_true(self, when: tuple[str, ...]) -> bool:
        """Return whether a condition such as ``1 pos > 100`` or ``1 abs pos > 100`` is about a setting."""
        words = when[1:] if when[:1] in (("0",), ("1",)) else when
        size, words = (abs, words[1:]) if words[:1] == ("abs",) else (float, words)
        if len(words) != 3 or words[1] not in _COMPARISONS:
            return False
        value = self._value_of(words[0])
        return value is not None and _COMPARISONS[words[1]](size(float(value)), float(words[2]))

    def _position(self) -> int:
        return int(self._value_of("pos") or 0)

    def _obey_one(self, trigger: _Trigger, verb: str, words: tuple[str, ...], now_s: float) -> Told:
        if verb == "print" and not words:
            return "0", trigger.lines()
        if verb == "when" and _is_condition(words):
            trigger.when = words
        elif verb == "action" and len(words) > 1 and words[0] in _ACTIONS:
            trigger.actions[words[0]] = words[1:]
        elif verb == "action" and words == ("none",):
            trigger.actions = dict.fromkeys(_ACTIONS, ("none",))
        elif verb == "enable" and len(words) <= 1 and all(word.isdecimal() for word in words):
            trigger.fires = int(words[0]) if words else _ENDLESS
            trigger.was_true, trigger.from_counts = False, self._position()
            trigger.next_s = now_s + (trigger.period_s or 0.0)
        elif verb == "disable" and not words:
            trigger.fires = 0
        else:
            raise RefusedError("BADDATA")
        return "0", []


def _is_condition(words: tuple[str, ...]) -> bool:
    """Return whether words are a condition; times and distances are integers from 1."""
    counted = words[:1] == ("time",) or words[-2:-1] == ("dist",)
    return bool(words) and (not counted or (len(words) > 1 and words[-1].isdecimal() and int(words[-1]) > 0))


@dataclass(frozen=True, kw_only=True)
class ZaberOptions(StageOptions):
    """A stage and its faults. The defaults are those of a worm-driven stage with an encoder (numbers assumed)."""

    motor_deg_per_s: float = 100.0
    landing_deg: float = 0.001
    model: int = 50931  #: The device's identity number.
    serial_number: int = 114821  #: Answer to ``get system.serial``.
    resolution: int = 64  #: Microsteps per motor step, which can be changed.
    steps: int = 24000  #: Motor steps per turn of the ring.
    cycle: bool = True  #: The firmware has the setting ``limit.cycle.dist``.
    encoder: bool = True  #: It has an encoder, with the setting ``encoder.pos``.
    one_turn: bool = False  #: Its limits allow one turn only.

    @property
    def counts_per_turn(self) -> int:
        """Microsteps of a turn of the ring."""
        return self.resolution * self.steps


def _fault_flag(text: str) -> str:
    if len(text) != 2 or text[0] != "F" or not "A" <= text[1] <= "Z":
        raise ValueError(text)
    return text


KEYS = {
    "model": whole("model", "identity number", 1, 10**6),
    "serial": whole("serial_number", "serial number", 0, 2**32 - 1),
    "resolution": whole("resolution", "microsteps of a motor step", 1, 256),
    "steps": whole("steps", "motor steps of a turn", 1, 10**6),
    "cycle": flag("cycle", "knows the setting limit.cycle.dist"),
    "encoder": flag("encoder", "has an encoder"),
    "oneturn": flag("one_turn", "its limits allow one turn only"),
    "fault": fault_key(_fault_flag, codes="a warning flag that begins with F"),
    **COMMON_KEYS,
}


_MAXSPEED_UNIT = 1.6384  # factor from microsteps per second to the number in the setting
_TOP_SPEED_DEG_PER_S = 100.0  # the setting; a hindered motor does not reach it
_FAR = 10**9
_INDICES_A_TURN = 8
_AT_INDEX = 1e-4  # of a turn


# Lowest and highest value of a setting.
_SWITCH = (0, 1)
_SPEED = (1, 2**31)
_CURRENT = (0, 120)
_PLACE = (-_FAR, _FAR)
_WRITABLE = {
    "accel": (0, 32767),
    "comm.alert": _SWITCH,
    "comm.checksum": _SWITCH,
    "driver.current.hold": _CURRENT,
    "driver.current.run": _CURRENT,
    "knob.enable": _SWITCH,
    "limit.approach.maxspeed": _SPEED,
    "limit.max": _PLACE,
    "limit.min": _PLACE,
    "maxspeed": _SPEED,
    "motion.accelonly": (0, 32767),
    "motion.decelonly": (0, 32767),
    "motion.index.dist": (1, _FAR),
    "system.led.enable": _SWITCH,
}


# Default settings.
_SAME_OF_ALL: dict[str, int | float | str] = {
    "system.axiscount": 1,
    "system.access": 1,
    "system.voltage": 48.1,
    "system.temperature": 31.5,
    "driver.temperature": 34.0,
    "version": "7.38",
    "version.build": 16000,
    "device.hw.modified": 0,
    "peripheralid": 0,
    "peripheral.id": 0,
    "comm.packet.size.max": 80,
    "comm.word.size.max": 50,
    "comm.command.packets.max": 1,
    "comm.rs232.baud": 115200,
    "comm.protocol": 2,
    "get.settings.max": 10,
    "trigger.numtriggers": 6,
    "trigger.numactions": 2,
    "limit.home.state": 0,
    "accel": 205,
    "motion.accelonly": 205,
    "motion.decelonly": 205,
    "driver.current.run": 40,
    "driver.current.hold": 20,
    "knob.enable": 1,
    "system.led.enable": 1,
    "comm.alert": 0,
    "comm.checksum": 0,
}


def _of_model(options: ZaberOptions) -> dict[str, int | float | str]:
    """Return what a stage of one model comes with."""
    turn = options.counts_per_turn
    top_speed = round(_TOP_SPEED_DEG_PER_S / 360.0 * turn * _MAXSPEED_UNIT)
    cycle = {"limit.cycle.dist": turn} if options.cycle else {}
    return {
        "deviceid": options.model,
        "device.id": options.model,
        "system.serial": options.serial_number,
        "resolution": options.resolution,
        "limit.min": 0 if options.one_turn else -_FAR,
        "limit.max": turn if options.one_turn else _FAR,
        "maxspeed": top_speed,
        "limit.approach.maxspeed": top_speed,
        "motion.index.dist": turn // _INDICES_A_TURN,
        **cycle,
    }


class ZaberSettings:
    """Settings by name. Positions are read each time."""

    def __init__(self, options: ZaberOptions, position: Callable[[], int], now_s: Callable[[], float]) -> None:
        self._turn = options.counts_per_turn
        self._position, self._now_s = position, now_s
        self._has_encoder = options.encoder
        self._born = _SAME_OF_ALL | _of_model(options)
        self._values = dict(self._born)
        self.is_parked = False

    def get(self, name: str) -> str | None:
        """Return a setting's value as text, or None if it does not exist."""
        if name == "pos" or (name == "encoder.pos" and self._has_encoder):
            return str(self._position())
        if name == "motion.index.num" and "limit.cycle.dist" in self._values:
            return str(self._index())
        if name == "parking.state":
            return str(int(self.is_parked))
        if name == "system.uptime":
            return f"{self._now_s():.1f}"
        value = self._values.get(name)
        return None if value is None else str(value)

    def _index(self) -> int:
        """Return the number of its index position, from 1; 0 for none."""
        distance = self.number("motion.index.dist")
        nearest = round(self._position() / distance)
        is_there = abs(self._position() - nearest * distance) <= self._turn * _AT_INDEX
        return nearest % max(1, self._turn // distance) + 1 if is_there else 0

    def number(self, name: str) -> int:
        """Return a whole number that is set."""
        return int(self._values[name])

    def is_on(self, name: str) -> bool:
        """Return whether a switch is on."""
        return self._values[name] == 1

    def set(self, name: str, text: str) -> str | None:
        """Write a setting; return why not, or None."""
        if name not in _WRITABLE or name not in self._values:
            return "BADCOMMAND"
        lowest, highest = _WRITABLE[name]
        if not text.removeprefix("-").isdecimal() or not lowest <= int(text) <= highest:
            return "BADDATA"
        self._values[name] = int(text)
        return None

    def restore(self) -> None:
        """Set everything to what it came with."""
        self._values = dict(self._born)

    def top_speed_deg_per_s(self) -> float:
        """Return the allowed speed; the default exceeds the motor's."""
        if self._values["maxspeed"] == self._born["maxspeed"]:
            return float("inf")
        return self.speed_deg_per_s(self.number("maxspeed"))

    def speed_deg_per_s(self, value: int) -> float:
        """Return the speed that a number means [deg/s]."""
        return value / _MAXSPEED_UNIT / self._turn * 360.0


_BORN_ADDRESS, _LAST_ADDRESS = 1, 99
_STALLED, _DISABLED, _NO_REFERENCE, _INTERRUPTED, _BY_HAND = "FS", "FO", "WR", "NI", "NC"
_LASTING = frozenset({_NO_REFERENCE, _DISABLED})
_BUSY_FOR_NO_REASON_S = 0.3
_DONE: Told = ("0", [])
# Effect of a trigger's action on a setting.
_CHANGES: dict[str, Callable[[int, int], int]] = {"=": lambda _, by: by, "+=": operator.add, "-=": operator.sub}


class ZaberLanguage(Language):
    """What a Zaber stage hears and says."""

    _options: ZaberOptions

    def __init__(self, options: ZaberOptions, drive: Drive) -> None:
        super().__init__(options, drive)
        self._receiver = ZaberReceiver()
        self._settings = ZaberSettings(options, lambda: self._drive.ring.counts(self._now_s), lambda: self._now_s)
        self._triggers = ZaberTriggers(self._settings.number("trigger.numtriggers"), self._settings.get)
        self._storage = ZaberStorage()
        self._address = _BORN_ADDRESS
        self._flags = {_NO_REFERENCE}
        self._goes_on = False
        self._commands: dict[str, Callable[[tuple[str, ...]], Told]] = {
            "get": self._get,
            "set": self._set,
            "home": self._home,
            "move": self._move,
            "stop": lambda _: self._stop(),
            "estop": lambda _: self._stop(),
            "warnings": self._warnings,
            "tools": self._park,
            "driver": self._switch_driver,
            "renumber": self._renumber,
            "system": self._restore,
            "axis": self._restore,
            "trigger": lambda words: self._triggers.obey(words, self._now_s),
            "storage": self._storage.obey,
            "io": self._tell_lines,
        }

    @property
    def understood(self) -> frozenset[str]:
        """First words of all known commands."""
        return frozenset(self._commands)

    def _hear(self, data: bytes) -> None:
        for command in self._receiver.receive(data):
            self._obey(command)
            self._do_routine()

    def _next_routine_s(self) -> float | None:
        return self._triggers.due_s(self._now_s, is_moving=self._drive.ring.is_moving(self._now_s))

    def _do_routine(self) -> None:
        """Execute the actions of triggers; impossible ones are skipped, since they have no answer."""
        for action in self._triggers.fired(self._now_s):
            words = action[1:] if action[0] in ("0", "1") else action
            with suppress(RefusedError):
                if words[1:2] and words[1] in _CHANGES:
                    self._change(words[0], _CHANGES[words[1]], words[2:])
                elif words[0] in self._commands:
                    self._commands[words[0]](words[1:])

    def _change(self, name: str, change: Callable[[int, int], int], words: tuple[str, ...]) -> None:
        """Set a setting to, or change it by, a number or another setting."""
        by = self._settings.get(words[-1]) if words[0] == "setting" else words[-1]
        was = self._settings.get(name)
        if by is not None and was is not None:
            self._settings.set(name, str(change(int(was), int(by))))

    def _obey(self, command: Command) -> None:
        if command.device not in (0, self._address):
            return
        self.heard += 1
        try:
            data, lines = self._answer_to(command)
        except RefusedError as refusal:
            self._answer(command, accepted=False, data=str(refusal))
            return
        self._answer(command, accepted=True, data=data)
        for line in lines:
            self._tell("#", f"{self._head(command)} {line}")

    def _answer_to(self, command: Command) -> Told:
        if command.axis > 1:
            raise RefusedError("BADAXIS")
        if not command.words:
            return _DONE
        if command.words[0] not in self._commands:
            raise RefusedError("BADCOMMAND")
        return self._commands[command.words[0]](command.words[1:])

    def _head(self, command: Command) -> str:
        message_id = "" if command.message_id is None else f" {command.message_id}"
        return f"{self._address:02d} {command.axis}{message_id}"

    def _answer(self, command: Command, *, accepted: bool, data: str) -> None:
        flag = "OK" if accepted else "RJ"
        self._tell("@", f"{self._head(command)} {flag} {self._state()} {self._worst_flag()} {data}")

    def _tell(self, kind: str, text: str) -> None:
        check = f":{checksum(text)}" if self._settings.is_on("comm.checksum") else ""
        self._say(f"{kind}{text}{check}\r\n".encode("ascii"))

    def _state(self) -> str:
        return "BUSY" if self._appointment or self._goes_on else "IDLE"

    def _worst_flag(self) -> str:
        return min(self._flags, key=lambda flag: ("FWN".index(flag[0]), flag), default="--")

    def _get(self, words: tuple[str, ...]) -> Told:
        """Report one or several settings, each after its axis."""
        if words and words[0] in ("0", "1"):
            words = words[1:]
        values = [self._settings.get(word) for word in words]
        known = [value for value in values if value is not None]
        if not words or len(known) < len(values) or len(values) > self._settings.number("get.settings.max"):
            raise RefusedError("BADCOMMAND")
        return " ; ".join(known), []

    def _set(self, words: tuple[str, ...]) -> Told:
        problem = self._settings.set(*words) if len(words) == 2 else "BADCOMMAND"
        if problem is not None:
            raise RefusedError(problem)
        return _DONE

    def _warnings(self, words: tuple[str, ...]) -> Told:
        told = " ".join([f"{len(self._flags):02d}", *sorted(self._flags)])
        if words == ("clear",):
            self._flags &= _LASTING
        return told, []

    def _park(self, words: tuple[str, ...]) -> Told:
        if words not in (("parking", "park"), ("parking", "unpark")):
            raise RefusedError("BADCOMMAND")
        if self._state() == "BUSY":
            raise RefusedError("STATUSBUSY")
        self._settings.is_parked = words[1] == "park"
        return _DONE

    def _switch_driver(self, words: tuple[str, ...]) -> Told:
        if words == ("disable",):
            self._stop()
            self._flags.add(_DISABLED)
        elif words == ("enable",):
            self._flags.discard(_DISABLED)
        else:
            raise RefusedError("BADCOMMAND")
        return _DONE

    def _renumber(self, words: tuple[str, ...]) -> Told:
        """Set its address; without a number, the first, as in a chain of one."""
        number = words[0] if words else str(_BORN_ADDRESS)
        if len(words) > 1 or not number.isdecimal() or not 1 <= int(number) <= _LAST_ADDRESS:
            raise RefusedError("BADDATA")
        self._address = int(number)
        return _DONE

    def _restore(self, words: tuple[str, ...]) -> Told:
        """Restore the default settings."""
        if words not in (("restore",), ("reset",)):
            raise RefusedError("BADCOMMAND")
        if words == ("restore",):
            self._settings.restore()
        return _DONE

    def _tell_lines(self, words: tuple[str, ...]) -> Told:
        """Tell that it has no lines in or out."""
        if words != ("info",):
            raise RefusedError("BADCOMMAND")
        return "0 0 0 0", []

    def _require_able(self) -> None:
        if self._settings.is_parked:
            raise RefusedError("PARKED")
        if _DISABLED in self._flags:
            raise RefusedError("DRIVERDISABLED")

    def _home(self, _words: tuple[str, ...]) -> Told:
        self._require_able()
        end_s = self._drive.home(self._now_s, clockwise=True, speed_deg_per_s=self._speed())
        self._flags.discard(_STALLED)
        self._begin(end_s, self._find_mark)
        return _DONE

    def _move(self, words: tuple[str, ...]) -> Told:
        self._require_able()
        if words[:1] == ("vel",):
            return self._move_on(words[1:])
        counts = self._target(words)
        if counts is None:
            raise RefusedError("BADDATA")
        end_s, outcome = self._drive.move(self._now_s, counts, speed_deg_per_s=self._speed())
        keep: dict[Outcome, Callable[[], None]] = {
            "arrives": self._rest,
            "stalls": lambda: self._fail(_STALLED),
            "is turned by hand": self._turn_by_hand,
            "fails": lambda: self._fail(str((self._options.fault or ("FF", 0))[0])),
        }
        self._begin(end_s + (_BUSY_FOR_NO_REASON_S if self._options.busy else 0.0), keep[outcome])
        return _DONE

    def _move_on(self, words: tuple[str, ...]) -> Told:
        """Turn at a speed until it is stopped."""
        if len(words) != 1 or not words[0].removeprefix("-").isdecimal():
            raise RefusedError("BADDATA")
        speed = self._settings.speed_deg_per_s(int(words[0]))
        if speed == 0.0:
            return self._stop()
        self._drive.turn_on(self._now_s, forward=speed > 0.0, speed_deg_per_s=abs(speed))
        self._appointment, self._goes_on = None, True
        return _DONE

    def _target(self, words: tuple[str, ...]) -> int | None:
        """Return the target of a move command [microsteps], or None if it is invalid."""
        lowest, highest = self._settings.number("limit.min"), self._settings.number("limit.max")
        if words in (("min",), ("max",)):
            return lowest if words == ("min",) else highest
        if len(words) != 2 or not words[1].removeprefix("-").isdecimal():
            return None
        number = int(words[1])
        places = {
            "abs": number,
            "rel": self._drive.ring.counts(self._now_s) + number,
            "index": (number - 1) * self._settings.number("motion.index.dist") if number > 0 else None,
        }
        counts = places.get(words[0])
        return counts if counts is not None and lowest <= counts <= highest else None

    def _begin(self, end_s: float, end: Callable[[], None]) -> None:
        self._goes_on = False
        self._appointment = (end_s, end)

    def _stop(self) -> Told:
        if self._state() == "BUSY":
            self._drive.ring.halt(self._now_s)
            self._flags.add(_INTERRUPTED)
            self._appointment, self._goes_on = None, False
        return _DONE

    def _find_mark(self) -> None:
        if not self._options.unhomed:
            self._flags.discard(_NO_REFERENCE)
        self._rest()

    def _fail(self, flag: str) -> None:
        self._flags.add(flag)
        self._rest()

    def _turn_by_hand(self) -> None:
        self._flags.add(_BY_HAND)
        self._appointment = (self._drive.turn_by_hand(self._now_s), self._rest)

    def _rest(self) -> None:
        if self._settings.is_on("comm.alert"):
            self._tell("!", f"{self._address:02d} 1 {self._state()} {self._worst_flag()}")

    def _speed(self) -> float:
        return min(self._options.motor_deg_per_s, self._settings.top_speed_deg_per_s())
