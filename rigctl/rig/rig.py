"""Opens the devices of a rig file, and traces their communication on request.

Drivers are found by their entry points; simulated devices by addresses that begin with ``sim:``.
"""

import inspect
import re
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Literal, TextIO

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceTimeoutError, NotConnectedError, ProtocolError
from drivers.interfaces import (
    Camera,
    CameraWithFacts,
    DeviceIdentity,
    Move,
    RotationStage,
    StagePosition,
    StageStatus,
    Way,
)
from drivers.serial_port import heard_by, resolve_port
from model.processing.mosaic import pair_by_light
from rigctl.base.numbers import wrapped
from rigctl.console import warn
from rigctl.errors import ConfigError
from rigctl.files.choices import FrameKind
from rigctl.files.rig_file import RigFile, StageSection
from rigctl.rig.characterise import load_settle_s
from rigctl.rig.simulated_parts import SimulatedClock, require_known_camera
from rigctl.rig.simulation import Simulation, simulate
from rigctl.runs.records import SimulatedLight
from rigctl.version import VERSION
from sim_devices.clock import SimClock
from sim_devices.stages.catalogue import make_stage, parse_stage_address
from sim_devices.stages.stage import serve_on_pty

SIMULATED = "sim:"
REQUESTS: dict[FrameKind, str] = {
    "scene": "Point the camera at the scene, nothing before the lens",
    "dark": "Cover the lens, so that no light comes in",
    "flat": "Put the flat field (integrating sphere) before the lens",
}
# Arguments of drivers that no rig file states.
_OF_TESTS = ("now_s", "sleep")
_PLACES = ("upper left", "upper right", "lower left", "lower right")
# A calibrated cell differs from the nominal one by some degrees, a wrong one by 45.
_CELL_TOLERANCE_DEG = 22.5
_CAMERAS = "rigctl.cameras"
_TRACE_SCHEMA = 1
# Names that are printed on devices, and their drivers.
_DRIVERS_OF_MODELS = (
    (("ell", "elliptec"), "ellx"),
    (("kdc", "k10cr", "prm", "thorlabs", "kinesis", "tdc"), "apt"),
    (("x-r", "rst", "zaber"), "zaber"),
    (("aravis", "genicam", "gc", "prosilica", "allied", "basler", "flir"), "gige"),
    (("usb", "uvc", "/dev/video", "webcam"), "v4l2"),
)


def _do_nothing(_sequence: int) -> bool:
    """Return False: numbers of real frames do not jump."""
    return False


def _ask_nobody(_kind: FrameKind) -> None:
    """Return at once: no person is needed."""


