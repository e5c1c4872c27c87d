"""Answers of a simulated Zaber stage, from a reading of Zaber's ASCII protocol manual (firmware 6 and 7)."""

import operator
from collections.abc import Callable
from contextlib import suppress

from sim_devices.stages.drive import Drive, Outcome
from sim_devices.stages.simulated_stage import Reply
from sim_devices.stages.zaber_address import ZaberOptions
from sim_devices.stages.zaber_memory import RefusedError, Told, ZaberStorage
from sim_devices.stages.zaber_receiver import Command, ZaberReceiver, checksum
from sim_devices.stages.zaber_settings import ZaberSettings
from sim_devices.stages.zaber_triggers import ZaberTriggers

_BORN_ADDRESS, _LAST_ADDRESS = 1, 99
_STALLED, _DISABLED, _NO_REFERENCE, _INTERRUPTED, _BY_HAND = "FS", "FO", "WR", "NI", "NC"
_LASTING = frozenset({_NO_REFERENCE, _DISABLED})
_BUSY_FOR_NO_REASON_S = 0.3
_DONE: Told = ("0", [])
# What a trigger's action does to a setting.
_CHANGES: dict[str, Callable[[int, int], int]] = {"=": lambda _, by: by, "+=": operator.add, "-=": operator.sub}


class ZaberLanguage:
    """The stage's side of the conversation. The time is an argument, and never goes back."""

    def __init__(self, options: ZaberOptions, drive: Drive) -> None:
        self._options = options
        self._drive = drive
        self._receiver = ZaberReceiver()
        self._now_s = 0.0
        self._settings = ZaberSettings(options, lambda: self._drive.ring.counts(self._now_s), lambda: self._now_s)
        self._triggers = ZaberTriggers(self._settings.number("trigger.numtriggers"), self._settings.get)
        self._storage = ZaberStorage()
        self._address = _BORN_ADDRESS
        self._flags = {_NO_REFERENCE}
        self.heard = 0
        self._goes_on = False
        self._appointment: tuple[float, Callable[[], None]] | None = None
        self._replies: list[Reply] = []
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
        """The first words of all commands that it knows."""
        return frozenset(self._commands)

    def receive(self, time_s: float, data: bytes) -> list[Reply]:
        """Return the replies up to a time [s] at which these bytes arrive."""
        self._live_until(time_s)
        for command in self._receiver.receive(data):
            self._obey(command)
            self._fire()
        return self._take_replies()

    def advance(self, time_s: float) -> list[Reply]:
        """Return the replies up to a time [s]."""
        self._live_until(time_s)
        return self._take_replies()

    def next_event_s(self) -> float | None:
        """Return when the stage does something unasked, or None."""
        due_s = self._triggers.due_s(self._now_s, is_moving=self._drive.ring.is_moving(self._now_s))
        times_s = [] if due_s is None else [due_s]
        return min([*times_s, *([self._appointment[0]] if self._appointment else [])], default=None)

    def _take_replies(self) -> list[Reply]:
        replies, self._replies = self._replies, []
        return replies

    def _live_until(self, time_s: float) -> None:
        while (event_s := self.next_event_s()) is not None and event_s <= time_s:
            self._now_s = max(self._now_s, event_s)
            if self._appointment and self._appointment[0] <= self._now_s:
                (_, keep), self._appointment = self._appointment, None
                keep()
            self._fire()
        self._now_s = max(self._now_s, time_s)

    def _fire(self) -> None:
        """Do what triggers have to be done now; what cannot be is left, as nobody waits for an answer."""
        for action in self._triggers.fired(self._now_s):
            words = action[1:] if action[0] in ("0", "1") else action
            with suppress(RefusedError):
                if words[1:2] and words[1] in _CHANGES:
                    self._change(words[0], _CHANGES[words[1]], words[2:])
                elif words[0] in self._commands:
                    self._commands[words[0]](words[1:])

    def _change(self, name: str, change: Callable[[int, int], int], words: tuple[str, ...]) -> None:
        """Set a setting to a number or to another setting, or change it by that."""
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
            self._say("#", f"{self._head(command)} {line}")

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
        self._say("@", f"{self._head(command)} {flag} {self._state()} {self._worst_flag()} {data}")

    def _say(self, kind: str, text: str) -> None:
        silent = self._options.line.silent
        if silent is None or self.heard < silent:
            check = f":{checksum(text)}" if self._settings.is_on("comm.checksum") else ""
            self._replies.append((self._now_s, f"{kind}{text}{check}\r\n".encode("ascii")))

    def _state(self) -> str:
        return "BUSY" if self._appointment or self._goes_on else "IDLE"

    def _worst_flag(self) -> str:
        return min(self._flags, key=lambda flag: ("FWN".index(flag[0]), flag), default="--")

    def _get(self, words: tuple[str, ...]) -> Told:
        """Tell one setting, or several at once, behind the axis that they are of."""
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
        """Take a number; without one, as it counts along the chain, the first."""
        number = words[0] if words else str(_BORN_ADDRESS)
        if len(words) > 1 or not number.isdecimal() or not 1 <= int(number) <= _LAST_ADDRESS:
            raise RefusedError("BADDATA")
        self._address = int(number)
        return _DONE

    def _restore(self, words: tuple[str, ...]) -> Told:
        """Make the settings what they were when it came."""
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
        ending = self._drive.move(self._now_s, counts, speed_deg_per_s=self._speed())
        keep: dict[Outcome, Callable[[], None]] = {
            "arrives": self._rest,
            "stalls": lambda: self._fail(_STALLED),
            "is turned by hand": self._turn_by_hand,
            "fails": lambda: self._fail(str((self._options.motion.fault or ("FF", 0))[0])),
        }
        self._begin(ending.time_s + self._lag_s(), keep[ending.outcome])
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
        """Return where a move command leads [microsteps], or None when that is nowhere."""
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
        if self._settings.is_on("comm.alert"):
            self._say("!", f"{self._address:02d} 1 {self._state()} {self._worst_flag()}")

    def _lag_s(self) -> float:
        return _BUSY_FOR_NO_REASON_S if self._options.motion.busy else 0.0

    def _speed(self) -> float:
        return min(self._options.motion.motor_deg_per_s, self._settings.top_speed_deg_per_s())
