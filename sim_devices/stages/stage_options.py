"""Options that simulated stages of every family share: how they turn, what their line does, and what goes wrong."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from sim_devices.stages.address import Key, Values, flag, number, whole

CodeT = TypeVar("CodeT", int, str)


@dataclass(frozen=True, kw_only=True)
class LineOptions:
    """The line and what happens to it.

    Attributes
    ----------
    drop, double, flip : float
        Probability that a byte is damaged, in both directions.
    late_s : float
        How much later than sent every third reply arrives.
    pieces, pace : bool
        Whether replies arrive in pieces of two bytes; whether bytes come as slowly as the line's bit rate makes them.
    silent : int or None
        Number of the command (from 1) from which on nothing is answered.
    vanish : int or None
        Number of the command at which the port vanishes, as if its plug were pulled.
    back_s : float
        How long the port stays away.
    """

    drop: float = 0.0
    double: float = 0.0
    flip: float = 0.0
    late_s: float = 0.0
    pieces: bool = False
    pace: bool = False
    silent: int | None = None
    vanish: int | None = None
    back_s: float = 2.0


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """The motor, its bearing, and what happens to moves. Moves count from 1, homing not counted.

    Attributes
    ----------
    motor_deg_per_s : float
        Fastest turn.
    landing_deg : float
        Standard deviation of where a move lands about its target (assumed).
    mark_deg, start_deg : float
        Angle in the housing of the reference mark, and at power-up.
    backlash_deg : float
        A move lands this much apart from where one from the other side lands.
    creep_deg : float
        How far short of its rest the ring stands when the motion ends; it creeps on with a time constant of 0.1 s.
    busy : bool
        Whether the stage says that it is busy although a motion has ended, or before it tells a position.
    stall, button : int or None
        Number of the move that stalls half-way; at whose end somebody turns the stage by hand.
    fault : (code, int) or None
        A fault in the device's own code, and the number of the move that ends with it.
    unhomed : bool
        Whether homing is never confirmed.
    minus_one : bool
        Whether a move ends one count below its target, so that one to 0 ends at -1.
    """

    motor_deg_per_s: float
    landing_deg: float
    mark_deg: float = 0.0
    start_deg: float = 77.7
    backlash_deg: float = 0.0
    creep_deg: float = 0.0
    busy: bool = False
    stall: int | None = None
    button: int | None = None
    fault: tuple[int | str, int] | None = None
    unhomed: bool = False
    minus_one: bool = False


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
