"""`rigctl devices`: ports, stages and cameras, with the lines that a rig file needs."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import entry_points
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.console import Json, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import Part, Result

if TYPE_CHECKING:
    from drivers.discovery import Found
    from drivers.interfaces import DeviceIdentity
    from drivers.serial_port import PortInfo

_CAMERA_FINDERS = "rigctl.camera_finders"


def devices(*, probe: bool = False, port: Sequence[str] = ()) -> "FoundDevices":
    """List ports, stages and cameras, with the lines that a rig file needs for each.

    Nothing moves and no setting is changed. Without --probe, the command talks only to ports with the USB id of a
    supported stage. Cameras are found by all installed drivers, including plug-ins.

    Example: rigctl devices --probe --port /tmp/stage

    Parameters
    ----------
    probe : bool
        Talk to every port; this may disturb devices of other kinds.
    port : sequence of str
        Check only this port, and no cameras. It may be a pseudo-terminal. Repeatable.
    """
    from drivers.discovery import find_stages
    from drivers.serial_port import serial_ports

    ports = [_named(path) for path in port] or serial_ports()
    found = tuple(find_stages(ports, probe=probe))
    return FoundDevices(ports=found, cameras=None if port else tuple(_cameras()))


def _named(path: str) -> "PortInfo":
    from drivers.serial_port import PortInfo, serial_ports

    known = {name: port for port in serial_ports() for name in (port.device, port.lasting_name)}
    if path not in known and not Path(path).exists():
        raise ConfigError(f"--port: {path}: there is no such port; `rigctl devices` lists the ports")
    return known.get(path) or PortInfo(device=path, lasting_name=path, usb_id=None, usb_serial_number=None)


def _cameras() -> "Iterator[tuple[str, DeviceIdentity]]":
    """Yield the cameras that installed drivers find."""
    from drivers.errors import DeviceError

    failures: dict[str, list[str]] = {}
    for entry in entry_points(group=_CAMERA_FINDERS):
        try:
            yield from entry.load()()
        except DeviceError as error:
            failures.setdefault(str(error), []).append(entry.name)
    for text, names in failures.items():
        warn(f"cameras ({', '.join(sorted(names))}) were not searched: {text}")


@dataclass(frozen=True, kw_only=True)
class FoundDevices(Result):
    """Ports with their stages, and cameras."""

    ports: "tuple[Found, ...]"
    #: address in a rig file and identity of each; None if only ports were requested
    cameras: "tuple[tuple[str, DeviceIdentity], ...] | None"

    def content(self) -> Iterable[Part]:
        """Return the ports and cameras with their lines for the rig file."""
        yield from map(_port_text, self.ports) if self.ports else ("no serial ports",)
        if self.cameras is not None:
            yield from starmap(_camera_text, self.cameras) if self.cameras else ("no cameras",)

    def as_json(self) -> dict[str, Json]:
        """Return ports and cameras."""
        return {
            "ports": [asdict(each) for each in self.ports],
            "cameras": [{"address": address, "identity": asdict(identity)} for address, identity in self.cameras or ()],
        }


def _port_text(found: "Found") -> str:
    usb = "" if found.port.usb_id is None else f" (USB {found.port.usb_id[0]:04x}:{found.port.usb_id[1]:04x})"
    head = f"{found.port.device}{usb}: "
    if found.answer is None:
        return head + found.remark
    identity, address = found.answer.identity, found.answer.address
    lines = ["[stage]", f'driver = "{found.driver}"', f'port = "{found.port.lasting_name}"']
    lines += [] if address is None else [f'address = "{address}"']
    lines += [f'serial_number = "{identity.serial_number}"']
    return head + _identity_text(identity) + "".join(f"\n    {line}" for line in lines)


def _camera_text(address: str, identity: "DeviceIdentity") -> str:
    lines = ["[camera]", f'address = "{address}"', f'serial_number = "{identity.serial_number}"']
    return _identity_text(identity) + "".join(f"\n    {line}" for line in lines)


def _identity_text(identity: "DeviceIdentity") -> str:
    return f"{identity.model}, serial number {identity.serial_number}, firmware {identity.firmware}"
