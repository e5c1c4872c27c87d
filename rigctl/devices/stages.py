"""Opens rotation stages: through the entry points of their drivers, on real ports and on simulated ones."""

import inspect
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from drivers.errors import NotConnectedError
from drivers.interfaces import DeviceIdentity, Move, RotationStage, StagePosition, StageStatus, Way
from drivers.serial_ports import resolve_port
from rigctl.devices.characterisation_file import load_settle_s
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


class SettlingStage:
    """Another stage, with a pause and a fresh readback after each move.

    Parameters
    ----------
    stage : RotationStage
        What turns.
    settle_s : float
        Pause after a move [s].
    sleep : callable
        Makes the pause.
    """

    def __init__(self, stage: RotationStage, *, settle_s: float, sleep: Callable[[float], None] = time.sleep) -> None:
        self._stage = stage
        self._settle_s = settle_s
        self._sleep = sleep

    def __enter__(self) -> "SettlingStage":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return what the device says of itself."""
        return self._stage.identify()

    def home(self) -> StagePosition:
        """Search the reference mark; return the readback after the pause."""
        self._stage.home()
        self._sleep(self._settle_s)
        return self._stage.position()

    def move_to(self, angle_deg: float, *, way: Way = "short") -> Move:
        """Go to an angle; return once it is there and rests. Raises what the stage raises."""
        move = self._stage.move_to(angle_deg, way=way)
        self._sleep(self._settle_s)
        return Move(
            target_deg=move.target_deg,
            position=self._stage.position(),
            tries=move.tries,
            duration_s=move.duration_s + self._settle_s,
            remarks=move.remarks,
        )

    def position(self) -> StagePosition:
        """Read the encoder."""
        return self._stage.position()

    def status(self) -> StageStatus:
        """Ask the device what it is doing."""
        return self._stage.status()

    def stop(self) -> None:
        """Stop any motion that the device is able to stop."""
        self._stage.stop()

    def close(self) -> None:
        """Release the port. May be called twice."""
        self._stage.close()
