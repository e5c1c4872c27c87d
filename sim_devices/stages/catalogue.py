"""Simulated stages from addresses."""

from typing import Any

from sim_devices.clock import Clock
from sim_devices.stages import apt, ellx, zaber
from sim_devices.stages.options import Key, StageOptions, read_address
from sim_devices.stages.stage import SimulatedStage

# Scheme of an address -> options, keys, language, and bits per second of the line.
_FAMILIES: dict[str, tuple[type[StageOptions], dict[str, Key], Any, int]] = {
    "sim:ellx": (ellx.EllxOptions, ellx.KEYS, ellx.EllxLanguage, 9600),
    "sim:zaber": (zaber.ZaberOptions, zaber.KEYS, zaber.ZaberLanguage, 115200),
    "sim:apt": (apt.AptOptions, apt.KEYS, apt.AptLanguage, 115200),
}
SCHEMES = tuple(_FAMILIES)


def parse_stage_address(text: str) -> StageOptions:
    """Return the simulated stage that an address describes, such as ``sim:ellx?stall=3``.

    Raises
    ------
    ValueError
        The kind of stage does not exist, or the address has keys or values that are not allowed; the message lists all.
    """
    scheme = text.partition("?")[0]
    if scheme not in _FAMILIES:
        raise ValueError(f"stage address {text!r}: there is no {scheme!r}; allowed are {', '.join(SCHEMES)}")
    options, keys, _, _ = _FAMILIES[scheme]
    return options(**read_address(text, keys))


def make_stage(options: StageOptions, *, clock: Clock) -> SimulatedStage:
    """Return a simulated stage at power-up, with a clock."""
    language, baud = next((family[2], family[3]) for family in _FAMILIES.values() if family[0] is type(options))
    return SimulatedStage(options, language, baud=baud, clock=clock)
