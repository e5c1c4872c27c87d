"""What a simulated Elliptec stage is like, and how that is written as an address: ``sim:ellx?stall=3&busy=1``."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl

_SCHEME = "sim:ellx"


@dataclass(frozen=True, kw_only=True)
class EllxOptions:
    """A stage and its faults. The defaults are a sound ELL14.

    Attributes
    ----------
    model : int
        The number in the model's name.
    serial_number : int
        At most eight digits.
    pulses : int
        Encoder counts of a turn: 143360 in every ELL14 whose reply is public, 262144 in the manual's table.
    motor_deg_per_s : float
        Speed of a move.
    landing_deg : float
        Standard deviation of where a move lands about its target (assumed).
    mark_deg, start_deg : float
        Angle in the housing of the reference mark, and at power-up, when the encoder reads 0.
    busy : bool
        Whether a move is first answered by "busy".
    gap_s : float
        A move that is sent sooner than this after the last one ended goes to 0 instead.
    stall, button : int or None
        Number of the move (from 1, homing not counted) that stalls half-way; during which a button is pressed.
    silent : int or None
        Number of the command (from 1) from which on nothing is answered.
    late_s : float
        How much later than sent every third reply arrives.
    drop, double, flip : float
        Probability that a byte is damaged, in both directions.
    pieces, pace : bool
        Whether replies arrive in pieces of two bytes; whether bytes come as slowly as 9600 bits/s make them.
    seed : int
        Of all that is random.
    speed : float
        Simulated seconds in a second of the wall clock.
    """

    model: int = 14
    serial_number: int = 11401326
    pulses: int = 143360
    motor_deg_per_s: float = 430.0
    landing_deg: float = 0.004
    mark_deg: float = 0.0
    start_deg: float = 77.7
    busy: bool = False
    gap_s: float = 0.0
    stall: int | None = None
    button: int | None = None
    silent: int | None = None
    late_s: float = 0.0
    drop: float = 0.0
    double: float = 0.0
    flip: float = 0.0
    pieces: bool = False
    pace: bool = False
    seed: int = 0
    speed: float = 1.0


@dataclass(frozen=True)
class _Key:
    """One key of an address: the option that it sets, what it means, how it is read, and its range."""

    field: str
    meaning: str
    read: Callable[[str], float]
    lowest: float
    highest: float

    def range_in_words(self) -> str:
        """Return the allowed values."""
        kind = "a number" if self.read is float else "a whole number"
        return f"{kind} from {self.lowest:.15g} to {self.highest:.15g}"


def _whole(text: str) -> int:
    return int(text, 0)


def _flag(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError(text)
    return text == "1"


_KEYS = {
    "model": _Key("model", "number in the model's name", _whole, 1, 255),
    "serial": _Key("serial_number", "serial number", _whole, 0, 99999999),
    "pulses": _Key("pulses", "encoder counts of a turn", _whole, 1, 0x7FFFFFFF),
    "slow": _Key("motor_deg_per_s", "speed of a move [deg/s]", float, 0.001, 10000),
    "landing": _Key("landing_deg", "standard deviation of the landing error [deg]", float, 0, 180),
    "mark": _Key("mark_deg", "angle in the housing of the reference mark [deg]", float, -360, 360),
    "start": _Key("start_deg", "angle in the housing at power-up [deg]", float, -360, 360),
    "busy": _Key("busy", "1: moves are first answered by busy", _flag, 0, 1),
    "gap": _Key("gap_s", "a move sooner than this after the last goes to 0 [s]", float, 0, 60),
    "stall": _Key("stall", "number of the move that stalls", _whole, 1, 10**9),
    "button": _Key("button", "number of the move during which a button is pressed", _whole, 1, 10**9),
    "silent": _Key("silent", "number of the command from which on nothing answers", _whole, 1, 10**9),
    "late": _Key("late_s", "delay of every third reply [s]", float, 0, 600),
    "drop": _Key("drop", "probability that a byte is lost", float, 0, 1),
    "double": _Key("double", "probability that a byte is doubled", float, 0, 1),
    "flip": _Key("flip", "probability that a bit of a byte is changed", float, 0, 1),
    "pieces": _Key("pieces", "1: replies arrive in pieces of two bytes", _flag, 0, 1),
    "pace": _Key("pace", "1: bytes come as slowly as at 9600 bits/s", _flag, 0, 1),
    "seed": _Key("seed", "of all that is random", _whole, 0, 10**9),
    "speed": _Key("speed", "simulated seconds in a second", float, 0.001, 10**6),
}


def parse_address(text: str) -> EllxOptions:
    """Return the stage that an address describes.

    Parameters
    ----------
    text : str
        ``sim:ellx``, then optionally ``?`` and ``key=value`` pairs joined by ``&``.

    Raises
    ------
    ValueError
        The address is not of this form. The message names every problem and all that is allowed.
    """
    scheme, _, query = text.partition("?")
    problems = [] if scheme == _SCHEME else [f"it begins with {scheme!r}, not {_SCHEME!r}"]
    values: dict[str, Any] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        try:
            _read_pair(key, value, values)
        except ValueError as error:
            problems.append(str(error))
    if problems:
        raise ValueError(f"stage address {text!r}: {'; '.join(problems)}. Allowed after {_SCHEME}? are\n{_allowed()}")
    return EllxOptions(**values)


def _read_pair(key: str, text: str, values: dict[str, Any]) -> None:
    if key not in _KEYS:
        raise ValueError(f"{key!r} is no key")
    entry = _KEYS[key]
    if entry.field in values:
        raise ValueError(f"{key!r} stands twice")
    try:
        value = entry.read(text)
    except ValueError:
        value = math.nan
    if not entry.lowest <= value <= entry.highest:
        raise ValueError(f"{key}={text}: must be {entry.range_in_words()}")
    values[entry.field] = value


def _allowed() -> str:
    return "\n".join(f"  {key}= {entry.meaning}: {entry.range_in_words()}" for key, entry in _KEYS.items())
