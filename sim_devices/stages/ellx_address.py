"""Options of a simulated Elliptec stage, and their form as an address: ``sim:ellx?stall=3&busy=1``."""

from dataclasses import dataclass

from sim_devices.stages.address import number, one_of, read_address, whole
from sim_devices.stages.stage_options import (
    COMMON_KEYS,
    LineOptions,
    MotionOptions,
    fault_key,
    line_options,
    motion_options,
)

SCHEME = "sim:ellx"


@dataclass(frozen=True, kw_only=True)
class EllxOptions:
    """A stage and its faults. The defaults are a sound ELL14.

    Attributes
    ----------
    motion, line : MotionOptions, LineOptions
        What it shares with other stages.
    model : int
        The number in the model's name.
    serial_number : int
        At most eight digits.
    pulses : int
        Encoder counts of a turn: 143360 in every ELL14 whose reply is public, 262144 in the manual's table.
    address : str
        Its place on the line, a hexadecimal digit.
    gap_s : float
        A move that is sent sooner than this after the last one ended goes to 0 instead.
    seed : int
        Of all that is random.
    speed : float
        Simulated seconds in a second of the wall clock.
    """

    motion: MotionOptions
    line: LineOptions
    model: int = 14
    serial_number: int = 11401326
    pulses: int = 143360
    address: str = "0"
    gap_s: float = 0.0
    seed: int = 0
    speed: float = 1.0

    @property
    def counts_per_turn(self) -> int:
        """Encoder counts of a turn of the ring."""
        return self.pulses


def _status_code(text: str) -> int:
    code = int(text, 0)
    if not 1 <= code <= 255:
        raise ValueError(text)
    return code


_KEYS = {
    "model": whole("own", "model", "number in the model's name", 1, 255),
    "serial": whole("own", "serial_number", "serial number", 0, 99999999),
    "pulses": whole("own", "pulses", "encoder counts of a turn", 1, 0x7FFFFFFF),
    "address": one_of("own", "address", "place on the line", tuple("0123456789ABCDEF")),
    "gap": number("own", "gap_s", "a move sooner than this after the last goes to 0 [s]", 0, 60),
    "fault": fault_key(_status_code, codes="a status from 1 to 255"),
    **COMMON_KEYS,
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
    values = read_address(text, scheme=SCHEME, keys=_KEYS)
    motion = motion_options(values, motor_deg_per_s=430.0, landing_deg=0.004)
    return EllxOptions(motion=motion, line=line_options(values), **values.get("own", {}))
