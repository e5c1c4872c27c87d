"""Secrets and names taken out of what is passed on to others: addresses on the web, tokens, users, the machine."""

import getpass
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rigctl.console.json_text import Json

LEFT_OUT = "left out"
# Names that say nothing of anybody.
_PLAIN_NAMES = frozenset({"root", "user", "pi", "home", "admin", "localhost", ""})
_LEAST_NAME = 3
_URL = re.compile(r"\b[a-zA-Z][a-zA-Z0-9+.-]*://[^\s\"'<>]+")
_MAIL = re.compile(r"\b[\w.+-]+@[\w-]+(?:\.[\w-]+)+\b")
_HOME = re.compile(r"(/(?:home|Users|media|run/media)/)[^/\s\"',:;]+")
# A word that names a secret, and what follows it: token=..., "password": "...", Authorization: Bearer ...
_NAMED_SECRET = re.compile(
    r"(?i)([\"']?[\w.-]*(?:token|passw(?:or)?d|passphrase|secret|api[_-]?key|authorization|credential|cookie)[\w.-]*"
    r"[\"']?\s*(?:=|:|\s)\s*)(?:(?:bearer|basic|token)\s+)?(\"[^\"]*\"|'[^']*'|[^\s,;&\"')\]}]+)"
)
_BEARER = re.compile(r"(?i)\b(bearer|basic)\s+[\w.~+/=-]{6,}")
# Keys whose whole value goes, whatever it holds.
_SECRET_KEY = re.compile(r"(?i)token|passw|passphrase|secret|api_?key|authorization|credential|cookie")
_SECRET_TABLES = frozenset({"notify"})
_SECRET_OPTIONS = frozenset({"command", "webhook", "ask"})
_HEADER = re.compile(r"^\s*\[{1,2}\s*([\w.\"-]+)\s*\]{1,2}")
_ASSIGNED = re.compile(r"^(\s*)([\w.\"-]+)(\s*=)")


@dataclass(frozen=True, kw_only=True)
class Scrubber:
    """Takes out of texts what is nobody else's business.

    Attributes
    ----------
    names : tuple of (str, str)
        Words of this machine and its user, and what stands in their place.
    """

    names: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of_this_machine(cls) -> "Scrubber":
        """Return one that knows the names of this machine and of whoever works at it."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = ""
        host = platform.node()
        known = {Path.home().name: "USER", user: "USER", host: "MACHINE", host.partition(".")[0]: "MACHINE"}
        told = ((word, instead) for word, instead in known.items() if len(word) >= _LEAST_NAME)
        return cls(names=tuple(sorted((one for one in told if one[0] not in _PLAIN_NAMES), key=lambda p: -len(p[0]))))

    def text(self, text: str) -> str:
        """Return a text without secrets and names."""
        text = _URL.sub(LEFT_OUT, text)
        text = _NAMED_SECRET.sub(rf"\g<1>{LEFT_OUT}", text)
        text = _BEARER.sub(LEFT_OUT, text)
        text = _MAIL.sub(LEFT_OUT, text)
        text = _HOME.sub(r"\g<1>USER", text)
        for word, instead in self.names:
            text = re.sub(rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])", instead, text)
        return text

    def content(self, content: Json) -> Json:
        """Return what JSON holds, without secrets and names."""
        if isinstance(content, Mapping):
            return {str(key): self._value(str(key), value) for key, value in content.items()}
        if isinstance(content, list | tuple):
            return [self.content(value) for value in content]
        return self.text(content) if isinstance(content, str) else content

    def toml(self, text: str) -> str:
        """Return a file that a person wrote, without secrets and names; its comments are kept."""
        lines, table, depth = [], "", 0
        for line in text.splitlines():
            header = _HEADER.match(line)
            if header is not None and depth == 0:
                table = header[1]
            assigned = _ASSIGNED.match(line)
            is_secret = depth > 0 or (assigned is not None and header is None and _is_secret(table, assigned[2]))
            if not is_secret:
                lines.append(self.text(line))
                continue
            if depth == 0 and assigned is not None:
                lines.append(f'{assigned[1]}{assigned[2]}{assigned[3]} "{LEFT_OUT}"')
            # A value may go on in the next lines: all of them go.
            depth = max(0, depth + sum(line.count(one) for one in "[{") - sum(line.count(one) for one in "]}"))
        return "\n".join([*lines, ""])

    def _value(self, key: str, value: Json) -> Json:
        if value is not None and (key in _SECRET_TABLES or _SECRET_KEY.search(key) or key in _SECRET_OPTIONS):
            return LEFT_OUT
        return self.content(value)


def _is_secret(table: str, key: str) -> bool:
    last = table.rpartition(".")[2].strip('"')
    if last in _SECRET_TABLES or table.partition(".")[0] in _SECRET_TABLES:
        return True
    # Options of a monitor may stand in one line with what it asks and whom.
    is_options = table.partition(".")[0] == "monitors" and key in ("options", *_SECRET_OPTIONS)
    return is_options or key in _SECRET_TABLES or bool(_SECRET_KEY.search(key)) or key in ("command", "webhook")
