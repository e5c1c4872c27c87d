"""Triggers and stored texts of a simulated Zaber stage: kept and told; its triggers do not fire."""

from dataclasses import dataclass, field

Told = tuple[str, list[str]]
"""Data of a reply, and the lines that follow it."""

_ACTIONS = ("a", "b")
_ENDLESS = -1


class RefusedError(Exception):
    """A command that cannot be obeyed; its text is the reason as the protocol has it."""


@dataclass(kw_only=True)
class _Trigger:
    """A trigger: when, what, and how often yet; 0 for never."""

    when: str = "none"
    actions: dict[str, str] = field(default_factory=lambda: dict.fromkeys(_ACTIONS, "none"))
    fires: int = 0

    def lines(self) -> list[str]:
        """Return the commands that make it again."""
        enabled = "disable" if not self.fires else "enable" if self.fires == _ENDLESS else f"enable {self.fires}"
        actions = [f"action {letter} {what}" for letter, what in self.actions.items()]
        return [f"when {self.when}", *actions, enabled]

    def state(self) -> str:
        """Return whether it is enabled, or how often it will fire yet."""
        return "d" if not self.fires else "e" if self.fires == _ENDLESS else str(self.fires)


class ZaberTriggers:
    """All triggers of a device."""

    def __init__(self, count: int) -> None:
        self._triggers = [_Trigger() for _ in range(count)]

    def obey(self, words: tuple[str, ...]) -> Told:
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
        return self._obey_one(self._triggers[int(words[0]) - 1], words[1], words[2:])

    def _obey_one(self, trigger: _Trigger, verb: str, words: tuple[str, ...]) -> Told:
        if verb == "print" and not words:
            return "0", trigger.lines()
        if verb == "when" and words:
            trigger.when = " ".join(words)
        elif verb == "action" and len(words) > 1 and words[0] in _ACTIONS:
            trigger.actions[words[0]] = " ".join(words[1:])
        elif verb == "action" and words == ("none",):
            trigger.actions = dict.fromkeys(_ACTIONS, "none")
        elif verb == "enable" and len(words) <= 1 and all(word.isdecimal() for word in words):
            trigger.fires = int(words[0]) if words else _ENDLESS
        elif verb == "disable" and not words:
            trigger.fires = 0
        else:
            raise RefusedError("BADDATA")
        return "0", []


class ZaberStorage:
    """Texts under keys, of the device and of its axis."""

    def __init__(self) -> None:
        self._texts: dict[str, dict[str, str]] = {"": {}, "axis ": {}}

    def obey(self, words: tuple[str, ...]) -> Told:
        """Return what ``storage ...`` is answered.

        Raises
        ------
        RefusedError
            There is no such command, or nothing under that key.
        """
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
        """Return the keys, or the commands that set them again, of those that begin alike."""
        prefix = words[words.index("prefix") + 1] if "prefix" in words[:-1] else ""
        chosen = {key: text for key, text in self._texts[scope].items() if key.startswith(prefix)}
        if "keys" in words:
            return [f"set {key}" for key in chosen]
        return [f"{scope}set {key} {text}" for key, text in chosen.items()]
