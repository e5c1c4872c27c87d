"""Address of a simulated stage: a scheme, then ``?`` and ``key=value`` pairs joined by ``&``."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl

Values = dict[str, dict[str, Any]]
"""Group of options -> option -> value."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """One key of an address.

    Attributes
    ----------
    group, option : str
        Which option it sets: `StageOptions` are grouped.
    meaning, allowed : str
        What it does, and its values, for people.
    read : callable
        Text to value; raises ValueError for what is not allowed.
    """

    group: str
    option: str
    meaning: str
    allowed: str
    read: Callable[[str], Any]


def number(group: str, option: str, meaning: str, lowest: float, highest: float) -> Key:
    """Return a key whose value is a number."""

    def read(text: str) -> float:
        value = float(text)
        if not (math.isfinite(value) and lowest <= value <= highest):
            raise ValueError(text)
        return value

    allowed = f"a number from {lowest:.15g} to {highest:.15g}"
    return Key(group=group, option=option, meaning=meaning, allowed=allowed, read=read)


def whole(group: str, option: str, meaning: str, lowest: int, highest: int) -> Key:
    """Return a key whose value is a whole number, decimal or hexadecimal (``0x...``)."""

    def read(text: str) -> int:
        value = int(text, 0)
        if not lowest <= value <= highest:
            raise ValueError(text)
        return value

    allowed = f"a whole number from {lowest} to {highest}"
    return Key(group=group, option=option, meaning=meaning, allowed=allowed, read=read)


def flag(group: str, option: str, meaning: str) -> Key:
    """Return a key whose value is 0 or 1."""

    def read(text: str) -> bool:
        if text not in ("0", "1"):
            raise ValueError(text)
        return text == "1"

    return Key(group=group, option=option, meaning=f"1: {meaning}", allowed="a whole number from 0 to 1", read=read)


def one_of(group: str, option: str, meaning: str, choices: tuple[str, ...]) -> Key:
    """Return a key whose value is one of some words."""

    def read(text: str) -> str:
        if text not in choices:
            raise ValueError(text)
        return text

    return Key(group=group, option=option, meaning=meaning, allowed=f"one of {', '.join(choices)}", read=read)


def read_address(text: str, *, scheme: str, keys: Mapping[str, Key]) -> Values:
    """Return the options that an address sets, by group.

    Parameters
    ----------
    text : str
        The address.
    scheme : str
        What it must begin with, such as ``sim:ellx``.
    keys : dict
        What may follow.

    Raises
    ------
    ValueError
        The address is not of this form. The message names every problem and all that is allowed.
    """
    start, _, query = text.partition("?")
    problems = [] if start == scheme else [f"it begins with {start!r}, not {scheme!r}"]
    values: Values = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        try:
            _read_pair(key, value, keys, values)
        except ValueError as error:
            problems.append(str(error))
    if problems:
        allowed = "\n".join(f"  {key}= {entry.meaning}: {entry.allowed}" for key, entry in keys.items())
        raise ValueError(f"stage address {text!r}: {'; '.join(problems)}. Allowed after {scheme}? are\n{allowed}")
    return values


def _read_pair(key: str, text: str, keys: Mapping[str, Key], values: Values) -> None:
    if key not in keys:
        raise ValueError(f"{key!r} is no key")
    entry = keys[key]
    group = values.setdefault(entry.group, {})
    if entry.option in group:
        raise ValueError(f"{key!r} stands twice")
    try:
        group[entry.option] = entry.read(text)
    except ValueError as error:
        raise ValueError(f"{key}={text}: must be {entry.allowed}") from error
