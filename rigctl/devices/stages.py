"""Opens rotation stages: through the entry points of their drivers, on real ports and on simulated ones."""

import inspect
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity, RotationStage
from drivers.serial_ports import resolve_port
from rigctl.devices.characterisation_file import load_settle_s
from rigctl.devices.settling import SettlingStage
from rigctl.errors import ConfigError
from rigctl.files.rig_file import StageSection
from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.pty_server import serve_on_pty

SIMULATED = "sim:"
# What is printed on a device, and the driver for it.
_DRIVERS_OF_MODELS = (
    (("ell", "elliptec"), "ellx"),
    (("kdc", "k10cr", "prm", "thorlabs", "kinesis", "tdc"), "apt"),
    (("x-r", "rst", "zaber"), "zaber"),
    (("aravis", "genicam", "gc", "prosilica", "allied", "basler", "flir"), "gige"),
    (("usb", "uvc", "/dev/video", "webcam"), "v4l2"),
)


@contextmanager
def open_stage(section: StageSection, *, warn: Callable[[str], None]) -> Iterator[RotationStage]:
    """Give the open stage of a rig file, a simulated one with nothing around it, until the context is left.

    Raises
    ------
    DeviceError
        It cannot be opened, or is not the one that the rig file names.
    ConfigError
        There is no such driver, its options are wrong, or there is no such simulated stage.
    """
    if not section.port.startswith(SIMULATED):
        with connect_stage(section, resolve_port(section.port, warn=warn)) as stage:
            yield stage
        return
    try:
        options = parse_stage_address(section.port)
    except ValueError as error:
        raise ConfigError(f"stage.port: {error}") from error
    clock = SimClock(speed=options.speed)
    with serve_on_pty(make_stage(options, clock=clock), clock=clock) as port, connect_stage(section, port) as stage:
        yield stage


@contextmanager
def connect_stage(section: StageSection, port: str) -> Iterator[RotationStage]:
    """Give the stage that answers on a port, once it is known to be the one that the rig file names."""
    factory = find_driver("rigctl.stages", section.driver, key="stage.driver").load()
    given: dict[str, Any] = {"tolerance_deg": section.tolerance_deg, **section.options}
    if section.address is not None:
        given["address"] = section.address
    _require_arguments(factory, section.driver, port, given)
    opened: RotationStage = factory(port, **given)
    with opened as stage:
        identity = stage.identify()
        require_serial("stage", section.serial_number, identity)
        if section.characterisation is None:
            yield stage
        else:
            yield SettlingStage(stage, settle_s=load_settle_s(section.characterisation, identity=identity))


def find_driver(group: str, name: str, *, key: str) -> EntryPoint:
    """Return an installed driver.

    Parameters
    ----------
    group : str
        ``rigctl.stages`` or ``rigctl.cameras``.
    name : str
        Of the driver.
    key : str
        Of the rig file that names it.

    Raises
    ------
    ConfigError
        There is none of this name.
    """
    installed = {entry.name: entry for entry in entry_points(group=group)}
    if name not in installed:
        known = ", ".join(sorted(installed)) or "none"
        raise ConfigError(f"{key}: there is no driver {name!r}; installed are: {known}{_driver_meant(name, installed)}")
    return installed[name]


def _driver_meant(name: str, installed: Collection[str]) -> str:
    """Return which driver a name of a model leads to, in words."""
    word = name.strip().lower()
    by_model = next((driver for models, driver in _DRIVERS_OF_MODELS if word.startswith(models)), None)
    known = by_model is not None and by_model in installed
    close = [by_model] if known else get_close_matches(word, list(installed), n=1)
    return f"; did you mean {close[0]}?" if close else ""


def require_serial(what: str, configured: str | None, found: DeviceIdentity) -> None:
    """Raise NotConnectedError unless a device has the serial number that the rig file asks for, if it asks."""
    if configured is not None and configured != found.serial_number:
        raise NotConnectedError(
            f"the {what} is {found.model} with serial number {found.serial_number}, and the rig file asks for "
            f"{configured}: another device is on this port. Mend the port or the serial number"
        )


def _require_arguments(factory: Callable[..., RotationStage], driver: str, port: str, given: dict[str, Any]) -> None:
    signature = inspect.signature(factory)
    try:
        signature.bind(port, **given)
    except TypeError as error:
        allowed = ", ".join(list(signature.parameters)[1:])
        raise ConfigError(f"stage: driver {driver!r}: {error}; it takes {allowed}") from error
