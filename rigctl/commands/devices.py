"""``rigctl devices``: which ports, stages and cameras there are."""

from collections.abc import Iterable
from dataclasses import asdict
from importlib.metadata import entry_points
from typing import Annotated, Any

import typer

from drivers.discovery import Found, find_stages
from drivers.errors import DeviceError
from drivers.interfaces import DeviceIdentity
from drivers.serial_ports import PortInfo, serial_ports
from rigctl.terminal import print_json, results, warn

_CAMERA_FINDERS = "rigctl.camera_finders"


def command(
    probe: Annotated[
        bool, typer.Option("--probe", help="Ask on every port, also where it may disturb a foreign device.")
    ] = False,
    port: Annotated[
        list[str] | None, typer.Option(metavar="PATH", help="Look at this port only; it may be a pseudo-terminal.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """List ports, stages and cameras, and print for each what a rig file needs.

    Nothing moves and no setting is changed. Only ports with the USB id of a supported stage are asked, unless --probe.
    Cameras are looked for by the finders of all installed drivers, plug-ins' too; not with --port.

    Example: rigctl devices --probe --port /tmp/stage
    """
    ports = serial_ports() if port is None else [_named(path) for path in port]
    found = find_stages(ports, probe=probe)
    cameras = list(_cameras()) if port is None else []
    if as_json:
        print_json({"ports": [asdict(each) for each in found], "cameras": [_camera_json(*each) for each in cameras]})
        return
    _print_ports(found)
    if port is None:
        _print_cameras(cameras)


def _named(path: str) -> PortInfo:
    known = {port.device: port for port in serial_ports()} | {port.lasting_name: port for port in serial_ports()}
    return known.get(path) or PortInfo(device=path, lasting_name=path, usb_id=None, usb_serial_number=None)


def _cameras() -> Iterable[tuple[str, DeviceIdentity]]:
    """Return the address and identity of each camera that an installed finder (an entry point) sees."""
    for entry in entry_points(group=_CAMERA_FINDERS):
        try:
            yield from entry.load()()
        except DeviceError as error:
            warn(f"cameras of {entry.name}: {error}")


def _camera_json(address: str, identity: DeviceIdentity) -> dict[str, Any]:
    return {"address": address, "identity": asdict(identity)}


def _print_ports(found: list[Found]) -> None:
    console = results()
    if not found:
        console.print("no serial ports", markup=False)
    for each in found:
        console.print(_port_text(each), markup=False)


def _print_cameras(cameras: list[tuple[str, DeviceIdentity]]) -> None:
    console = results()
    if not cameras:
        console.print("no cameras", markup=False)
    for address, identity in cameras:
        console.print(_camera_text(address, identity), markup=False)


def _port_text(found: Found) -> str:
    usb = "" if found.port.usb_id is None else f" (USB {found.port.usb_id[0]:04x}:{found.port.usb_id[1]:04x})"
    head = f"{found.port.device}{usb}: "
    if found.answer is None:
        return head + found.remark
    identity, address = found.answer.identity, found.answer.address
    lines = ["[stage]", f'driver = "{found.driver}"', f'port = "{found.port.lasting_name}"']
    lines += [] if address is None else [f'address = "{address}"']
    lines += [f'serial_number = "{identity.serial_number}"']
    return head + _identity_text(identity) + "".join(f"\n    {line}" for line in lines)


def _camera_text(address: str, identity: DeviceIdentity) -> str:
    lines = ["[camera]", f'address = "{address}"', f'serial_number = "{identity.serial_number}"']
    return _identity_text(identity) + "".join(f"\n    {line}" for line in lines)


def _identity_text(identity: DeviceIdentity) -> str:
    return f"{identity.model}, serial number {identity.serial_number}, firmware {identity.firmware}"
