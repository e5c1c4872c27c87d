"""Serial ports of this machine, and the name of each that will still be its own after a restart."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

from drivers.errors import NotConnectedError

_BY_ID = Path("/dev/serial/by-id")
_USB = "usb:"
_NUMBERED = re.compile(r"/dev/tty(USB|ACM)[0-9]+")


@dataclass(frozen=True, kw_only=True)
class PortInfo:
    """A serial port.

    Attributes
    ----------
    device : str
        Its device file, such as ``/dev/ttyUSB0``; the number depends on the order of plugging in.
    lasting_name : str
        A name that does not: its link in ``/dev/serial/by-id``, or else its device file.
    usb_id : (int, int) or None
        Vendor and product, for a port on USB.
    usb_serial_number : str or None
        Of the adapter, not of what is behind it.
    """

    device: str
    lasting_name: str
    usb_id: tuple[int, int] | None
    usb_serial_number: str | None


def serial_ports(*, by_id: Path = _BY_ID) -> list[PortInfo]:
    """Return the serial ports of this computer, sorted by device file."""
    return [
        PortInfo(
            device=found.device,
            lasting_name=_link_to(found.device, by_id) or found.device,
            usb_id=None if found.vid is None or found.pid is None else (found.vid, found.pid),
            usb_serial_number=found.serial_number,
        )
        for found in sorted(list_ports.comports())
    ]


def resolve_port(name: str, *, warn: Callable[[str], None], by_id: Path = _BY_ID) -> str:
    """Return the path to open for a port as people name it.

    Parameters
    ----------
    name : str
        A path, or ``usb:`` and the serial number of the USB adapter.
    warn : callable
        Told when the name is one of those that another device may have after a restart.
    by_id : Path
        Where the lasting names are.

    Raises
    ------
    NotConnectedError
        No adapter, or more than one, has this serial number.
    """
    if name.startswith(_USB):
        return _port_of_adapter(name.removeprefix(_USB), by_id=by_id)
    if _NUMBERED.fullmatch(name):
        better = _link_to(name, by_id)
        advice = f"use {better}" if better else "`ls -l /dev/serial/by-id` shows names that last"
        warn(f"port {name}: after a restart this name may be another device's; {advice}")
    return name


def _port_of_adapter(serial_number: str, *, by_id: Path) -> str:
    ports = serial_ports(by_id=by_id)
    found = [port.device for port in ports if port.usb_serial_number == serial_number]
    if len(found) != 1:
        known = ", ".join(port.usb_serial_number for port in ports if port.usb_serial_number) or "none"
        raise NotConnectedError(
            f"{_USB}{serial_number}: {len(found)} ports have this USB serial number. Plugged in are: {known}"
        )
    return found[0]


def _link_to(device: str, by_id: Path) -> str | None:
    links = sorted(by_id.iterdir()) if by_id.is_dir() else []
    return next((str(link) for link in links if link.resolve() == Path(device).resolve()), None)
