"""Finds rotation stages on serial ports, without disturbing other devices."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points

from drivers.errors import DeviceError
from drivers.serial_port import BytePort, PortInfo, open_serial_port
from drivers.stages.serial_stage import Answer, StageProbe

STAGES = "rigctl.stages"
"""Group of entry points of the drivers of stages."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """Result of looking at a port.

    Attributes
    ----------
    port : PortInfo
        The port.
    driver : str or None
        Name of the driver to use, None if no stage answered.
    answer : Answer or None
        The stage.
    remark : str
        Reason why no stage was found; empty if one answered.
    """

    port: PortInfo
    driver: str | None = None
    answer: Answer | None = None
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class _Family:
    driver: str
    probe: StageProbe


def find_stages(
    ports: Iterable[PortInfo], *, probe: bool, open_port: Callable[..., BytePort] = open_serial_port
) -> list[Found]:
    """Return the stages that answer on some ports, or why none does.

    Parameters
    ----------
    ports : iterable of PortInfo
        Ports to search.
    probe : bool
        Also ask on ports whose USB id does not identify the device, which might mistake the question for a command.
    open_port : callable
        Opens a path at a bit rate.
    """
    families = _families()
    return [found for port in ports for found in _find_on(port, families, probe=probe, open_port=open_port)]


def _find_on(
    port: PortInfo, families: list[_Family], *, probe: bool, open_port: Callable[..., BytePort]
) -> list[Found]:
    asked = [family for family in families if probe or _is_known(port.usb_id, family.probe)]
    if not asked:
        return [Found(port=port, remark="not asked, because the device is unknown; use --probe to ask")]
    try:
        found = [
            Found(port=port, driver=family.driver, answer=answer)
            for family in asked
            for answer in _ask(port, family, open_port=open_port)
        ]
    except DeviceError as error:
        return [Found(port=port, remark=str(error))]
    tried = ", ".join(family.driver for family in asked)
    return found or [
        Found(port=port, remark=f"no stage answers (tried {tried}); check that it is switched on, and its address")
    ]


def _families() -> list[_Family]:
    """Return the families of all installed drivers that can be searched for, in a fixed order."""
    entries = sorted(entry_points(group=STAGES), key=lambda entry: entry.name, reverse=True)
    probes = {entry.name: getattr(import_module(entry.module), "PROBE", None) for entry in entries}
    return [_Family(driver=name, probe=probe) for name, probe in probes.items() if isinstance(probe, StageProbe)]


def _is_known(usb_id: tuple[int, int] | None, probe: StageProbe) -> bool:
    return usb_id is not None and any(
        usb_id[0] == vendor and product in (None, usb_id[1]) for vendor, product in probe.usb_ids
    )


def _ask(port: PortInfo, family: _Family, *, open_port: Callable[..., BytePort]) -> list[Answer]:
    link = open_port(port.device, baud=family.probe.baud)
    try:
        return family.probe.ask(link)
    finally:
        link.close()