def _write_nothing(_text: str) -> None:
    """Write nothing: no trace was requested."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """The open devices of a rig."""

    stage: RotationStage | None  #: None for a camera with polarizers on its pixels.
    camera: Camera
    stage_identity: DeviceIdentity | None  #: Model and serial number.
    camera_identity: DeviceIdentity
    #: Places scene, dark or flat before a simulated camera; does nothing on a real rig.
    present: Callable[[FrameKind], None]
    #: Asks the operator of a real rig at the terminal to do so; does nothing on a simulated rig.
    ask: Callable[[FrameKind], None] = _ask_nobody
    origin: Literal["simulated", "device"]  #: Origin of the frames.
    #: Called with the sequence number of each step before its first frame. Returns True if the camera's frame numbers
    #: jump, which only simulated cameras do, for their noise.
    begin_step: Callable[[int], bool] = _do_nothing
    light: SimulatedLight | None = None  #: Light of a simulated roof.
    trace: Callable[[str], None] = _write_nothing  #: Writes a line of the trace.


@contextmanager
def open_rig(
    rig: RigFile, *, session_name: str, run: Path | None = None, clock: SimulatedClock | None = None
) -> Iterator[Rig]:
    """Open the devices of a rig; they are closed when the context is left."""
    if not rig.is_simulated:
        with _open_devices(rig, None) as opened:
            yield opened
        return
    with (
        simulate(rig, session_name=session_name, run=run, clock=clock) as simulation,
        _open_devices(rig, simulation) as opened,
    ):
        yield opened


def require_drivers(rig: RigFile) -> None:
    """Raise ConfigError if a driver is not installed or a simulated camera is unknown. No device is opened."""
    if rig.stage is not None:
        find_driver("rigctl.stages", rig.stage.driver, key="stage.driver")
    for monitor in rig.monitors:
        find_driver("rigctl.monitors", monitor.driver, key=f"monitors.{monitor.name}.driver")
    require_known_camera(rig.camera.address, is_mosaic=rig.camera.mosaic_deg is not None)
    if not rig.camera.address.startswith(SIMULATED):
        find_driver(_CAMERAS, rig.camera.address.partition(":")[0], key="camera.address")


@contextmanager
def open_stage(section: StageSection, *, warn: Callable[[str], None]) -> Iterator[RotationStage]:
    """Open the stage of a rig file without the rest of the rig; it is closed when the context is left."""
    if not section.port.startswith(SIMULATED):
        with _connect_stage(section, resolve_port(section.port, warn=warn)) as stage:
            yield stage
        return
    try:
        options = parse_stage_address(section.port)
    except ValueError as error:
        raise ConfigError(f"stage.port: {error}") from error
    clock = SimClock(speed=options.speed)
    with serve_on_pty(make_stage(options, clock=clock), clock=clock) as port, _connect_stage(section, port) as stage:
        yield stage


def find_driver(group: str, name: str, *, key: str) -> EntryPoint:
    """Return an installed driver."""
    installed = {entry.name: entry for entry in entry_points(group=group)}
    if group == _CAMERAS and _is_place(name):
        raise ConfigError(
            f"{key}: {name!r} does not say which driver: write DRIVER:PLACE, such as gige:{name}; drivers are "
            f"{', '.join(sorted(installed))}"
        )
    if name not in installed:
        known = ", ".join(sorted(installed)) or "none"
        raise ConfigError(f"{key}: there is no driver {name!r}; installed are: {known}{_driver_meant(name, installed)}")
    return installed[name]


def require_cell(rig: RigFile, camera: Camera) -> None:
    """Raise ConfigError if the camera states a mosaic other than that of the rig file."""
    own = camera.facts().mosaic_deg if isinstance(camera, CameraWithFacts) else None
    stated = rig.camera.mosaic_deg
    if own is None:
        return
    cell = ", ".join(f"{angle:g}" for angle in own)
    if stated is None:
        raise ConfigError(
            "camera.mosaic_deg: the camera says that it has polarizers on its pixels: state "
            f"mosaic_deg = [{cell}], and leave [stage] out"
        )
    if any(abs(wrapped(one - other, turn=180.0)) > _CELL_TOLERANCE_DEG for one, other in zip(stated, own, strict=True)):
        found = ", ".join(f"{angle:g}" for angle in stated)
        raise ConfigError(f"camera.mosaic_deg: is [{found}], and the camera says that its cell is [{cell}]")


def cell_problem(counts: NDArray[np.uint16], mosaic_deg: Sequence[float], *, bit_depth: int) -> str | None:
    """Return a message if the light contradicts a cell; None if it agrees or is not sufficient to decide."""
    found = pair_by_light(counts, tuple(mosaic_deg), saturation_dn=float(2**bit_depth - 1))
    if found is None:
        return None
    stated = ", ".join(f"{angle:g}" for angle in mosaic_deg)
    one, other = (_PLACES[place] for place in found)
    return (
        f"mosaic_deg = [{stated}] does not fit the light: by its sums the {one} and the {other} pixel of a cell stand "
        "across one another, and the two that are left. Look up the cell of the sensor, and whether the picture is "
        "mirrored or begins at an odd row or column"
    )


@contextmanager
def _open_devices(rig: RigFile, simulation: Simulation | None) -> Iterator[Rig]:
    with _stage(rig, simulation) as stage, _camera(rig, simulation) as camera:
        camera_identity = camera.identify()
        _require_serial("camera", rig.camera.serial_number, camera_identity)
        require_cell(rig, camera)
        yield Rig(
            stage=stage,
            camera=camera,
            stage_identity=None if stage is None else stage.identify(),
            camera_identity=camera_identity,
            present=_ask_nobody if simulation is None else simulation.world.present,
            ask=_ask_operator if simulation is None else _ask_nobody,
            origin="device" if simulation is None else "simulated",
            begin_step=_do_nothing if simulation is None else simulation.begin_step,
            light=None if simulation is None else simulation.light,
        )


@contextmanager
def _stage(rig: RigFile, simulation: Simulation | None) -> Iterator[RotationStage | None]:
    if rig.stage is None:
        yield None
        return
    simulated_port = None if simulation is None else simulation.stage_port
    is_real = simulated_port is None or not rig.stage.port.startswith(SIMULATED)
    port = resolve_port(rig.stage.port, warn=warn) if is_real or simulated_port is None else simulated_port
    with _connect_stage(rig.stage, port) as stage:
        yield stage


def _camera(rig: RigFile, simulation: Simulation | None) -> Camera:
    address = rig.camera.address
    if address.startswith(SIMULATED) and simulation is not None:
        if simulation.network_address is None:
            return simulation.camera
        address = simulation.network_address
    scheme, _, place = address.partition(":")
    factory = find_driver(_CAMERAS, scheme, key="camera.address").load()
    camera: Camera = factory(place)
    return camera


def _ask_operator(kind: FrameKind) -> None:
    """Ask the person at the terminal to place an object before the camera; return once it is there."""
    if not sys.stdin.isatty():
        if kind == "scene":
            return  # a scene needs nothing before the lens
        raise ConfigError(
            f"a take of kind {kind!r} needs somebody at the rig, and there is no terminal to ask at: "
            "run it by hand, or keep to takes of one kind"
        )
    sys.stderr.write(f"{REQUESTS[kind]}, then press Enter: ")
    sys.stderr.flush()
    sys.stdin.readline()


@contextmanager
def _connect_stage(section: StageSection, port: str) -> Iterator[RotationStage]:
    """Open the stage on a port and check that it is the one of the rig file."""
    factory = find_driver("rigctl.stages", section.driver, key="stage.driver").load()
    given: dict[str, Any] = {"tolerance_deg": section.tolerance_deg, **section.options}
    if section.address is not None:
        given["address"] = section.address
    _require_arguments(factory, section.driver, port, given)
    with _opened_stage(factory, section.driver, port, given) as stage:
        identity = stage.identify()
        _require_serial("stage", section.serial_number, identity)
        if section.characterisation is None:
            yield stage
        else:
            yield _SettlingStage(stage, settle_s=load_settle_s(section.characterisation, identity=identity))


def _require_serial(what: str, configured: str | None, found: DeviceIdentity) -> None:
    """Raise NotConnectedError if a device does not have the serial number that the rig file states."""
    if configured is not None and configured != found.serial_number:
        raise NotConnectedError(
            f"the {what} is {found.model} with serial number {found.serial_number}, and the rig file asks for "
            f"{configured}: another device answers there. Correct its address or serial_number"
        )


def _opened_stage(
    factory: Callable[..., RotationStage], driver: str, port: str, given: dict[str, Any]
) -> RotationStage:
    """Return the stage that a driver opens; if another device answers, the error says how to identify it."""
    try:
        return factory(port, **given)
    except (ProtocolError, DeviceTimeoutError) as error:
        raise type(error)(
            f"{error}. If the stage is of another kind than driver = {driver!r}: "
            f"`rigctl devices --probe --port {port}` tells which driver it needs"
        ) from error


def _require_arguments(factory: Callable[..., RotationStage], driver: str, port: str, given: dict[str, Any]) -> None:
    signature = inspect.signature(factory)
    try:
        signature.bind(port, **given)
    except TypeError as error:
        allowed = ", ".join(name for name in list(signature.parameters)[1:] if name not in _OF_TESTS)
        unknown = ", ".join(sorted(set(given) - set(signature.parameters)))
        raise ConfigError(f"stage: driver {driver!r} has no option {unknown}; it takes {allowed}") from error


def _is_place(name: str) -> bool:
    """Return whether a name is a place rather than a driver: an IP address, or a path."""
    return name.startswith("/") or bool(re.fullmatch(r"[0-9.]+", name))


def _driver_meant(name: str, installed: Collection[str]) -> str:
    """Return a suggestion for a wrong name of a driver."""
    word = name.strip().lower()
    by_model = next((driver for models, driver in _DRIVERS_OF_MODELS if word.startswith(models)), None)
    known = by_model is not None and by_model in installed
    close = [by_model] if known else get_close_matches(word, list(installed), n=1)
    return f"; did you mean {close[0]}?" if close else ""


class Trace:
    """Communication with the devices as plain text: each byte of serial lines, and settings and frames of the camera.

    Each line is an event with the seconds since the trace began::

        0.001204 /dev/ttyUSB0 > 30 69 6e                     sent, in hexadecimal
        0.014117 /dev/ttyUSB0 < 30 49 4e 30 45               received
        0.020000 /dev/ttyUSB0 gone
        0.120332 camera set exposure_s=0.01 gain_db=0: exposure_s=0.0100012 gain_db=0 width=782 height=582 bit_depth=12
        0.230541 camera frame 12: exposure_s=0.0100012 gain_db=0 width=782 height=582 bit_depth=12
        0.250000 camera failed: DeviceTimeoutError: no frame within 2 s

    Several threads write; a full disk ends the trace, not the session.
    """

    def __init__(self, file: TextIO, *, now_s: Callable[[], float] = time.monotonic) -> None:
        self._file: TextIO | None = file
        self._now_s, self._began_s = now_s, now_s()
        self._lock = threading.Lock()
        self.line(f"trace of rigctl {VERSION}, schema {_TRACE_SCHEMA}")

    def line(self, text: str) -> None:
        """Write an event with its time."""
        with self._lock:
            if self._file is None:
                return
            try:
                self._file.write(f"{self._now_s() - self._began_s:.6f} {' '.join(text.split())}\n")
            except OSError as error:
                self._file = None
                warn(f"--trace: nothing more is written: {error.strerror}")

    def hear(self, data: bytes, *, port: str, from_host: bool) -> None:
        """Write bytes of a serial line; no bytes from the device mean that its port is gone."""
        self.line(f"{port} {'>' if from_host else '<'} {data.hex(' ')}" if data or from_host else f"{port} gone")

    @contextmanager
    def of(self, opened: AbstractContextManager[Rig]) -> Iterator[Rig]:
        """Open a rig with its devices traced."""
        with heard_by(self.hear), opened as rig:
            for what, identity in (("stage", rig.stage_identity), ("camera", rig.camera_identity)):
                if identity is not None:
                    self.line(f"{what} is {fields_text(identity)}")
            if isinstance(rig.camera, CameraWithFacts):
                self.line(f"camera has {fields_text(rig.camera.facts())}")
            yield replace(rig, trace=self.line)


@contextmanager
def trace_into(path: Path | None) -> Iterator[Trace | None]:
    """Open a trace that is written line by line into a new file; None without a path."""
    if path is None:
        yield None
        return
    try:
        file = path.open("x", encoding="utf-8", buffering=1)
    except OSError as error:
        raise ConfigError(f"--trace: {path} cannot be written: {error.strerror}") from error
    with file:
        yield Trace(file)


def fields_text(record: Any) -> str:
    """Return the fields of a record as ``name=value`` in one line."""
    return " ".join(
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in asdict(record).items()
    )


class _SettlingStage:
    """A stage with a pause and a fresh readback after each move."""

    def __init__(self, stage: RotationStage, *, settle_s: float, sleep: Callable[[float], None] = time.sleep) -> None:
        self._stage = stage
        self._settle_s = settle_s
        self._sleep = sleep

    def __enter__(self) -> "_SettlingStage":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def identify(self) -> DeviceIdentity:
        """Return the identity of the device."""
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
