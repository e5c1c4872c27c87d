"""Options of a simulated Thorlabs APT stage, and their form as an address: ``sim:apt?model=K10CR2``."""

from dataclasses import dataclass

from sim_devices.stages.address import flag, one_of, read_address, whole
from sim_devices.stages.stage_options import (
    COMMON_KEYS,
    LineOptions,
    MotionOptions,
    fault_key,
    line_options,
    motion_options,
)

SCHEME = "sim:apt"


@dataclass(frozen=True, kw_only=True)
class AptModel:
    """A controller with its stage.

    Attributes
    ----------
    counts_per_deg : float
        Counts of a degree.
    velocity_per_deg_per_s : float
        What the controller calls a degree a second.
    is_stepper : bool
        Whether it speaks the messages of stepper motors, else those of DC servo motors.
    stage_id : int
        What it says of the stage that is plugged into it; 0 for one that is built in.
    serial_number : int
        The maker numbers its controllers by kind.
    home_offset_counts : int
        How far behind its mark it calls home when it comes.
    """

    counts_per_deg: float
    velocity_per_deg_per_s: float
    is_stepper: bool
    stage_id: int
    serial_number: int
    home_offset_counts: int


_K10CR = 409600.0 / 3.0
_PRM1 = 1919.6418578623391
MODELS = {
    "K10CR1": AptModel(
        counts_per_deg=_K10CR,
        velocity_per_deg_per_s=_K10CR * 53.68,
        is_stepper=True,
        stage_id=0,
        serial_number=55000123,
        home_offset_counts=546133,
    ),
    "K10CR2": AptModel(
        counts_per_deg=_K10CR,
        velocity_per_deg_per_s=_K10CR * 53.68,
        is_stepper=True,
        stage_id=0,
        serial_number=55500123,
        home_offset_counts=546133,
    ),
    "KDC101": AptModel(
        counts_per_deg=_PRM1,
        velocity_per_deg_per_s=_PRM1 * 65536.0 * 2048.0 / 6e6,
        is_stepper=False,
        stage_id=6,
        serial_number=27000123,
        home_offset_counts=0,
    ),
}


@dataclass(frozen=True, kw_only=True)
class AptOptions:
    """A stage and its faults. The defaults are a sound K10CR1.

    Attributes
    ----------
    motion, line : MotionOptions, LineOptions
        What it shares with other stages.
    model : str
        One of `MODELS`; a KDC101 has a PRM1-Z8.
    serial_number : int or None
        None: one of the model's own range.
    forgets : bool
        Whether its velocities are 0 after power-up: it then says that it moves, and stands still.
    quiet_home : bool
        Whether it homes without saying HOMED.
    updates : bool
        Whether it tells its status ten times a second from power-up on.
    seed : int
        Of all that is random.
    speed : float
        Simulated seconds in a second of the wall clock.
    """

    motion: MotionOptions
    line: LineOptions
    model: str = "K10CR1"
    serial_number: int | None = None
    forgets: bool = False
    quiet_home: bool = False
    updates: bool = False
    seed: int = 0
    speed: float = 1.0

    @property
    def counts_per_turn(self) -> float:
        """Counts of a turn of the ring."""
        return MODELS[self.model].counts_per_deg * 360.0


def _status_bits(text: str) -> int:
    bits = int(text, 0)
    if not 0 < bits < 1 << 32:
        raise ValueError(text)
    return bits


_KEYS = {
    "model": one_of("own", "model", "which controller", tuple(MODELS)),
    "serial": whole("own", "serial_number", "serial number", 0, 2**31 - 1),
    "forgets": flag("own", "forgets", "its velocities are 0 after power-up"),
    "quiethome": flag("own", "quiet_home", "it homes without saying so"),
    "updates": flag("own", "updates", "it tells its status unasked from power-up on"),
    "fault": fault_key(_status_bits, codes="status bits, such as 0x4000"),
    **COMMON_KEYS,
}


def parse_address(text: str) -> AptOptions:
    """Return the stage that an address describes.

    Raises
    ------
    ValueError
        The address is not of this form. The message names every problem and all that is allowed.
    """
    values = read_address(text, scheme=SCHEME, keys=_KEYS)
    motion = motion_options(values, motor_deg_per_s=25.0, landing_deg=0.001)
    return AptOptions(motion=motion, line=line_options(values), **values.get("own", {}))
