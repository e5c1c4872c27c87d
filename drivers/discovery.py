"""Finds rotation stages on serial ports, without disturbing what else may be there."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from drivers.errors import DeviceError
from drivers.serial_port import BytePort, open_serial_port
from drivers.serial_ports import PortInfo
from drivers.stages import apt_protocol, elliptec_protocol, probes, zaber_protocol
from drivers.stages.probes import Answer


@dataclass(frozen=True, kw_only=True)
class Found:
    """What was found on a port.

    Attributes
    ----------
    port : PortInfo
        The port.
    driver : str or None
        Name of the driver to use, None where no stage answered.
    answer : Answer or None
        The stage.
    remark : str
        Why there is none, in words; empty where there is one.
    """

    port: PortInfo
    driver: str | None = None
    answer: Answer | None = None
    remark: str = ""


@dataclass(frozen=True, kw_only=True)
class _Family:
    driver: str
    baud: int
    ask: Callable[[BytePort], list[Answer]]


_ELLX = _Family(driver="ellx", baud=elliptec_protocol.BAUD, ask=probes.ask_elliptec)
_ZABER = _Family(driver="zaber", baud=zaber_protocol.BAUD, ask=probes.ask_zaber)
_APT = _Family(driver="apt", baud=apt_protocol.BAUD, ask=probes.ask_apt)
_ALL = (_ZABER, _ELLX, _APT)

# USB ids behind which hardly anything else can be. A plain FT232R (0403:6001), which some Zaber cables have, is in
# thousands of other devices.
_KNOWN_USB_IDS: dict[tuple[int, int], tuple[_Family, ...]] = {
    (0x0403, 0x6015): (_ELLX,),  # FT230X: the Elliptec interface board
    (0x0403, 0xFAF0): (_APT,),
}
_ZABER_VENDOR = 0x2939


def find_stages(
    ports: Iterable[PortInfo], *, probe: bool, open_port: Callable[..., BytePort] = open_serial_port
) -> list[Found]:
    """Return what answers on each of some ports, or why nothing does.

    Parameters
    ----------
    ports : iterable of PortInfo
        Where to look.
    probe : bool
        Whether to ask on ports too whose USB id does not tell what is behind them: a foreign device might take the
        question for a command.
    open_port : callable
        Opens a path at a bit rate.
    """
    return [found for port in ports for found in _find_on(port, probe=probe, open_port=open_port)]


def _find_on(port: PortInfo, *, probe: bool, open_port: Callable[..., BytePort]) -> list[Found]:
    families = _ALL if probe else _families_by_usb_id(port.usb_id)
    if not families:
        return [Found(port=port, remark="not asked, since it may be anything; --probe asks")]
    try:
        found = [
            Found(port=port, driver=family.driver, answer=answer)
            for family in families
            for answer in _ask(port, family, open_port=open_port)
        ]
    except DeviceError as error:
        return [Found(port=port, remark=str(error))]
    return found or [Found(port=port, remark="no stage answers")]


def _families_by_usb_id(usb_id: tuple[int, int] | None) -> tuple[_Family, ...]:
    if usb_id is None:
        return ()
    return (_ZABER,) if usb_id[0] == _ZABER_VENDOR else _KNOWN_USB_IDS.get(usb_id, ())


def _ask(port: PortInfo, family: _Family, *, open_port: Callable[..., BytePort]) -> list[Answer]:
    link = open_port(port.device, baud=family.baud)
    try:
        return family.ask(link)
    finally:
        link.close()
