"""Simulated stages by the address that describes them."""

from collections.abc import Callable
from functools import partial

from sim_devices.clock import Clock
from sim_devices.stages import apt_address, ellx_address, zaber_address
from sim_devices.stages.apt_address import AptOptions
from sim_devices.stages.apt_language import AptLanguage
from sim_devices.stages.ellx_address import EllxOptions
from sim_devices.stages.ellx_language import EllxLanguage
from sim_devices.stages.simulated_stage import SimulatedStage, assemble
from sim_devices.stages.zaber_address import ZaberOptions
from sim_devices.stages.zaber_language import ZaberLanguage

StageOptions = EllxOptions | ZaberOptions | AptOptions

_PARSERS: dict[str, Callable[[str], StageOptions]] = {
    ellx_address.SCHEME: ellx_address.parse_address,
    zaber_address.SCHEME: zaber_address.parse_address,
    apt_address.SCHEME: apt_address.parse_address,
}
SCHEMES = tuple(_PARSERS)


def parse_stage_address(text: str) -> StageOptions:
    """Return the simulated stage that an address describes, such as ``sim:ellx?stall=3``.

    Raises
    ------
    ValueError
        There is no such kind of stage, or the address has a key or value that it does not allow; all are named.
    """
    scheme = text.partition("?")[0]
    if scheme not in _PARSERS:
        raise ValueError(f"stage address {text!r}: there is no {scheme!r}; there are {', '.join(SCHEMES)}")
    return _PARSERS[scheme](text)


def make_stage(options: StageOptions, *, clock: Clock) -> SimulatedStage:
    """Return a simulated stage at its power-up.

    Parameters
    ----------
    options : StageOptions
        What it is like.
    clock : Clock
        The time that it lives in.
    """
    if isinstance(options, EllxOptions):
        return assemble(options, partial(EllxLanguage, options), counts_per_turn=options.pulses, baud=9600, clock=clock)
    if isinstance(options, ZaberOptions):
        turn = options.counts_per_turn
        return assemble(options, partial(ZaberLanguage, options), counts_per_turn=turn, baud=115200, clock=clock)
    counts_per_turn = apt_address.MODELS[options.model].counts_per_deg * 360.0
    return assemble(options, partial(AptLanguage, options), counts_per_turn=counts_per_turn, baud=115200, clock=clock)
