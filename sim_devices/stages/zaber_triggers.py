"""Triggers of a simulated Zaber stage: kept, told, and fired, from a reading of Zaber's ASCII protocol manual.

An enabled trigger fires when its condition becomes true, at once where it is true already. The device looks each
millisecond while it turns. It has no lines: what waits for one never fires.
"""

import math
import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from sim_devices.stages.zaber_memory import RefusedError, Told

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
    """A trigger: when, what, and how often yet (0 for never); and what it has seen since it was enabled."""

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
        """Return whether it is enabled, or how often it will fire yet."""
        return "d" if not self.fires else "e" if self.fires == _ENDLESS else str(self.fires)

    @property
    def period_s(self) -> float | None:
        """From one firing to the next, where it fires by time."""
        return int(self.when[1]) / _MS_PER_S if self.when[0] == "time" else None

    @property
    def distance(self) -> int | None:
        """Microsteps from one firing to the next, where it fires by distance."""
        return int(self.when[-1]) if self.when[-2:-1] == ("dist",) else None


class ZaberTriggers:
    """All triggers of a device.

    Parameters
    ----------
    count : int
        How many it has.
    value_of : callable
        The value of a setting as text; None where there is none of that name.
    """

    def __init__(self, count: int, value_of: Callable[[str], str | None]) -> None:
        self._triggers = [_Trigger() for _ in range(count)]
        self._value_of = value_of

    def obey(self, words: tuple[str, ...], now_s: float) -> Told:
        """Return what ``trigger ...`` is answered.

        Raises
        ------
        RefusedError
            There is no such trigger, or no such command.
        """
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
        """Return when they have to be looked at next, if nobody says anything; None for never."""
        enabled = [trigger for trigger in self._triggers if trigger.fires]
        times_s = [trigger.next_s for trigger in enabled if trigger.period_s is not None]
        if is_moving and len(times_s) < len(enabled):
            # The thousandth part: 1.001 s are 1000.9999 looks.
            times_s.append((math.floor(now_s * _LOOKS_HZ + 1e-3) + 1) / _LOOKS_HZ)
        return min(times_s, default=None)

    def fired(self, now_s: float) -> Iterator[tuple[str, ...]]:
        """Give what is to be done now, trigger by trigger, action by action."""
        for trigger in self._triggers:
            if trigger.fires and self._is_due(trigger, now_s):
                trigger.fires -= trigger.fires != _ENDLESS
                yield from (what for what in trigger.actions.values() if what != ("none",))

    def _is_due(self, trigger: _Trigger, now_s: float) -> bool:
        """Return whether a trigger fires now, and note that it did."""
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
        """Return whether the setting of a condition such as ``1 pos > 100`` or ``1 abs pos > 100`` is that."""
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
    """Return whether words are a condition; times and distances are whole numbers from 1 on."""
    counted = words[:1] == ("time",) or words[-2:-1] == ("dist",)
    return bool(words) and (not counted or (len(words) > 1 and words[-1].isdecimal() and int(words[-1]) > 0))
