"""Texts that a simulated Zaber stage keeps under keys, and what its commands come to."""

Told = tuple[str, list[str]]
"""Data of a reply, and the lines that follow it."""


class RefusedError(Exception):
    """A command that cannot be obeyed; its text is the reason as the protocol has it."""


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
