"""Options that simulated stages of every family share, and their form as an address: ``sim:ellx?stall=3&busy=1``."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar
from urllib.parse import parse_qsl

Values = dict[str, dict[str, Any]]
"""Group of options -> option -> value."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """One key of an address."""

    group: str  #: Which option it sets: `StageOptions` are grouped.
    option: str
    meaning: str  #: What it does, and its values, for people.
    allowed: str
    read: Callable[[str], Any]  #: Text to value; raises ValueError for what is not allowed.


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
    """Return the options that an address sets, by group."""
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


CodeT = TypeVar("CodeT", int, str)


@dataclass(frozen=True, kw_only=True)
class LineOptions:
    """The line and what happens to it."""

    drop: float = 0.0  #: Probability that a byte is damaged, in both directions.
    double: float = 0.0
    flip: float = 0.0
    late_s: float = 0.0  #: How much later than sent every third reply arrives.
    #: Whether replies arrive in pieces of two bytes; whether bytes come as slowly as the line's bit rate makes them.
    pieces: bool = False
    pace: bool = False
    silent: int | None = None  #: Number of the command (from 1) from which on nothing is answered.
    vanish: int | None = None  #: Number of the command at which the port vanishes, as if its plug were pulled.
    back_s: float = 2.0  #: How long the port stays away.


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """The motor, its bearing, and what happens to moves. Moves count from 1, homing not counted."""

    motor_deg_per_s: float  #: Fastest turn.
    landing_deg: float  #: Standard deviation of where a move lands about its target (assumed).
    mark_deg: float = 0.0  #: Angle in the housing of the reference mark, and at power-up.
    start_deg: float = 77.7
    backlash_deg: float = 0.0  #: A move lands this much apart from where one from the other side lands.
    #: How far short of its rest the ring stands when the motion ends; it creeps on with a time constant of 0.1 s.
    creep_deg: float = 0.0
    #: Whether the stage says that it is busy although a motion has ended, or before it tells a position.
    busy: bool = False
    #: Number of the move that stalls half-way; at whose end somebody turns the stage by hand.
    stall: int | None = None
    button: int | None = None
    #: A fault in the device's own code, and the number of the move that ends with it.
    fault: tuple[int | str, int] | None = None
    unhomed: bool = False  #: Whether homing is never confirmed.
    minus_one: bool = False  #: Whether a move ends one count below its target, so that one to 0 ends at -1.


COMMON_KEYS: dict[str, Key] = {
    "slow": number("motion", "motor_deg_per_s", "speed of a move [deg/s]", 0.001, 10000),
    "landing": number("motion", "landing_deg", "standard deviation of the landing error [deg]", 0, 180),
    "mark": number("motion", "mark_deg", "angle in the housing of the reference mark [deg]", -360, 360),
    "start": number("motion", "start_deg", "angle in the housing at power-up [deg]", -360, 360),
    "backlash": number("motion", "backlash_deg", "moves from either side land this far apart [deg]", 0, 10),
    "creep": number("motion", "creep_deg", "what a motion leaves to creeping, time constant 0.1 s [deg]", 0, 10),
    "busy": flag("motion", "busy", "says busy before or after a motion for no reason"),
    "stall": whole("motion", "stall", "number of the move that stalls", 1, 10**9),
    "button": whole("motion", "button", "number of the move at whose end a hand turns the stage", 1, 10**9),
    "unhomed": flag("motion", "unhomed", "homing is never confirmed"),
    "minus": flag("motion", "minus_one", "moves end one count low"),
    "drop": number("line", "drop", "probability that a byte is lost", 0, 1),
    "double": number("line", "double", "probability that a byte is doubled", 0, 1),
    "flip": number("line", "flip", "probability that a bit of a byte is changed", 0, 1),
    "late": number("line", "late_s", "delay of every third reply [s]", 0, 600),
    "pieces": flag("line", "pieces", "replies arrive in pieces of two bytes"),
    "pace": flag("line", "pace", "bytes come as slowly as the bit rate makes them"),
    "silent": whole("line", "silent", "number of the command from which on nothing answers", 1, 10**9),
    "vanish": whole("line", "vanish", "number of the command at which the port vanishes", 1, 10**9),
    "back": number("line", "back_s", "how long a vanished port stays away [s]", 0, 10**6),
    "seed": whole("own", "seed", "of all that is random", 0, 10**9),
    "speed": number("own", "speed", "simulated seconds in a second", 0.001, 10**6),
}


def fault_key(read_code: Callable[[str], CodeT], *, codes: str) -> Key:
    """Return the key for a fault of a family: ``CODE@MOVE``."""

    def read(text: str) -> tuple[CodeT, int]:
        code, _, move = text.partition("@")
        if int(move) < 1:
            raise ValueError(text)
        return read_code(code), int(move)

    allowed = f"CODE@MOVE, CODE being {codes}"
    return Key(group="motion", option="fault", meaning="a fault at the end of a move", allowed=allowed, read=read)


def motion_options(values: Values, *, motor_deg_per_s: float, landing_deg: float) -> MotionOptions:
    """Return what an address says of the motion, with the speed and the landing error that the family has else."""
    own: dict[str, Any] = {"motor_deg_per_s": motor_deg_per_s, "landing_deg": landing_deg}
    return MotionOptions(**(own | values.get("motion", {})))


def line_options(values: Values) -> LineOptions:
    """Return what an address says of the line."""
    return LineOptions(**values.get("line", {}))
