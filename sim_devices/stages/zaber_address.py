"""Options of a simulated Zaber rotation stage, and their form as an address: ``sim:zaber?stall=3``."""

from dataclasses import dataclass

from sim_devices.stages.address import flag, read_address, whole
from sim_devices.stages.stage_options import (
    COMMON_KEYS,
    LineOptions,
    MotionOptions,
    fault_key,
    line_options,
    motion_options,
)

SCHEME = "sim:zaber"


@dataclass(frozen=True, kw_only=True)
class ZaberOptions:
    """A stage and its faults. The defaults are those of a worm-driven stage with an encoder (numbers assumed).

    Attributes
    ----------
    motion, line : MotionOptions, LineOptions
        What it shares with other stages.
    model : int
        The device's identity number.
    serial_number : int
        As told by ``get system.serial``.
    resolution : int
        Microsteps of a motor step; people can change it.
    steps : int
        Motor steps of a turn of the ring.
    cycle : bool
        Whether the firmware knows the setting ``limit.cycle.dist``.
    encoder : bool
        Whether there is an encoder, and so the setting ``encoder.pos``.
    one_turn : bool
        Whether its limits allow one turn only.
    seed : int
        Of all that is random.
    speed : float
        Simulated seconds in a second of the wall clock.
    """

    motion: MotionOptions
    line: LineOptions
    model: int = 50931
    serial_number: int = 114821
    resolution: int = 64
    steps: int = 24000
    cycle: bool = True
    encoder: bool = True
    one_turn: bool = False
    seed: int = 0
    speed: float = 1.0

    @property
    def counts_per_turn(self) -> int:
        """Microsteps of a turn of the ring."""
        return self.resolution * self.steps


def _fault_flag(text: str) -> str:
    if len(text) != 2 or text[0] != "F" or not "A" <= text[1] <= "Z":
        raise ValueError(text)
    return text


_KEYS = {
    "model": whole("own", "model", "identity number", 1, 10**6),
    "serial": whole("own", "serial_number", "serial number", 0, 2**32 - 1),
    "resolution": whole("own", "resolution", "microsteps of a motor step", 1, 256),
    "steps": whole("own", "steps", "motor steps of a turn", 1, 10**6),
    "cycle": flag("own", "cycle", "knows the setting limit.cycle.dist"),
    "encoder": flag("own", "encoder", "has an encoder"),
    "oneturn": flag("own", "one_turn", "its limits allow one turn only"),
    "fault": fault_key(_fault_flag, codes="a warning flag that begins with F"),
    **COMMON_KEYS,
}


def parse_address(text: str) -> ZaberOptions:
    """Return the stage that an address describes.

    Raises
    ------
    ValueError
        The address is not of this form. The message names every problem and all that is allowed.
    """
    values = read_address(text, scheme=SCHEME, keys=_KEYS)
    motion = motion_options(values, motor_deg_per_s=100.0, landing_deg=0.001)
    return ZaberOptions(motion=motion, line=line_options(values), **values.get("own", {}))
