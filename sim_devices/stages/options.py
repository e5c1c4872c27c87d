"""Properties and faults of a simulated stage, and the address that states them: ``sim:ellx?stall=3&busy=1``."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl


@dataclass(frozen=True, kw_only=True)
class StageOptions:
    """Motor, bearing and line of any stage, and their faults. Moves count from 1, without homing."""

    motor_deg_per_s: float  #: Fastest turn.
    landing_deg: float  #: Standard deviation of the end of a move about its target (assumed).
    mark_deg: float = 0.0  #: Angle in the housing of the reference mark, and at power-up.
    start_deg: float = 77.7
    backlash_deg: float = 0.0  #: Difference between the ends of moves from both sides.
    #: Remaining way at the end of a motion; the ring creeps on with a time constant of 0.1 s.
    creep_deg: float = 0.0
    #: The stage reports busy after a motion has ended, or before it reports a position.
    busy: bool = False
    stall: int | None = None  #: Number of the move that stalls half-way.
    button: int | None = None  #: Number of the move after which the stage is turned by hand.
    #: A fault in the device's own code, and the number of the move that ends with it.
    fault: tuple[int | str, int] | None = None
    unhomed: bool = False  #: Homing is never confirmed.
    minus_one: bool = False  #: A move ends one count below its target, so that one to 0 ends at -1.
    drop: float = 0.0  #: Probability in both directions that a byte is lost, doubled, or has a changed bit.
    double: float = 0.0
    flip: float = 0.0
    late_s: float = 0.0  #: Delay of every third reply.
    pieces: bool = False  #: Replies arrive in pieces of two bytes.
    pace: bool = False  #: Bytes come at the line's bit rate.
    silent: int | None = None  #: Number of the first command (from 1) without an answer.
    vanish: int | None = None  #: Number of the command at which the port disappears, as if unplugged.
    back_s: float = 2.0  #: Time without the port.
    seed: int = 0  #: Seed of all random numbers.
    speed: float = 1.0  #: Simulated seconds per second of the wall clock.

    @property
    def counts_per_turn(self) -> float:
        """Encoder counts of a turn of the ring."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Key:
    """One key of an address."""

    option: str  #: Field of the stage's options.
    meaning: str  #: Its effect, for people.
    allowed: str  #: Its values, for people.
    read: Callable[[str], Any]  #: Text to value; raises ValueError if not allowed.


def number(option: str, meaning: str, lowest: float, highest: float) -> Key:
    """Return a key whose value is a number."""

    def read(text: str) -> float:
        value = float(text)
        if not (math.isfinite(value) and lowest <= value <= highest):
            raise ValueError(text)
        return value

    return Key(option=option, meaning=meaning, allowed=f"a number from {lowest:.15g} to {highest:.15g}", read=read)


def whole(option: str, meaning: str, lowest: int, highest: int) -> Key:
    """Return a key whose value is a whole number, decimal or hexadecimal (``0x...``)."""

    def read(text: str) -> int:
        value = int(text, 0)
        if not lowest <= value <= highest:
            raise ValueError(text)
        return value

    return Key(option=option, meaning=meaning, allowed=f"a whole number from {lowest} to {highest}", read=read)


def one_of(option: str, meaning: str, choices: Mapping[str, object]) -> Key:
    """Return a key with words for its values."""

    def read(text: str) -> object:
        if text not in choices:
            raise ValueError(text)
        return choices[text]

    return Key(option=option, meaning=meaning, allowed=f"one of {', '.join(choices)}", read=read)


def flag(option: str, meaning: str) -> Key:
    """Return a key whose value is 0 or 1."""
    return one_of(option, f"1: {meaning}", {"0": False, "1": True})


def fault_key(read_code: Callable[[str], int | str], *, codes: str) -> Key:
    """Return the key for a fault of a family: ``CODE@MOVE``."""

    def read(text: str) -> tuple[int | str, int]:
        code, _, move = text.partition("@")
        if int(move) < 1:
            raise ValueError(text)
        return read_code(code), int(move)

    return Key(
        option="fault", meaning="a fault at the end of a move", allowed=f"CODE@MOVE, CODE being {codes}", read=read
    )


COMMON_KEYS: dict[str, Key] = {
    "slow": number("motor_deg_per_s", "speed of a move [deg/s]", 0.001, 10000),
    "landing": number("landing_deg", "standard deviation of the landing error [deg]", 0, 180),
    "mark": number("mark_deg", "angle in the housing of the reference mark [deg]", -360, 360),
    "start": number("start_deg", "angle in the housing at power-up [deg]", -360, 360),
    "backlash": number("backlash_deg", "moves from either side land this far apart [deg]", 0, 10),
    "creep": number("creep_deg", "what a motion leaves to creeping, time constant 0.1 s [deg]", 0, 10),
    "busy": flag("busy", "says busy before or after a motion for no reason"),
    "stall": whole("stall", "number of the move that stalls", 1, 10**9),
    "button": whole("button", "number of the move at whose end a hand turns the stage", 1, 10**9),
    "unhomed": flag("unhomed", "homing is never confirmed"),
    "minus": flag("minus_one", "moves end one count low"),
    "drop": number("drop", "probability that a byte is lost", 0, 1),
    "double": number("double", "probability that a byte is doubled", 0, 1),
    "flip": number("flip", "probability that a bit of a byte is changed", 0, 1),
    "late": number("late_s", "delay of every third reply [s]", 0, 600),
    "pieces": flag("pieces", "replies arrive in pieces of two bytes"),
    "pace": flag("pace", "bytes come as slowly as the bit rate makes them"),
    "silent": whole("silent", "number of the command from which on nothing answers", 1, 10**9),
    "vanish": whole("vanish", "number of the command at which the port vanishes", 1, 10**9),
    "back": number("back_s", "how long a vanished port stays away [s]", 0, 10**6),
    "seed": whole("seed", "of all that is random", 0, 10**9),
    "speed": number("speed", "simulated seconds in a second", 0.001, 10**6),
}


def read_address(text: str, keys: Mapping[str, Key]) -> dict[str, Any]:
    """Return the options that an address sets."""
    scheme, _, query = text.partition("?")
    problems: list[str] = []
    values: dict[str, Any] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        key = keys.get(name)
        if key is None:
            problems.append(f"{name!r} is no key")
        elif key.option in values:
            problems.append(f"{name!r} stands twice")
        else:
            try:
                values[key.option] = key.read(value)
            except ValueError:
                problems.append(f"{name}={value}: must be {key.allowed}")
                values[key.option] = None
    if problems:
        allowed = "\n".join(f"  {name}= {key.meaning}: {key.allowed}" for name, key in keys.items())
        raise ValueError(f"stage address {text!r}: {'; '.join(problems)}. Allowed after {scheme}? are\n{allowed}")
    return values
