"""Questions to an archive: comparisons of columns with numbers and texts, joined by and, or, not, to bound SQL."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from rigctl.archive.columns import BY_NAME, VERDICTS
from rigctl.errors import ConfigError

_TOKEN = re.compile(
    r"\s*(?:(?P<text>'[^']*'|\"[^\"]*\")|(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"|(?P<sign><=|>=|!=|<|>|=)|(?P<bracket>[()])|(?P<word>[A-Za-z_]\w*))"
)
_WORDS = ("and", "or", "not")
# Brackets within brackets: more no person writes.
_DEEPEST = 50


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A condition of SQL with the values that are bound to its places, never written into it."""

    sql: str
    values: tuple[str | float, ...]


@dataclass(frozen=True, kw_only=True)
class _Token:
    kind: str
    text: str
    place: int


def parse(expression: str) -> Condition:
    """Return the condition that an expression states.

    Parameters
    ----------
    expression : str
        Such as ``sun_zenith < 40 and region = 'asphalt' and not verdict = 'agrees'``.

    Raises
    ------
    ConfigError
        It cannot be read; names a column that there is not; or compares a number with a text.
    """
    reader = _Reader(expression, _tokens(expression))
    found = reader.any_of(0)
    reader.require_end()
    return found


def _tokens(expression: str) -> list[_Token]:
    found, place = [], 0
    while expression[place:].strip():
        match = _TOKEN.match(expression, place)
        if match is None:
            blank = len(expression[place:]) - len(expression[place:].lstrip())
            raise _problem(expression, place + blank, "cannot be read here")
        kind = str(match.lastgroup)
        text = match.group(kind)
        word = kind == "word" and text.lower() in _WORDS
        found.append(
            _Token(kind="join" if word else kind, text=text.lower() if word else text, place=match.start(kind))
        )
        place = match.end()
    return found


def _problem(expression: str, place: int, what: str) -> ConfigError:
    return ConfigError(
        f"EXPR: {expression!r}, at character {place + 1}: {what}; write for instance "
        "sun_zenith < 40 and region = 'asphalt' and verdict = 'disagrees'"
    )


class _Reader:
    """Reads tokens from left to right: `or` of `and` of `not` of comparisons."""

    def __init__(self, expression: str, tokens: Sequence[_Token]) -> None:
        self._expression, self._tokens, self._next = expression, tokens, 0

    def any_of(self, depth: int) -> Condition:
        """Return conditions joined by or."""
        return self._joined("or", self._all_of, depth)

    def _all_of(self, depth: int) -> Condition:
        return self._joined("and", self._one, depth)

    def _joined(self, word: str, part: Callable[[int], Condition], depth: int) -> Condition:
        found = [part(depth)]
        while self._taken("join", word):
            found.append(part(depth))
        if len(found) == 1:
            return found[0]
        sql = f" {word.upper()} ".join(f"({one.sql})" for one in found)
        return Condition(sql=sql, values=tuple(value for one in found for value in one.values))

    def _one(self, depth: int) -> Condition:
        if depth > _DEEPEST:
            raise self._wrong(f"more than {_DEEPEST} brackets or nots within each other")
        if self._taken("join", "not"):
            found = self._one(depth + 1)
            return Condition(sql=f"NOT ({found.sql})", values=found.values)
        if self._taken("bracket", "("):
            found = self.any_of(depth + 1)
            if not self._taken("bracket", ")"):
                raise self._wrong("a closing bracket is missing")
            return found
        return self._comparison()

    def _comparison(self) -> Condition:
        name = self._required("word", "a column is wanted").text
        if name not in BY_NAME:
            close = get_close_matches(name, BY_NAME, n=3, cutoff=0.6)
            meant = f"did you mean {', '.join(close)}? " if close else ""
            raise ConfigError(f"EXPR: there is no column {name!r}; {meant}there are {', '.join(BY_NAME)}")
        sign = self._required("sign", "one of < <= > >= = != is wanted").text
        value = self._value(name)
        return Condition(sql=f'"{name}" {sign} ?', values=(value,))

    def _value(self, name: str) -> str | float:
        token = self._tokens[self._next] if self._next < len(self._tokens) else None
        kind = BY_NAME[name].kind
        if token is None or token.kind not in ("text", "number"):
            raise self._wrong("a number, or a text in quotes, is wanted")
        if (token.kind == "text") != (kind == "text"):
            wanted = "a text: put it into quotes" if kind == "text" else "a number, without quotes"
            raise self._wrong(f"{name} is compared with {wanted}")
        self._next += 1
        if token.kind == "text":
            text = token.text[1:-1]
            return VERDICTS.get(text, text) if name.endswith("verdict") else text
        number = float(token.text)
        if not math.isfinite(number):
            raise self._wrong(f"{token.text} is too large")
        return number

    def require_end(self) -> None:
        """Refuse what stands behind a whole expression."""
        if self._next < len(self._tokens):
            raise self._wrong("and, or, or the end is wanted")

    def _taken(self, kind: str, text: str) -> bool:
        token = self._tokens[self._next] if self._next < len(self._tokens) else None
        if token is None or (token.kind, token.text) != (kind, text):
            return False
        self._next += 1
        return True

    def _required(self, kind: str, what: str) -> _Token:
        token = self._tokens[self._next] if self._next < len(self._tokens) else None
        if token is None or token.kind != kind:
            raise self._wrong(what)
        self._next += 1
        return token

    def _wrong(self, what: str) -> ConfigError:
        at_end = self._next >= len(self._tokens)
        return _problem(self._expression, len(self._expression) if at_end else self._tokens[self._next].place, what)
