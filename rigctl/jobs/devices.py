"""Looking for ports, stages and cameras."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from drivers.discovery import Found, find_stages
from drivers.errors import DeviceError
from drivers.interfaces import DeviceIdentity
from drivers.serial_ports import PortInfo, serial_ports
from rigctl.errors import ConfigError

_CAMERA_FINDERS = "rigctl.camera_finders"


@dataclass(frozen=True, kw_only=True)
class FoundCamera:
    """A camera, and the address that a rig file has to name."""

    address: str
    identity: DeviceIdentity


@dataclass(frozen=True, kw_only=True)
class FoundDevices:
    """Ports with their stages, and cameras; `cameras` is None where none was looked for."""

    ports: tuple[Found, ...]
    cameras: tuple[FoundCamera, ...] | None


def find_devices(paths: Sequence[str] | None, *, probe: bool, warn: Callable[[str], None]) -> FoundDevices:
    """Return ports with the stages behind them, and cameras.

    Parameters
    ----------
    paths : sequence of str or None
        Look at these ports only, and for no camera; None looks at all.
    probe : bool
        Ask on every port, also where it may disturb a foreign device.
    warn : callable
        Told of finders that cannot look.

    Raises
    ------
    ConfigError
        There is no such port.
    """
    ports = serial_ports() if paths is None else [_named(path) for path in paths]
    found = tuple(find_stages(ports, probe=probe))
    return FoundDevices(ports=found, cameras=tuple(_cameras(warn)) if paths is None else None)


def _named(path: str) -> PortInfo:
    known = {port.device: port for port in serial_ports()} | {port.lasting_name: port for port in serial_ports()}
    if path not in known and not Path(path).exists():
        raise ConfigError(f"--port: {path}: there is no such port; `rigctl devices` lists those that there are")
    return known.get(path) or PortInfo(device=path, lasting_name=path, usb_id=None, usb_serial_number=None)


def _cameras(warn: Callable[[str], None]) -> Iterator[FoundCamera]:
    """Give each camera that an installed finder (an entry point) sees."""
    for entry in entry_points(group=_CAMERA_FINDERS):
        try:
            for address, identity in entry.load()():
                yield FoundCamera(address=address, identity=identity)
        except DeviceError as error:
            warn(f"cameras of {entry.name}: {error}")
