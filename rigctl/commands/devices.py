"""``rigctl devices``: which ports, stages and cameras there are."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.console.terminal import print_json, results, warn

if TYPE_CHECKING:
    from drivers.discovery import Found
    from drivers.interfaces import DeviceIdentity
    from rigctl.jobs.devices import FoundCamera


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
    from rigctl.jobs.devices import find_devices

    found = find_devices(port, probe=probe, warn=warn)
    if as_json:
        ports, cameras = found.ports, found.cameras or ()
        print_json({"ports": [asdict(each) for each in ports], "cameras": [asdict(each) for each in cameras]})
        return
    _print_ports(found.ports)
    if found.cameras is not None:
        _print_cameras(found.cameras)


def _print_ports(found: Sequence["Found"]) -> None:
    console = results()
    if not found:
        console.print("no serial ports", markup=False)
    for each in found:
        console.print(_port_text(each), markup=False)


def _print_cameras(cameras: Sequence["FoundCamera"]) -> None:
    console = results()
    if not cameras:
        console.print("no cameras", markup=False)
    for camera in cameras:
        console.print(_camera_text(camera), markup=False)


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


def _camera_text(camera: "FoundCamera") -> str:
    lines = ["[camera]", f'address = "{camera.address}"', f'serial_number = "{camera.identity.serial_number}"']
    return _identity_text(camera.identity) + "".join(f"\n    {line}" for line in lines)


def _identity_text(identity: "DeviceIdentity") -> str:
    return f"{identity.model}, serial number {identity.serial_number}, firmware {identity.firmware}"
