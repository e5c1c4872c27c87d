"""Simulated stages by the address that describes them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from sim_devices.clock import Clock
from sim_devices.stages import apt as apt_address
from sim_devices.stages import ellx as ellx_address
from sim_devices.stages import zaber as zaber_address
from sim_devices.stages.apt import AptLanguage, AptOptions
from sim_devices.stages.drive import Drive
from sim_devices.stages.ellx import EllxLanguage, EllxOptions
from sim_devices.stages.stage import Language, SimulatedStage, assemble
from sim_devices.stages.zaber import ZaberLanguage, ZaberOptions

StageOptions = EllxOptions | ZaberOptions | AptOptions


@dataclass(frozen=True, kw_only=True)
class _Family:
    parse: Callable[[str], StageOptions]
    options: type
    language: Callable[[Any, Drive], Language]
    baud: int


_FAMILIES: dict[str, _Family] = {
    ellx_address.SCHEME: _Family(
        parse=ellx_address.parse_address, options=EllxOptions, language=EllxLanguage, baud=9600
    ),
    zaber_address.SCHEME: _Family(
        parse=zaber_address.parse_address, options=ZaberOptions, language=ZaberLanguage, baud=115200
    ),
    apt_address.SCHEME: _Family(parse=apt_address.parse_address, options=AptOptions, language=AptLanguage, baud=115200),
}
SCHEMES = tuple(_FAMILIES)


def parse_stage_address(text: str) -> StageOptions:
    """Return the simulated stage that an address describes, such as ``sim:ellx?stall=3``.

    Raises
    ------
    ValueError
        There is no such kind of stage, or the address has a key or value that it does not allow; all are named.
    """
    scheme = text.partition("?")[0]
    if scheme not in _FAMILIES:
        raise ValueError(f"stage address {text!r}: there is no {scheme!r}; there are {', '.join(SCHEMES)}")
    return _FAMILIES[scheme].parse(text)


def make_stage(options: StageOptions, *, clock: Clock) -> SimulatedStage:
    """Return a simulated stage at its power-up.

    Parameters
    ----------
    options : StageOptions
        What it is like.
    clock : Clock
        The time that it lives in.
    """
    family = next(family for family in _FAMILIES.values() if isinstance(options, family.options))
    speak = partial(family.language, options)
    return assemble(options, speak, counts_per_turn=options.counts_per_turn, baud=family.baud, clock=clock)
